"""The face file (.npz) inside the face object, so that a .blend knows all of a run.

Cameras, landmarks, light, settings and report lie in one custom property, as the
bytes of the file that the core writes; the control points of the object win over
those in the file, because the artist may have moved them.
"""

from __future__ import annotations

import io
import zipfile
from dataclasses import dataclass

import bpy
import numpy as np

from ..core._types import Array, Mask
from ..core.errors import ReconstructionError
from ..core.formats.face_file import read_face
from ..core.result import Reconstruction
from ..core.surface.alignment import fit_similarity
from ..core.surface.bspline import BSplineSurface, resampled_net
from . import messages, surface_object

KEY = "bsface_file"
# Less than this is rounding to float32.
MOVED_MM = 1e-3
# A net that is farther away than the first, and has another shape by less than the
# second of that, was moved as a whole.
TOGETHER_MM, TOGETHER = 5.0, 0.2


def keep(face: bpy.types.Object, file: bytes) -> None:
    """Store the core's file of a reconstruction."""
    if KEY in face:
        # Blender cuts bytes at the first zero when they replace others.
        del face[KEY]
    face[KEY] = file


@dataclass(frozen=True)
class StoredFace:
    """A face object as plain data, which any thread may read."""

    name: str
    file: bytes
    surface: BSplineSurface

    def read(self) -> Reconstruction:
        """What is known of the run, with the control points of the object."""
        try:
            stored = read_face(io.BytesIO(self.file), self.name)
        except (OSError, ValueError, zipfile.BadZipFile):
            raise ReconstructionError(
                messages.NO_FACE_FILE.format(name=self.name)
            ) from None
        return stored.with_surface(self.surface)


def stored(face: bpy.types.Object) -> StoredFace:
    """The face as it is now."""
    return StoredFace(face.name, _file(face), surface(face))


def saved(face: bpy.types.Object) -> Reconstruction:
    """What is known of the run, with the control points of the object as they are."""
    return stored(face).read()


def surface(face: bpy.types.Object, key: str | None = None) -> BSplineSurface:
    """The object's control points, or those of a shape key, as a surface in mm.

    Raises
    ------
    ReconstructionError
        They are no finite numbers, or all at one place.
    """
    points = surface_object.read(face, key)
    if not np.isfinite(points).all() or not np.ptp(points, axis=(0, 1)).any():
        raise ReconstructionError(messages.NO_NUMBERS.format(name=face.name))
    return BSplineSurface(points)


def moved(face: bpy.types.Object) -> Mask:
    """Control points that are not where the last run put them, (M, N)."""
    points = surface_object.read(face)
    solved = _stored(face, "control_points")
    if solved.shape != points.shape:
        return np.zeros(points.shape[:2], bool)  # resampled since
    return np.linalg.norm(points - solved, axis=2) > MOVED_MM


def moved_together(face: bpy.types.Object) -> bool:
    """Whether the net was moved, turned or scaled as a whole since the last run.

    Set Origin and Apply do so: all looks as before, but the cameras do not fit.
    """
    points = surface_object.read(face)
    try:
        solved = _stored(face, "control_points")
    except ReconstructionError:
        return False  # nothing is known of the last run
    if not np.isfinite(points).all() or not np.ptp(points, axis=(0, 1)).any():
        return False  # no surface at all, which is said elsewhere
    if solved.shape != points.shape:
        solved = resampled_net(solved, points.shape[:2])
    points, solved = points.reshape(-1, 3), solved.reshape(-1, 3)
    left = points - fit_similarity(solved, points)(solved)
    away, left = (np.sqrt((d**2).sum(1).mean()) for d in (points - solved, left))
    return away > TOGETHER_MM and left < TOGETHER * away


def check_place(face: bpy.types.Object) -> None:
    """Refuse a net that `moved_together`.

    Raises
    ------
    ReconstructionError
    """
    if moved_together(face):
        raise ReconstructionError(messages.TOGETHER.format(name=face.name))


def outline(face: bpy.types.Object) -> Array:
    """The face's outline in (u, v), (k, 2)."""
    return _stored(face, "outline_uv")


def _stored(face: bpy.types.Object, name: str) -> Array:
    """One array of the face file, without reading the others."""
    try:
        with np.load(io.BytesIO(_file(face)), allow_pickle=False) as archive:
            return archive[name]
    except (ValueError, KeyError, OSError, zipfile.BadZipFile):
        raise ReconstructionError(
            messages.NO_FACE_FILE.format(name=face.name)
        ) from None


def _file(face: bpy.types.Object) -> bytes:
    """The face file; the user may have written anything into the property."""
    file = face.get(KEY)
    if not isinstance(file, bytes) or not file:
        raise ReconstructionError(messages.NO_FACE_FILE.format(name=face.name))
    return file
