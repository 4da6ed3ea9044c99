"""A reconstruction in the Blender scene: face, cameras, lights, material.

Everything is made on the main thread in one go (`place`), and either all of it
stands or nothing has changed (`all_or_nothing`).
"""

from __future__ import annotations

import contextlib
import json
import math
from pathlib import Path

import bpy
from mathutils import Quaternion, Vector

from ..core.errors import ReconstructionError
from ..core.json_text import to_json
from . import (
    cameras,
    face_file,
    lights,
    material,
    messages,
    photo_expression,
    rig,
    surface_object,
)

# Custom properties of the face object; JSON texts, so that they read the same in
# every version and outside Blender.
MARK = "bsface"
SETTINGS = "bsface_settings"
REPORT = "bsface_report"
PHOTOS = "bsface_photos"
WARNINGS = "bsface_warnings"
# On the window manager: light of the solid views before a map was shown.
LIGHT = "bsface_light"
# Blender's light for painting; its default light leaves a skin dark.
SKIN_LIGHT = ("STUDIO", "paint.sl")
FRONT_VIEW = Quaternion((math.sqrt(0.5), math.sqrt(0.5), 0, 0))
_KINDS = (
    "objects",
    "curves",
    "cameras",
    "lights",
    "materials",
    "images",
    "collections",
    "meshes",
    "shape_keys",
    "texts",
)


def place(context, result, name, *, face=None, scale=1.0, maps=None):
    """Put a reconstruction into the scene.

    Parameters
    ----------
    result : core Reconstruction
    name : str
        Name of a new face; its collection is called ``BSface <name>``.
    face : bpy.types.Object, optional
        A face made earlier: it is updated in place (its own name, matrix and
        materials stay) and its cameras and lights are replaced.
    scale : float
        Size of a new face; 1 is life size.
    maps : dict of maps.Map, optional
        Pictures for the surface by kind.

    Returns
    -------
    bpy.types.Object
        The face: active, the only selected object, in object mode.
    """
    with all_or_nothing(context):
        points = result.surface.control_points
        leave_edit_mode(context)
        old = [] if face is None else [*cameras.of_face(face), *lights.of_face(face)]
        fresh = face is None
        if fresh:
            face = surface_object.create(context, name, points, scale)
            face[MARK] = True
            own = _collection(context, face)
            _move(face, own)
        else:
            own = _home(context, face)
        context.view_layer.update()
        rig.ensure(face, own)
        _add_cameras(face, result, own)
        _add_lights(face, result, own)
        for kind, found in (maps or {}).items():
            material.store_map(face, kind, found.pixels, found.legend)
        if fresh or material.shown(face) == "PLAIN":
            material.show(face, "SKIN" if maps and "SKIN" in maps else "PLAIN")
        _write_facts(face, result)
        if not fresh:
            surface_object.write(context, face, points)
            _replace(context, face, old)
        select_only(context, face)
    return face


def faces(context):
    """Faces of the scene that this add-on made, by name."""
    found = [obj for obj in context.scene.objects if is_face(obj)]
    return sorted(found, key=lambda obj: obj.name)


def is_face(obj):
    """Whether the object is a face that `place` made and that is still a surface."""
    return obj is not None and bool(obj.get(MARK)) and surface_object.is_surface(obj)


def photo_files(face: bpy.types.Object) -> tuple[Path, ...]:
    """Files of the photos that shaped a face, as far as they are still there.

    Raises
    ------
    ReconstructionError
        None is.
    """
    paths = (Path(row["path"]) for row in stored(face, PHOTOS, []) if row["path"])
    found = tuple(path for path in paths if path.is_file())
    if not found:
        raise ReconstructionError(messages.NO_SUCH_FILES.format(name=face.name))
    return found


def active_face(context):
    """The face that the buttons mean: the active one, or the scene's latest."""
    active = context.view_layer.objects.active
    if is_face(active):
        return active
    home = None if active is None else rig.face_of(active)
    if is_face(home):
        return home
    chosen = getattr(context.scene, "bsface", None)
    if chosen is None or not is_face(chosen.face):
        return None
    # The property keeps a deleted object alive outside the scene.
    return chosen.face if chosen.face.name in context.scene.objects else None


