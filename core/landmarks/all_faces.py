"""All faces of one photo, for a person who chooses by hand."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np

from ..errors import PhotoFailure
from ..progress import never_cancelled
from ..settings import Settings
from ..surface.template import Template, load_template
from .candidates import CandidateReader
from .face_models import ModelFiles
from .landmarks import Landmarks


def faces_in(
    source: str | os.PathLike | np.ndarray,
    name: str,
    settings: Settings | None = None,
    *,
    template: Template | None = None,
    models: ModelFiles | None = None,
) -> tuple[Landmarks, ...] | PhotoFailure:
    """Landmarks of every face in a photo, from left to right.

    Parameters
    ----------
    source : path or array
        As for `read_photo`.
    name : str
        The photo's name in reports.
    settings : Settings, optional
        Its ``landmarks`` is the scheme.
    template, models : optional
        By default the bundled ones.

    Returns
    -------
    tuple of Landmarks, or PhotoFailure
        Also faces that `collect_photos` would not use: the person looking knows better.

    Raises
    ------
    ReconstructionError
        If the model files are missing.
    """
    settings = replace(settings or Settings(), detector=True)
    reader = CandidateReader(template or load_template(), settings, {}, models)
    found = reader.read(source, name, never_cancelled)
    if isinstance(found, PhotoFailure):
        return found
    faces = [candidate.landmarks for candidate in found]
    return tuple(sorted(faces, key=lambda face: float(face.points[:, 0].mean())))
