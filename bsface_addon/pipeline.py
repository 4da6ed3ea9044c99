"""From what the panels say to a face in the scene, in three steps.

`request` reads Blender's properties (main thread), `solve` is core code only (any
thread), `deliver` writes the scene (main thread).  The operators, the command line
and the modal job all go this way.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..core.errors import ReconstructionError
from . import messages


@dataclass(frozen=True)
class Request:
    """One job, free of Blender's data.

    Attributes
    ----------
    photos : path of a folder, or tuple of paths
    settings : core Settings
    name : str
        Name of a new face.
    ignore : tuple of str
        Names of photos to leave out.
    landmarks : dict
        Photo name -> core Landmarks that replace detection.
    template : core Template or None
        What to start from; None for the average face.
    """

    photos: Any
    settings: Any
    name: str
    ignore: tuple[str, ...] = ()
    landmarks: dict = field(default_factory=dict)
    template: Any = None


@dataclass(frozen=True)
class Outcome:
    """What `solve` found: a core Reconstruction and the pictures for its surface."""

    result: Any
    maps: dict


def settings(group, changes=None):
    """The core's Settings from the panel's properties.

    Parameters
    ----------
    group : BSFACE_PG_settings
    changes : dict, optional
        Settings by the core's names that win over the panel's.

    Raises
    ------
    ReconstructionError
        A value is not possible.
    """
    from ..core.settings import Settings

    values = {
        "method": group.method,
        "landmarks": group.landmarks,
        "detector": group.detector,
        "control_points": (group.control_points_u, group.control_points_v),
        **(changes or {}),
    }
    try:
        return Settings.from_dict(values)
    except (TypeError, ValueError) as error:
        raise ReconstructionError(messages.BAD_SETTINGS.format(why=error)) from error


def parsed(text):
    """Settings written as a JSON object; empty text is no settings."""
    try:
        changes = json.loads(text) if text.strip() else {}
    except ValueError as error:
        raise ReconstructionError(messages.BAD_SETTINGS.format(why=error)) from None
    if not isinstance(changes, dict):
        why = "give a JSON object such as {}".format('{"method": "motion"}')
        raise ReconstructionError(messages.BAD_SETTINGS.format(why=why))
    return changes


def solve(request, progress=None):
    """Do the job; no Blender in here.

    Raises
    ------
    ReconstructionError
        The job failed; the sentence says why and what to do.
    Cancelled
        By ``progress``.
    """
    from ..core.reconstruct import reconstruct

    result = reconstruct(
        request.photos,
        request.settings,
        template=request.template,
        progress=progress,
        ignore=request.ignore,
        landmarks=request.landmarks or None,
    )
    return Outcome(result, maps(result))


def maps(result):
    """Pictures for the surface by kind (see `material.MAPS`)."""
    return {}


def deliver(context, request, outcome, *, face=None, scale=1.0):
    """Put the outcome into the scene; see `scene.place`."""
    from . import scene

    return scene.place(
        context,
        outcome.result,
        request.name,
        face=face,
        scale=scale,
        maps=outcome.maps,
    )


def face_name(photos):
    """A name for the face: that of the photos' folder."""
    if isinstance(photos, tuple | list):
        folders = {Path(path).parent for path in photos}
        name = folders.pop().name if len(folders) == 1 else ""
    else:
        name = Path(photos).resolve().name
    # Names that say nothing about the person.
    return "Face" if name.lower() in ("", "photos", "images", "pictures") else name
