"""The face file (.npz) inside the face object, so that a .blend knows all of a run.

Cameras, landmarks, light, settings and report lie in one custom property, as the
bytes of the file that the core writes; the control points of the object win over
those in the file, because the artist may have moved them.
"""

from __future__ import annotations

import io
from dataclasses import dataclass

import bpy
import numpy as np

from ..core._types import Array, Mask
from ..core.formats.face_file import read_face
from ..core.result import Reconstruction
from ..core.surface.bspline import BSplineSurface
from . import surface_object

KEY = "bsface_file"
# Less than this is rounding to float32.
MOVED_MM = 1e-3


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
        stored = read_face(io.BytesIO(self.file), self.name)
        return stored.with_surface(self.surface)


def stored(face: bpy.types.Object) -> StoredFace:
    """The face as it is now."""
    return StoredFace(face.name, face[KEY], surface(face))


def saved(face: bpy.types.Object) -> Reconstruction:
    """What is known of the run, with the control points of the object as they are."""
    return stored(face).read()


def surface(face: bpy.types.Object, key: str | None = None) -> BSplineSurface:
    """The object's control points, or those of a shape key, as a surface in mm."""
    return BSplineSurface(surface_object.read(face, key))


def moved(face: bpy.types.Object) -> Mask:
    """Control points that are not where the last run put them, (M, N)."""
    points = surface_object.read(face)
    solved = _stored(face, "control_points")
    if solved.shape != points.shape:
        return np.zeros(points.shape[:2], bool)  # resampled since
    return np.linalg.norm(points - solved, axis=2) > MOVED_MM


def outline(face: bpy.types.Object) -> Array:
    """The face's outline in (u, v), (k, 2)."""
    return _stored(face, "outline_uv")


def _stored(face: bpy.types.Object, name: str) -> Array:
    """One array of the face file, without reading the others."""
    with np.load(io.BytesIO(face[KEY]), allow_pickle=False) as archive:
        return archive[name]
