"""Taking a face and all that belongs to it out of the file.

Cameras, suns and pictures of a face that was deleted with Blender's own delete stay
behind; they are found by the rig whose face is gone.
"""

from __future__ import annotations

from collections.abc import Iterable

import bpy

from . import camera_views, material, rig
from .scene import MARK

# Marks of the collections inside the one of a face.
PARTS = ("cameras", "lights")


def remove_face(context: bpy.types.Context, face: bpy.types.Object) -> None:
    """Delete a face with its cameras, lights and what only they use."""
    homes = _homes(face, face.name)
    empty = rig.find(face)
    if empty is not None:
        _remove_rig(context, empty)
    rig.free_children(context, [face])
    _purge_face(face)
    _remove_empty(homes)


def leftovers(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Rigs in the scene whose face was deleted; their children are cameras and suns."""
    return [
        obj
        for obj in context.scene.objects
        if rig.is_rig(obj) and not _is_in_use(context, rig.face_of_rig(obj))
    ]


def remove_leftovers(context: bpy.types.Context) -> int:
    """Delete cameras, suns and pictures of deleted faces; how many objects went."""
    count = 0
    for empty in leftovers(context):
        face = rig.face_of_rig(empty)
        homes = _homes(empty, "" if face is None else face.name)
        count += 1 + _remove_rig(context, empty)
        if face is not None:
            # Only our own pointers kept the deleted face alive.
            _purge_face(face)
        _remove_empty(homes)
    return count


def _is_in_use(context: bpy.types.Context, face: bpy.types.Object | None) -> bool:
    """Whether a face is in some scene, though perhaps not in this one."""
    return face is not None and bool(face.users_scene)


def _remove_rig(context: bpy.types.Context, empty: bpy.types.Object) -> int:
    """Delete a rig with its cameras and suns; how many those were."""
    parts = rig.own(empty)
    if context.scene.camera in parts:
        camera_views.leave_views(context)
    images = [
        slot.image
        for obj in parts
        if obj.type == "CAMERA"
        for slot in obj.data.background_images
    ]
    data = [obj.data for obj in parts]
    rig.free_children(context, [*parts, empty])
    bpy.data.batch_remove([*parts, empty])
    _remove_unused(data)
    _remove_unused(images)
    return len(parts)


def _purge_face(face: bpy.types.Object) -> None:
    curve, own, images = face.data, material.existing(face), material.images(face)
    if own is not None and own.users > 1:
        # A mesh of the face keeps the material, and nothing could change its map.
        has_skin = material.stored_map(face, "SKIN") is not None
        material.show(face, "SKIN" if has_skin else "PLAIN")
    for scene in bpy.data.scenes:
        if scene.bsface.face == face:
            scene.bsface.face = None
    bpy.data.objects.remove(face)
    _remove_unused([curve])
    _remove_unused([own])
    _remove_unused(images)


def _remove_unused(blocks: Iterable[bpy.types.ID | None]) -> None:
    found = {block for block in blocks if block is not None}
    bpy.data.batch_remove([block for block in found if block.users == 0])


def _homes(obj: bpy.types.Object, name: str) -> list[bpy.types.Collection]:
    """Collections of the add-on that an object of a face is in, innermost first."""
    found = []
    for home in obj.users_collection:
        parts = [child for child in home.children if child.get(MARK) in PARTS]
        # In files of before the outer one has its name only.
        named = home.name == f"BSface {name}" or (
            parts and home.name.startswith("BSface ")
        )
        ours = home.get(MARK) == "face" or named
        found += [*parts, home] if ours else parts
    return found


def _remove_empty(homes: Iterable[bpy.types.Collection]) -> None:
    """Delete collections of the add-on that hold nothing now."""
    for home in homes:
        if not home.all_objects and not home.children:
            bpy.data.collections.remove(home)