def stored(face, key, default):
    """A JSON fact of a face."""
    try:
        return json.loads(face[key])
    except (KeyError, TypeError, ValueError):
        return default


@contextlib.contextmanager
def all_or_nothing(context):
    """On an exception: new data goes, active object, selection and mode come back."""
    before = {kind: {d.session_uid for d in getattr(bpy.data, kind)} for kind in _KINDS}
    layer = context.view_layer
    active = layer.objects.active
    mode = "OBJECT" if active is None else active.mode
    chosen = [obj for obj in layer.objects if obj.select_get()]
    camera = context.scene.camera
    try:
        yield
    except BaseException:
        leave_edit_mode(context)
        bpy.data.batch_remove(
            [
                data
                for kind in _KINDS
                for data in getattr(bpy.data, kind)
                if data.session_uid not in before[kind]
            ]
        )
        context.scene.camera = camera
        layer.update()
        for obj in layer.objects:
            obj.select_set(obj in chosen)
        layer.objects.active = active
        if active is not None and active.mode != mode:
            bpy.ops.object.mode_set(mode=mode)
        raise


def leave_edit_mode(context):
    """Go to object mode, whatever is edited."""
    active = context.view_layer.objects.active
    if active is not None and active.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")


def remove_face(context, face):
    """Delete a face with its cameras, lights and what only they use."""
    home = _home(context, face)
    if context.scene.camera in cameras.of_face(face):
        cameras.leave_views(context)
    images = [
        slot.image
        for obj in cameras.of_face(face)
        for slot in obj.data.background_images
        if slot.image is not None
    ]
    _remove([*cameras.of_face(face), *lights.of_face(face)])
    empty = rig.find(face)
    if empty is not None:
        bpy.data.objects.remove(empty)
    curve = face.data
    bpy.data.objects.remove(face)
    if curve.users == 0:
        bpy.data.curves.remove(curve)
    for collection in [*home.children, home]:
        if not collection.all_objects and collection != context.scene.collection:
            bpy.data.collections.remove(collection)
    bpy.data.batch_remove([image for image in set(images) if image.users == 0])


def _add_cameras(face, result, own):
    if not result.cameras:
        return
    group = _child_collection(own, "cameras")
    for camera, photo in zip(result.cameras, result.photos, strict=True):
        cameras.add(face, f"{face.name} {photo.name}", camera, photo, group)


def _add_lights(face, result, own):
    if result.photometric is None:
        return
    group = _child_collection(own, "lights")
    found = zip(result.photometric.lights, result.photos, strict=True)
    for coefficients, photo in found:
        name = f"{face.name} light {photo.name}"
        lights.add(face, name, coefficients, photo.name, group)


def _write_facts(face, result):
    face[SETTINGS] = to_json(result.settings.to_dict())
    face[REPORT] = to_json(list(result.reports))
    face[WARNINGS] = to_json(list(result.warnings))
    face[PHOTOS] = to_json(
        [{"name": p.name, "path": p.path, "size": p.size} for p in result.photos]
    )
    face_file.keep(face, result)
    photo_expression.keep(face, result)


def _collection(context, face):
    collection = bpy.data.collections.new(f"BSface {face.name}")
    context.scene.collection.children.link(collection)
    return collection


def _home(context, face):
    for collection in face.users_collection:
        return collection
    return context.scene.collection


def _child_collection(own, what):
    for child in own.children:
        if child.get(MARK) == what:
            return child
    child = bpy.data.collections.new(f"{own.name} {what}")
    child[MARK] = what
    own.children.link(child)
    return child


