"""From what the panels say to a face in the scene, in three steps.

`request` reads Blender's properties (main thread), `solve` is core code only (any
thread), `deliver` writes the scene (main thread).  The operators, the command line
and the modal job all go this way.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ..core.errors import ReconstructionError
from . import messages, photo_list
from .maps import all_maps

# Part of the whole time that the core's reconstruction takes; the rest paints.
SOLVE_SHARE = 0.85


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
    start : core BSplineSurface or None
        A face to start from, in the size and place of results; None for the average.
    held : (M, N) bool array or None
        Control points of ``start`` that stay where they are.
    softness_mm : float
        How far held points may give way; 0 = not at all.
    texture_size : int or None
        Pixels along a side; None for what the photos are worth.
    """

    photos: Any
    settings: Any
    name: str
    ignore: tuple[str, ...] = ()
    landmarks: dict = field(default_factory=dict)
    start: Any = None
    held: Any = None
    softness_mm: float = 0.0
    texture_size: int | None = None


@dataclass(frozen=True)
class Outcome:
    """What `solve` found.

    Attributes
    ----------
    result : core Reconstruction
    maps : dict of maps.Map
        Pictures for the surface by kind.
    texture : core Texture or None
    """

    result: Any
    maps: dict
    texture: Any = None


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
    from . import settings_group

    try:
        return settings_group.to_core(group, changes)
    except ValueError as error:
        # The core's sentence names the setting and its limits.
        raise ReconstructionError(str(error)) from error
    except TypeError as error:
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
    from ..core.solve.constraint import Constraint, edited_template, hold
    from ..core.surface.template import load_template

    def tell(step):
        if progress is not None:
            progress(replace(step, overall=step.overall * SOLVE_SHARE))

    template = held = None
    if request.start is not None:
        template = edited_template(request.start, load_template())
    if request.held is not None:
        held = Constraint(request.held, request.softness_mm)
    result = reconstruct(
        request.photos,
        request.settings,
        template=template,
        progress=tell,
        ignore=request.ignore,
        landmarks=request.landmarks or None,
        held=held,
    )
    if held is not None:
        # Size and place of the result are its own; the held points' are the object's.
        surface = hold(
            result.surface,
            request.start.control_points,
            held.points,
            held.softness_mm,
            request.settings.smooth_mm,
            request.settings.smooth_length,
        )
        result = replace(result, surface=surface)
    texture = _texture(result, progress, request.texture_size)
    return Outcome(result, all_maps(result, texture), texture)


def _texture(result, progress, size):
    """The core's Texture of the used photos, with progress; None without photos."""
    from ..core.progress import Step
    from ..core.texture.bake import bake_texture

    def tell(fraction):
        if progress is not None:
            overall = SOLVE_SHARE + (1 - SOLVE_SHARE) * fraction
            done = round(100 * fraction)
            progress(Step("output", done, 100, overall, "painting the texture"))

    return bake_texture(result, size, tell) if result.photos else None


def request(state, photos=None, name="", changes=None, **fields):
    """The `Request` that the panel's state means.

    Parameters
    ----------
    state : BSFACE_PG_scene
    photos : tuple of paths, optional
        Instead of those of the list.
    name : str
        Of a new face; by default that of the photos' folder.
    changes : dict, optional
        Settings that win over the panel's.
    fields
        Other fields of `Request`.
    """
    if photos is None:
        fields.setdefault("ignore", photo_list.ignored(state))
        fields.setdefault("landmarks", photo_list.known_landmarks(state))
        photos = photo_list.paths(state)
    if not photos:
        raise ReconstructionError(messages.NO_PHOTOS)
    size = state.texture_size
    return Request(
        photos=photos,
        settings=settings(state.settings, changes),
        texture_size=None if size == "AUTO" else int(size),
        name=name or face_name(photos),
        **fields,
    )


def photos_of(face):
    """Files of the photos that shaped a face, as far as they are still there."""
    from . import scene

    rows = scene.stored(face, scene.PHOTOS, [])
    found = tuple(Path(row["path"]) for row in rows if row["path"])
    found = tuple(path for path in found if path.is_file())
    if not found:
        raise ReconstructionError(messages.NO_SUCH_FILES.format(name=face.name))
    return found


def detect(request, progress=None):
    """Find faces and landmarks only; returns the core's Gathered."""
    from ..core.prepare import collect_photos

    return collect_photos(
        request.photos,
        request.settings,
        progress,
        ignore=request.ignore,
        landmarks=request.landmarks or None,
    )


def next_face(path, name, scheme, current):
    """Landmarks of the next face to the right in a photo, after the last the first.

    Parameters
    ----------
    scheme : str
        Landmark scheme.
    current : core Landmarks or None
        Of the face that is chosen now.

    Raises
    ------
    ReconstructionError
        No face was found.
    """
    from ..core.landmarks.all_faces import faces_in
    from ..core.settings import Settings

    found = faces_in(path, name, Settings(landmarks=scheme))
    if not found:
        raise ReconstructionError(found.reason)
    if current is None:
        return found[0]
    middles = [
        abs(face.points.mean(0) - current.points.mean(0)).sum() for face in found
    ]
    return found[(middles.index(min(middles)) + 1) % len(found)]


def hints(collection):
    """Sentences on the views that are missing, before anything is solved."""
    import numpy as np

    from ..core.camera.coverage import shortcomings
    from ..core.camera.linear_pose import linear_pose
    from ..core.surface.template import load_template

    template = load_template()
    poses = []
    for found in collection.landmarks:
        index = template.schemes[found.scheme]
        weight = found.weight * template.landmark_reliable[index]
        pose = linear_pose(found.points, template.landmark_xyz[index], weight)
        if pose:
            poses.append(pose.yaw_pitch_roll)
    return shortcomings(np.reshape(poses, (-1, 3)))


def photo_size(path, name):
    """A core Photo (its size is that of the turned picture) or PhotoFailure."""
    from ..core.images.read import read_photo

    return read_photo(path, name)


def line_indices(scheme):
    """Where the 68 points stand among the landmarks of a scheme, or None."""
    from ..core.surface.template import load_template

    if scheme == "68":
        return range(68)
    return load_template().schemes["68"] if scheme == "468" else None


def write_landmarks(path, found):
    """Write landmarks; .pts takes the 68 points out of the 468."""
    from ..core.landmarks.landmarks import write_landmarks

    if path.suffix.lower() == ".pts" and found.scheme == "468":
        found = found.subset("68", line_indices("468"))
    try:
        write_landmarks(path, found)
    except (OSError, ValueError) as error:
        raise ReconstructionError(messages.NOT_WRITTEN.format(why=error)) from error


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
