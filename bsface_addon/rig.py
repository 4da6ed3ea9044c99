"""What moves cameras and suns along with their face.

A hidden empty copies the face's transform and is the parent of them all.  With the
face itself as the parent, Blender would draw a dashed line from it to each of forty
cameras.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable

import bpy
from mathutils import Matrix

from ..core.errors import ReconstructionError
from . import coordinates, messages

MARK = "bsface"
NAME = "rig"
PHOTO_KEY = "bsface_photo"
# On the rig: pointers to the cameras and suns that the add-on has made.
MADE = "bsface_made"


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
    # Mirrored faces have negative scales.
    scale = abs(face.matrix_world.to_scale().x)
    if scale == 0:
        raise ReconstructionError(messages.NO_SIZE.format(name=face.name))
    obj.matrix_parent_inverse = turn @ Matrix.Scale(1 / scale, 4)
    place = Matrix(pose)
    place.translation *= scale * frame.to_scale().x
    obj.matrix_basis = place


def members(face: bpy.types.Object, kind: str) -> list[bpy.types.Object]:
    """Objects of a type ("CAMERA", "LIGHT") on the rig, by name."""
    rig = find(face)
    found = [] if rig is None else [obj for obj in own(rig) if obj.type == kind]
    return sorted(found, key=lambda obj: obj.name)


def own(rig: bpy.types.Object) -> list[bpy.types.Object]:
    """Cameras and suns that the add-on made; what else is on the rig is the user's.

    A copy of a camera is the user's too, though it has all properties of the camera.
    """
    # The user may write anything into a custom property.
    parts = [obj for obj in rig.children if isinstance(obj.get(PHOTO_KEY), str)]
    known = rig.get(MADE)
    if hasattr(known, "values"):
        made = list(known.values())
        noted = [obj for obj in parts if obj in made]
        if noted:
            return noted
    # A file of before: Blender counts the names of copies up.
    first = {}
    for obj in sorted(parts, key=lambda obj: obj.name):
        first.setdefault((obj.type, obj[PHOTO_KEY]), obj)
    return list(first.values())


def is_own(obj: bpy.types.Object) -> bool:
    """Whether an object is a camera or sun that the add-on has put on a rig."""
    return obj.parent is not None and is_rig(obj.parent) and obj in own(obj.parent)


def note(rig: bpy.types.Object, parts: Iterable[bpy.types.Object]) -> None:
    """Remember which cameras and suns on a rig the add-on has made."""
    rig[MADE] = {str(number): obj for number, obj in enumerate(parts)}


def free_children(
    context: bpy.types.Context, parents: Collection[bpy.types.Object]
) -> None:
    """Take what the user hung on objects off them; it stays at its place."""
    context.view_layer.update()
    for obj in bpy.data.objects:
        if obj.parent in parents and obj not in parents:
            place = obj.matrix_world.copy()
            obj.parent = None
            obj.matrix_world = place
