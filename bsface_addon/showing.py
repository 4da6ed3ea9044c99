"""How a face comes into sight: views, their light, what stands in the way."""

from __future__ import annotations

import contextlib
import math

import bpy
from mathutils import Quaternion, Vector

from . import (
    camera_views,
    cameras,
    coordinates,
    material,
    photo_expression,
    skin_overlay,
    view_areas,
)
from .scene import COARSE_OF, MARK

# On the window manager: light of the solid views before a map was shown.
LIGHT = "bsface_light"
# Blender's light for painting; its default light leaves a skin dark.
SKIN_LIGHT = ("STUDIO", "paint.sl")
FRONT_VIEW = Quaternion((math.sqrt(0.5), math.sqrt(0.5), 0, 0))


def surrounding(context, face):
    """Visible objects that the face stands inside of, such as a new file's cube.

    They hide the photos behind the cameras; only the user may take them away.
    """
    middle = _middle(face)
    found = []
    for obj in context.visible_objects:
        if obj.type not in ("MESH", "SURFACE", "CURVE", "META", "FONT"):
            continue
        if MARK in obj or COARSE_OF in obj:
            continue  # a face, its mesh, its coarse net
        corners = [obj.matrix_world @ Vector(corner) for corner in obj.bound_box]
        if all(
            min(c[axis] for c in corners) < middle[axis] < max(c[axis] for c in corners)
            for axis in range(3)
        ):
            found.append(obj)
    return found


def _middle(obj):
    corners = [obj.matrix_world @ Vector(corner) for corner in obj.bound_box]
    return sum(corners, Vector()) / len(corners)


def show(context, face):
    """Bring a new face and its texture into sight in the window's 3D views."""
    light_views(context, material.shown(face))
    for area in view_areas.in_window(context):
        view = area.spaces.active.region_3d
        frame = coordinates.world_frame(face)
        view.view_rotation = frame.to_quaternion()
        if view.view_perspective == "CAMERA":
            view.view_perspective = "PERSP"
        region = next(r for r in area.regions if r.type == "WINDOW")
        with context.temp_override(area=area, region=region):
            bpy.ops.view3d.view_selected()


def look_at_front(context: bpy.types.Context, middle: Vector, extent: float) -> None:
    """Turn the window's 3D views as `look_at`."""
    for area in view_areas.in_window(context):
        view = area.spaces.active.region_3d
        if view.view_perspective == "CAMERA":
            view.view_perspective = "PERSP"
        look_at(view, middle, extent)


def look_at(view: bpy.types.RegionView3D, middle: Vector, extent: float) -> None:
    """Turn a 3D view to the front of what reaches ``extent`` round a point."""
    view.view_location, view.view_distance = middle, 3 * extent
    view.view_rotation = FRONT_VIEW


def light_views(context, kind):
    """Let a map show in solid views: the skin bright, measured values as they are.

    The light that a view had comes back with "PLAIN".
    """
    manager = context.window_manager
    for area in view_areas.in_window(context):
        shading = area.spaces.active.shading
        if shading.type != "SOLID":
            continue
        shading.color_type = "TEXTURE"
        now = (shading.light, shading.studio_light)
        # Another light than these was chosen since, by the user or in another file.
        ours = shading.light == "FLAT" or now == SKIN_LIGHT
        if kind != "PLAIN":
            if LIGHT not in manager or not ours:
                manager[LIGHT] = now
            _light(shading, *(SKIN_LIGHT if material.is_lit(kind) else ("FLAT", "")))
        elif LIGHT in manager and ours:
            _light(shading, *manager[LIGHT])
    if kind == "PLAIN":
        manager.pop(LIGHT, None)


def _light(shading, light, name):
    shading.light = light
    # Which names there are depends on the light, and on what the user has installed.
    with contextlib.suppress(TypeError):
        shading.studio_light = name


def hides_lights(context: bpy.types.Context) -> bool:
    """Whether the view of the panel is in a shading that no sun changes."""
    space = context.space_data
    return getattr(space, "type", "") == "VIEW_3D" and space.shading.type in (
        "SOLID",
        "WIREFRAME",
    )


def photo(
    context: bpy.types.Context, face: bpy.types.Object, view: bpy.types.Object
) -> None:
    """Look through the camera of a photo, at the face with that photo's expression."""
    cameras.find_photo(view)
    camera_views.look_through(context, view)
    photo_expression.show(face, view[cameras.PHOTO_KEY])
    skin_overlay.refresh(context, face)


def present(context, face):
    """Make a new file ready to look at: view, light of the world, scene camera."""
    world = context.scene.world or bpy.data.worlds.new("World")
    context.scene.world = world
    world.color = (0.6, 0.6, 0.6)
    corners = [face.matrix_world @ Vector(corner) for corner in face.bound_box]
    middle = sum(corners, Vector()) / len(corners)
    extent = max((corner - middle).length for corner in corners)
    for area in view_areas.on_screens(bpy.data.screens):
        space = area.spaces.active
        look_at(space.region_3d, middle, extent)
        space.shading.color_type = "TEXTURE"
        _light(space.shading, *SKIN_LIGHT)
    views = cameras.of_face(face)
    if views:
        # The most frontal photo: its camera's axis is nearest to the head's own.
        frontal = max(views, key=lambda view: view.matrix_basis.col[2].z)
        camera_views.look_through(context, frontal, switch_views=False)
