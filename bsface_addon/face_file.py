"""The face file (.npz) inside the face object, so that a .blend knows all of a run.

Cameras, landmarks, light, settings and report lie in one custom property, as the
bytes of the file that the core writes; the control points of the object win over
those in the file, because the artist may have moved them.
"""

from __future__ import annotations

import io

import numpy as np

from . import surface_object

KEY = "bsface_file"
# Less than this is rounding to float32.
MOVED_MM = 1e-3


def keep(face, result):
    """Store what the core's file of a reconstruction would hold."""
    from ..core.formats.face_file import face_bytes

    if KEY in face:
        # Blender cuts bytes at the first zero when they replace others.
        del face[KEY]
    face[KEY] = face_bytes(result)


def saved(face, key=None):
    """The core's Reconstruction with the control points of the object as they are.

    Parameters
    ----------
    key : str, optional
        Shape key to take the control points from.
    """
    from ..core.formats.face_file import read_face
    from ..core.surface.bspline import BSplineSurface

    stored = read_face(io.BytesIO(face[KEY]), face.name)
    return stored.with_surface(BSplineSurface(surface_object.read(face, key)))


def write(path, face):
    """Write the face file of an object."""
    return saved(face).save(path)


def surface(face, key=None):
    """The object's control points as the core's BSplineSurface."""
    from ..core.surface.bspline import BSplineSurface

    return BSplineSurface(surface_object.read(face, key))


def moved(face):
    """Control points that are not where the last run put them, (M, N) bool array."""
    points = surface_object.read(face)
    with np.load(io.BytesIO(face[KEY]), allow_pickle=False) as archive:
        solved = archive["control_points"]
    if solved.shape != points.shape:
        return np.zeros(points.shape[:2], bool)  # resampled since
    return np.linalg.norm(points - solved, axis=2) > MOVED_MM


def outline(face):
    """The face's outline in (u, v), (k, 2)."""
    return saved(face).template.outline_uv
