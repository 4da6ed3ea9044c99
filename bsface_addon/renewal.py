"""Cameras and suns of a face whose photos were run again: the same objects, renewed.

Markers, constraints and the user's own objects hang on them; so a newer camera of a
photo lends its place and lens to the one that is there, and goes.
"""

from __future__ import annotations

from collections.abc import Iterable

import bpy

from . import camera_views, cameras, lights, photo_expression, rig, skin_overlay

Objects = list[bpy.types.Object]


def renewed(
    context: bpy.types.Context,
    face: bpy.types.Object,
    old: Iterable[bpy.types.Object],
    new: Iterable[bpy.types.Object],
) -> Objects:
    """Let the newer cameras and suns of a face renew the older ones.

    Parameters
    ----------
    old, new : iterable of objects
        Those of the face before and after the run.

    Returns
    -------
    list of objects
        The cameras and suns that stay, one a photo.
    """
    known = {_photo(obj): obj for obj in old}
    kept, fresh, gone = [], [], []
    for obj in known.values():
        if obj.type == "CAMERA":
            skin_overlay.hide(obj)
    for obj in new:
        was = known.pop(_photo(obj), None)
        if was is None:
            kept.append(obj)
            fresh.append(obj)
            continue
        (cameras if obj.type == "CAMERA" else lights).renew(was, obj)
        was.matrix_parent_inverse = obj.matrix_parent_inverse
        was.matrix_basis = obj.matrix_basis
        kept.append(was)
        gone.append(obj)
    if context.scene.camera in known.values():
        camera_views.leave_views(context)
    gone += known.values()
    rig.free_children(context, gone)
    _remove(gone)
    for obj in fresh:
        obj.name = obj.data.name = _name(face, obj)
    now = context.scene.camera
    if now in kept:
        photo_expression.show(face, now[rig.PHOTO_KEY])
    else:
        photo_expression.hide(face)
    return kept


def _photo(obj: bpy.types.Object) -> tuple[str, str]:
    return obj.type, obj[rig.PHOTO_KEY]


def _name(face: bpy.types.Object, obj: bpy.types.Object) -> str:
    middle = " light " if obj.type == "LIGHT" else " "
    return f"{face.name}{middle}{obj[rig.PHOTO_KEY]}"


def _remove(objects: Objects) -> None:
    data = [obj.data for obj in objects]
    bpy.data.batch_remove(objects)
    bpy.data.batch_remove([d for d in data if d.users == 0])
