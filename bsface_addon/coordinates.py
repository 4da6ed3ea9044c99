"""The core's axes and millimetres <-> an object's own coordinates <-> the scene.

An object's own coordinates are upright (the core's y is Blender's z, its z, toward the
camera, Blender's -y) and in the scene's units, so that the object itself has scale 1
and no rotation and exports, rigs and physics see it as it is.  The object keeps its
units per millimetre (`UNIT_KEY`).  Objects of version 0.1 have none: their coordinates
are the core's.
"""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix

from ..core._types import Array

METRES_PER_MM = 0.001
#: On the object: its units per millimetre of the face.
UNIT_KEY = "bsface_units_per_mm"
# A quarter turn about x, exactly.
UPRIGHT = Matrix(((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1)))


def units_per_mm(context: bpy.types.Context, scale: float = 1.0) -> float:
    """Blender units per millimetre of a new face; ``scale`` 1 is life size.

    One unit is one metre unless the scene's unit scale says otherwise.
    """
    return scale * METRES_PER_MM / context.scene.unit_settings.scale_length


def local_frame(obj: bpy.types.Object) -> Matrix:
    """From the core's axes and millimetres to the object's own coordinates."""
    unit = obj.get(UNIT_KEY)
    return Matrix() if unit is None else UPRIGHT @ Matrix.Scale(unit, 4)


def world_frame(obj: bpy.types.Object) -> Matrix:
    """From the core's axes and millimetres to the scene."""
    return obj.matrix_world @ local_frame(obj)


def to_local(obj: bpy.types.Object, xyz: Array) -> Array:
    """Points of the core, (..., 3) mm, in the object's own coordinates."""
    return in_units(obj.get(UNIT_KEY), xyz)


def in_units(unit: float | None, xyz: Array) -> Array:
    """As `to_local`, from an object's units per millimetre; any thread may call it."""
    return xyz if unit is None else unit * _upright(xyz)


def from_local(obj: bpy.types.Object, xyz: Array) -> Array:
    """The reverse of `to_local`."""
    unit = obj.get(UNIT_KEY)
    if unit is None:
        return xyz
    return np.stack([xyz[..., 0], xyz[..., 2], -xyz[..., 1]], -1) / unit


def _upright(xyz: Array) -> Array:
    """The core's axes -> Blender's."""
    return np.stack([xyz[..., 0], -xyz[..., 2], xyz[..., 1]], -1)
