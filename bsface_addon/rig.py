"""What moves cameras and suns along with their face.

A hidden empty copies the face's transform and is the parent of them all.  With the
face itself as the parent, Blender would draw a dashed line from it to each of forty
cameras.
"""

from __future__ import annotations

import bpy
from mathutils import Matrix

from ..core.errors import ReconstructionError
from . import coordinates, messages

MARK = "bsface"
NAME = "rig"
PHOTO_KEY = "bsface_photo"


def is_rig(obj: bpy.types.Object) -> bool:
    """Whether the object is the rig of a face."""
    return obj.type == "EMPTY" and obj.get(MARK) == NAME


def face_of_rig(obj: bpy.types.Object) -> bpy.types.Object | None:
    """The face that a rig follows; None where it is gone from the file."""
    copying = (c for c in obj.constraints if c.type == "COPY_TRANSFORMS")
    return next((c.target for c in copying), None)


def find(face: bpy.types.Object) -> bpy.types.Object | None:
    """The rig of a face, or None."""
    for obj in bpy.data.objects:
        if is_rig(obj) and face_of_rig(obj) == face:
            return obj
    return None


def face_of(obj: bpy.types.Object) -> bpy.types.Object | None:
    """The face that a camera or sun belongs to, or None."""
    if obj.parent is None or not is_rig(obj.parent):
        return None
    return face_of_rig(obj.parent)


def ensure(
    face: bpy.types.Object, collection: bpy.types.Collection
) -> bpy.types.Object:
    """The rig of a face; made in the collection where there is none."""
    found = find(face)
    if found is not None:
        return found
    obj = bpy.data.objects.new(f"{face.name} rig", None)
    obj[MARK] = NAME
    collection.objects.link(obj)
    constraint = obj.constraints.new("COPY_TRANSFORMS")
    constraint.target = face
    obj.hide_viewport = obj.hide_render = True
    return obj


def attach(obj: bpy.types.Object, rig: bpy.types.Object, pose: Matrix) -> None:
    """Give an object a place relative to the face, and scale 1 in the world.

    Parameters
    ----------
    rig : bpy.types.Object
        Of the face.
    pose : (4, 4) matrix
        Object axes -> head axes; its translation in millimetres.

    Raises
    ------
    ReconstructionError
        The face has no size.
    """
    face = face_of_rig(rig)
    frame = coordinates.local_frame(face)
    obj.parent = rig
    # Head axes, but the scene's lengths: the rig has the face's own scale.
    turn = frame.to_quaternion().to_matrix().to_4x4()
    scale = face.matrix_world.to_scale().x
    if scale == 0:
        raise ReconstructionError(messages.NO_SIZE.format(name=face.name))
    obj.matrix_parent_inverse = turn @ Matrix.Scale(1 / scale, 4)
    place = Matrix(pose)
    place.translation *= scale * frame.to_scale().x
    obj.matrix_basis = place


def members(face: bpy.types.Object, kind: str) -> list[bpy.types.Object]:
    """Objects of a type ("CAMERA", "LIGHT") on the rig, by name."""
    rig = find(face)
    if rig is None:
        return []
    # The user may write anything into a custom property.
    found = [
        obj
        for obj in rig.children
        if obj.type == kind and isinstance(obj.get(PHOTO_KEY), str)
    ]
    return sorted(found, key=lambda obj: obj.name)
