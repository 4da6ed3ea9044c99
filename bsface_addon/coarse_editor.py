"""A coarse net over the face: its points carry the fine net along, detail included.

While it is edited, the net is an object of its own in edit mode, and a timer lets the
face follow.  The mathematics is the core's (`core/surface/coarse.py`).
"""

from __future__ import annotations

import json

import bpy
import numpy as np

from ..core.surface.bspline import BSplineSurface
from ..core.surface.coarse import apply_coarse, coarse_net, mirrored_edit
from . import face_file, scene, selection, surface_object

BEFORE = "bsface_coarse_before"
FACE_BEFORE = "bsface_face_before"
# On the face: its net, which a copy that the user makes of the net is not.
NET = "bsface_coarse_net"
INTERVAL_S = 0.1


def editor() -> bpy.types.Object | None:
    """The coarse net that is being edited, or None."""
    for obj in bpy.context.scene.objects:
        # All its points may have been deleted: it can be left all the same.
        if scene.COARSE_OF in obj and obj.type == "SURFACE" and not _is_copy(obj):
            return obj
    return None


def _is_copy(obj: bpy.types.Object) -> bool:
    face = obj[scene.COARSE_OF]
    original = None if face is None else face.get(NET)
    return original is not None and original != obj


def open_editor(context: bpy.types.Context, face: bpy.types.Object) -> bpy.types.Object:
    """Show the coarse net of a face, ready to be edited."""
    selection.leave_edit_mode(context)
    surface = face_file.surface(face)
    points, net = surface.control_points, coarse_net(surface)
    obj = surface_object.create_like(context, face, f"{face.name} Coarse Net", net)
    obj[scene.COARSE_OF], face[NET] = face, obj
    # As Blender holds it: what was not moved must not move the face.
    obj[BEFORE] = json.dumps(surface_object.read(obj).tolist())
    obj[FACE_BEFORE] = json.dumps(points.tolist())
    surface_object.set_resolution(obj, 1)
    obj.display_type = "WIRE"
    obj.show_in_front = True
    obj.hide_render = True
    selection.select_only(context, obj)
    bpy.ops.object.mode_set(mode="EDIT")
    if not bpy.app.background:
        bpy.app.timers.register(_tick, first_interval=INTERVAL_S)
    return obj


def follow(context: bpy.types.Context) -> None:
    """Let the face follow its coarse net as it is now."""
    obj = editor()
    face = None if obj is None else obj[scene.COARSE_OF]
    if face is None or not scene.is_face(face) or face.mode == "EDIT":
        return
    if not surface_object.is_surface(obj):
        return
    before, fine = (np.array(json.loads(obj[key])) for key in (BEFORE, FACE_BEFORE))
    after = surface_object.read(obj)
    if after.shape != before.shape or fine.shape[:2] != surface_object.shape(face):
        return  # rows were added or deleted: the face stays
    if context.scene.bsface.mirror:
        after = mirrored_edit(before, after)
    points = apply_coarse(BSplineSurface(fine), before, after).control_points
    now = surface_object.read(face)
    if np.abs(points - now).max() > surface_object.ROUNDING_MM:
        surface_object.write(context, face, points)


def close_editor(context: bpy.types.Context, keep: bool) -> None:
    """Remove the coarse net; the face keeps the edit or goes back."""
    obj = editor()
    face = obj[scene.COARSE_OF]
    if keep:
        follow(context)
    selection.leave_edit_mode(context)
    if not keep and scene.is_face(face):
        points = np.array(json.loads(obj[FACE_BEFORE]))
        surface_object.write(context, face, points)
    for other in bpy.data.objects:
        if other != obj and other.get(scene.COARSE_OF) == face:
            other.pop(scene.COARSE_OF)  # a copy is the user's
    if face is not None:
        face.pop(NET, None)
    curve, chosen = obj.data, selection.kept(obj)
    bpy.data.objects.remove(obj)
    if curve.users == 0:
        bpy.data.curves.remove(curve)
    selection.restore(context, chosen)


def stop_following() -> None:
    """Take the timer off, before the add-on's properties go."""
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)


def _tick() -> float | None:
    if editor() is None:
        return None
    follow(bpy.context)
    return INTERVAL_S