def _replace(context, face, old):
    """Let the new cameras and lights take the places of the old ones."""
    key = cameras.PHOTO_KEY
    names = {obj: (obj.type, obj[key]) for obj in old}
    through = names.get(context.scene.camera)
    found = [*cameras.of_face(face), *lights.of_face(face)]
    new = {(obj.type, obj[key]): obj for obj in found if obj not in names}
    for obj, name in names.items():
        if name in new:
            cameras.keep_state(obj, new[name])
    if through is not None and through not in new:
        cameras.leave_views(context)
    _remove(old)
    if through in new:
        context.scene.camera = new[through]
        photo_expression.show(face, through[1])
    else:
        photo_expression.hide(face)
    for obj in new.values():
        obj.name = obj.data.name = _child_name(face, obj)


def _move(obj, collection):
    for other in obj.users_collection:
        other.objects.unlink(obj)
    collection.objects.link(obj)


def _child_name(face, obj):
    middle = " light " if obj.type == "LIGHT" else " "
    return f"{face.name}{middle}{obj[cameras.PHOTO_KEY]}"


def _remove(objects):
    data = [obj.data for obj in objects]
    bpy.data.batch_remove(objects)
    bpy.data.batch_remove([d for d in data if d.users == 0])


def select_only(context, face):
    """Make the face the active and only selected object, and visible."""
    context.view_layer.update()
    face.hide_viewport = False
    face.hide_set(False)
    for obj in context.view_layer.objects:
        obj.select_set(obj == face)
    context.view_layer.objects.active = face


def surrounding(context, face):
    """Visible objects that the face stands inside of, such as a new file's cube.

    They hide the photos behind the cameras; only the user may take them away.
    """
    middle = _middle(face)
    found = []
    for obj in context.visible_objects:
        if obj == face or obj.type not in ("MESH", "SURFACE", "CURVE", "META", "FONT"):
            continue
        corners = [obj.matrix_world @ Vector(corner) for corner in obj.bound_box]
        if all(
            min(c[axis] for c in corners) < middle[axis] < max(c[axis] for c in corners)
            for axis in range(3)
        ) and not is_face(obj):
            found.append(obj)
    return found


def _middle(obj):
    corners = [obj.matrix_world @ Vector(corner) for corner in obj.bound_box]
    return sum(corners, Vector()) / len(corners)


def show(context, face):
    """Bring a new face and its texture into sight in the window's 3D views."""
    light_views(context, material.shown(face))
    for area in context.window.screen.areas:
        if area.type != "VIEW_3D":
            continue
        view = area.spaces.active.region_3d
        frame = surface_object.world_frame(face)
        view.view_rotation = frame.to_quaternion()
        if view.view_perspective == "CAMERA":
            view.view_perspective = "PERSP"
        region = next(r for r in area.regions if r.type == "WINDOW")
        with context.temp_override(area=area, region=region):
            bpy.ops.view3d.view_selected()


def light_views(context, kind):
    """Let a map show in solid views: the skin bright, measured values as they are.

    The light that a view had comes back with "PLAIN".
    """
    manager = context.window_manager
    for area in context.window.screen.areas if context.window else ():
        if area.type != "VIEW_3D" or area.spaces.active.shading.type != "SOLID":
            continue
        shading = area.spaces.active.shading
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


def present(context, face):
    """Make a new file ready to look at: view, light of the world, scene camera."""
    world = context.scene.world or bpy.data.worlds.new("World")
    context.scene.world = world
    world.color = (0.6, 0.6, 0.6)
    corners = [face.matrix_world @ Vector(corner) for corner in face.bound_box]
    middle = sum(corners, Vector()) / len(corners)
    extent = max((corner - middle).length for corner in corners)
    for screen in bpy.data.screens:
        for area in screen.areas:
            if area.type == "VIEW_3D":
                space = area.spaces.active
                space.region_3d.view_location = middle
                space.region_3d.view_distance = 3 * extent
                space.region_3d.view_rotation = FRONT_VIEW
                space.shading.color_type = "TEXTURE"
                _light(space.shading, *SKIN_LIGHT)
    views = cameras.of_face(face)
    if views:
        # The most frontal photo: its camera's axis is nearest to the face's own.
        look = surface_object.world_frame(face).col[2].xyz
        frontal = max(views, key=lambda view: view.matrix_world.col[2].xyz @ look)
        cameras.look_through(context, frontal, switch_views=False)
