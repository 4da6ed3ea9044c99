"""An edited face as the template of the next run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .alignment import eye_centres, fit_similarity
from .bspline import BSplineSurface
from .template import Template

NO_FACE = (
    "The surface that was given as the template is no face; give a result, edited or "
    "not."
)
# Root mean square distance of the landmarks from the template's, in eye distances:
# of good faces below 0.15 (`solve.sanity`); and the largest size in any unit.
_FARTHEST, _LARGEST = 0.5, 1e9


def edited_template(surface: BSplineSurface, base: Template) -> Template:
    """The template with an edited face in place of its own.

    The face is brought to the size and place of the template by its landmarks; the
    free landmark points keep their offset from the surface.

    Parameters
    ----------
    surface : BSplineSurface
        A result, edited; any size of net.
    base : Template
        Gives everything else; resampled to the net of ``surface``.

    Raises
    ------
    ValueError
        When the surface is no face.
    """
    base = base.resampled(surface.shape)
    uv = base.landmark_uv
    there = base.surface.evaluate(*uv.T)
    sure = base.landmark_reliable
    found = surface.evaluate(*uv[sure].T)
    if not 0 < np.ptp(found, axis=0).max() < _LARGEST:
        raise ValueError(NO_FACE)
    place = fit_similarity(found, there[sure])
    if not 0 < place.scale < np.inf:
        raise ValueError(NO_FACE)
    moved = surface.transformed(place.scale, place.R, place.t)
    away = np.linalg.norm(moved.evaluate(*uv[sure].T) - there[sure], axis=1)
    if not np.sqrt((away**2).mean()) < _FARTHEST * base.eye_distance:
        raise ValueError(NO_FACE)
    return replace(
        base,
        surface=moved,
        landmark_xyz=base.landmark_xyz + moved.evaluate(*uv.T) - there,
        eye_centres=eye_centres(moved, base),
    )
