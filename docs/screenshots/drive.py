"""Play the artist's work in a Blender window and say when to take each picture.

    blender --factory-startup --window-geometry 0 0 1600 1000 --python drive.py

Runs inside Blender with a window (a virtual screen will do).  Whenever the window
shows what a picture of docs/artist_guide.md needs, it prints one line

    SHOOT name left top width height

and stands still for some seconds; whatever watches the output saves the screen as
``name.png``, and `crop.py` cuts the rectangle (pixels of the screen, window at its
corner) out of it.  The extension is taken from this checkout unless it is installed.
OpenCV, SciPy and the face models must be there for Blender's Python.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import time
import traceback
from pathlib import Path

import addon_utils
import bpy
from mathutils import Quaternion

ROOT = Path(__file__).resolve().parents[2]
EXTENSION = "bl_ext.user_default.bsface"
# Every second example is enough for pictures of the user interface.
EVERY = 2
STILL_S = 3.5
# The view from a third to the side.
TURNED = Quaternion((0.67, 0.67, 0.23, 0.23))
LIMIT_S = 1800.0
# Only these pictures (names separated by commas); all where it is empty.
ONLY = set(filter(None, os.environ.get("BSFACE_PICTURES", "").split(",")))

steps = []
bpy.context.preferences.view.show_splash = False


def step(wait=1.5):
    """Queue a function; ``wait`` seconds for the redraw after it.

    A function that returns a number is called again after so many seconds.
    """

    def keep(function):
        steps.append((function, wait))
        return function

    return keep


def picture(name, *, panels=None, what="area"):
    """Queue a picture of the 3D view, or of these panels alone (``what="panels"``).

    Parameters
    ----------
    panels : sequence of str, optional
        Names of panel classes without their prefix, shown open; the others are
        taken off for the picture. By default all, as the user finds them.
    """
    if ONLY and name not in ONLY:
        return

    @step(2.0)
    def prepare():
        show_panels(panels)

    @step(STILL_S)
    def shoot():
        area, _ = view()
        if what == "panels":
            box = next(r for r in area.regions if r.type == "UI")
        elif what == "window":
            box = bpy.context.window_manager.windows[0]
            print("SHOOT", name, 0, 0, box.width, box.height, flush=True)
            return
        else:
            box = area
        height = bpy.context.window_manager.windows[0].height
        top = height - box.y - box.height
        print("SHOOT", name, box.x, top, box.width, box.height, flush=True)

    @step(0.5)
    def restore():
        if panels is not None:
            show_panels(None)


def view():
    """The 3D view and what operators need to run in it."""
    window = bpy.context.window_manager.windows[0]
    area = next(a for a in window.screen.areas if a.type == "VIEW_3D")
    region = next(r for r in area.regions if r.type == "WINDOW")
    return area, {"window": window, "area": area, "region": region}


def call(name, how="EXEC_DEFAULT", **properties):
    """Run an operator of the extension in the 3D view."""
    with bpy.context.temp_override(**view()[1]):
        answer = getattr(bpy.ops.bsface, name)(how, **properties)
    print("CALL", name, *answer, flush=True)


def module(name):
    return sys.modules[f"{EXTENSION}.bsface_addon.{name}"]


def show_panels(names):
    """Register these panels only, open, or all as they are for the user."""
    classes = (*module("photo_panels").CLASSES, *module("panels").CLASSES)
    classes = [c for c in classes if issubclass(c, bpy.types.Panel)]
    for cls in [*opened, *reversed(classes)]:
        if cls.is_registered:
            bpy.utils.unregister_class(cls)
    for cls in classes:
        if names is None:
            bpy.utils.register_class(cls)
        elif cls.__name__.removeprefix("BSFACE_PT_") in names:
            # Blender remembers by name which panels are closed.
            own = {"bl_options": set()}
            if hasattr(cls, "bl_parent_id"):
                own["bl_parent_id"] = ""
            opened.append(type(f"{cls.__name__}_open", (cls,), own))
            bpy.utils.register_class(opened[-1])
    view()[0].tag_redraw()


# Kept to the end: the sidebar may still hold them.
opened = []


def running():
    return module("session").running() is not None


def state():
    return bpy.context.scene.bsface


def smile(obj):
    """Jaw and a corner of the mouth of a mesh."""
    blocks = obj.data.shape_keys.key_blocks
    blocks["jawOpen"].value, blocks["mouthSmileLeft"].value = 0.6, 0.8


def facts(what, obj):
    """Print what the guide says of a mesh."""
    bpy.context.view_layer.update()
    keys = len(obj.data.shape_keys.key_blocks) - 1
    materials = ", ".join(material.name for material in obj.data.materials)
    size = " x ".join(f"{1000 * side:.0f}" for side in obj.dimensions)
    print(
        f"FACT {what}: {obj.name!r}, {len(obj.data.polygons)} faces, {keys} keys, "
        f"materials {materials}, {size} mm",
        flush=True,
    )


def make_photos():
    """Every second example, and four photos that are of no use, in a new folder."""
    import cv2
    import numpy as np

    folder = Path(tempfile.mkdtemp()) / "Portrait"
    folder.mkdir()
    photos = sorted((ROOT / "examples" / "photos").glob("*.jpg"))[::EVERY]
    for path in photos:
        shutil.copy(path, folder)
    first = cv2.imread(str(photos[1]))
    noise = np.random.default_rng(1).normal(128, 20, first.shape)
    for name, pixels in (
        ("dark.jpg", first // 60),
        ("blurred.jpg", cv2.GaussianBlur(first, (0, 0), first.shape[0] / 40)),
        ("landscape.jpg", cv2.GaussianBlur(noise, (0, 0), 9)),
    ):
        cv2.imwrite(str(folder / name), pixels)
    shutil.copy(photos[0], folder / "copy of the first.jpg")
    return folder


@step(2.0)
def enable():
    if not addon_utils.check(EXTENSION)[1]:
        home = Path(bpy.utils.user_resource("EXTENSIONS", path="user_default"))
        home.mkdir(parents=True, exist_ok=True)
        if not (home / "bsface").exists():
            (home / "bsface").symlink_to(ROOT)
        addon_utils.extensions_refresh(
            ensure_wheels=False, addon_modules_pending=[EXTENSION]
        )
        addon_utils.enable(EXTENSION)
    view()[0].spaces.active.show_region_ui = True


@step(1.5)
def tab():
    side = next(r for r in view()[0].regions if r.type == "UI")
    side.active_panel_category = "BSface"


picture("artist_empty")


@step()
def add():
    call("photos_add", directory=str(make_photos()))


@step()
def detect():
    call("landmarks_detect", "INVOKE_DEFAULT")


@step()
def detected():
    if running():
        return 0.5
    rows = [row.name for row in state().photos]
    state().active_photo = rows.index("landscape.jpg")
    return None


picture("artist_photos", panels=("photos", "landmarks"), what="panels")


@step(3.0)
def edit():
    state().active_photo = 1
    call("landmarks_edit")


picture("artist_landmarks")


@step()
def edited():
    call("landmarks_done")


@step(1.0)
def start():
    call("reconstruct", "INVOKE_DEFAULT")


@step(0.5)
def under_way():
    job = module("session").running()
    return None if job is None or job.fraction > 0.3 else 0.3


picture("artist_running", what="window")


@step(2.0)
def finished():
    return 1.0 if running() else None


@step(3.0)
def hide():
    call("surroundings_hide")


picture("artist_finished")


@step(3.0)
def net():
    call("surface_net")


picture("artist_net", panels=("surface",))


@step(3.0)
def net_done():
    call("surface_net")


for kind in ("PLAIN", "SKIN", "PHOTO", "NORMALS", "RESIDUAL", "DEVIATION"):

    @step(2.0)
    def paint(kind=kind):
        call("surface_map", kind=kind)

    picture(f"map_{kind.lower()}", panels=("texture",))

picture("artist_texture", panels=("texture",), what="panels")


@step(2.0)
def skin():
    call("surface_map", kind="SKIN")


@step(3.0)
def look():
    names = [row.name for row in state().photos if row.status == "used"]
    call("view_photo", direction="NAMED", photo=names[len(names) // 3])


picture("artist_camera", panels=("views",))


@step(3.0)
def before():
    call("view_front", front=True)


picture("artist_camera_front", panels=("views",))


@step(3.0)
def skin_mask():
    call("view_front", front=False)
    call("skin_show")


picture("artist_skin", panels=("photos",))


@step(1.0)
def mask():
    call("skin_show", show=False)
    call("mask_edit", "INVOKE_DEFAULT", photo=bpy.context.scene.camera["bsface_photo"])


@step(3.0)  # a stroke needs a view that was drawn
def mask_open():
    return 0.5 if running() else None


@step(40.0)  # until the shaders are there
def strokes():
    area, where = view()
    region = where["region"]
    # A hand's width of paint beside the eyes, and a spot of skin in the hair.
    across, down = region.width / 2, region.height
    for kind, points in (
        ("OTHER", [(across - 90 + i, 0.47 * down + i / 3) for i in range(0, 180, 6)]),
        ("SKIN", [(across - 30 + i, 0.86 * down) for i in range(0, 60, 6)]),
    ):
        call("mask_brush", kind=kind)
        path = [
            {
                "name": "",
                "location": (0, 0, 0),
                "mouse": point,
                "mouse_event": point,
                "pressure": 1.0,
                "size": 20.0,
                "x_tilt": 0.0,
                "y_tilt": 0.0,
                "time": 0.0,
                "is_start": number == 0,
            }
            for number, point in enumerate(points)
        ]
        with bpy.context.temp_override(**where):
            bpy.ops.paint.image_paint(stroke=path)


picture("artist_mask")


@step(2.0)
def leave():
    call("mask_done", keep=False)
    call("view_leave")


@step()
def one_side():
    for row in state().photos:
        row.use = row.status == "used" and row.yaw < 10
    call("landmarks_detect", "INVOKE_DEFAULT")


@step(1.0)
def one_side_found():
    return 0.5 if running() else None


picture("artist_hint", panels=("photos",), what="panels")


@step()
def all_sides():
    for row in state().photos:
        row.use = True
        if row.status == "ignored":
            row.status = "found"
    state().hints = ""


picture("artist_settings", panels=("reconstruct", "settings"), what="panels")
picture("artist_export", panels=("export",), what="panels")


@step()
def words():
    rows = [row for row in state().photos if row.status in ("used", "found")]
    for row in rows[::3]:
        row.expression = "Smile"
    state().settings.method = "motion"
    state().active_photo = list(state().photos).index(rows[0])


@step()
def key():
    call("expression_key", "INVOKE_DEFAULT", expression="Smile")


@step(1.0)
def keyed():
    return 0.5 if running() else None


picture("artist_expressions", panels=("expressions",), what="panels")


@step(2.0)
def all_photos():
    for row in state().photos:
        row.expression = ""
    call("view_leave")
    with bpy.context.temp_override(**view()[1]):
        face = state().face
        while face.data.shape_keys:
            face.shape_key_remove(face.data.shape_keys.key_blocks[-1])


@step(3.0)
def coarse():
    call("coarse_edit")
    net = module("coarse_editor").editor()
    area, where = view()
    with bpy.context.temp_override(**where):
        bpy.ops.curve.select_all(action="DESELECT")
        bpy.ops.object.mode_set(mode="OBJECT")
        # The tip of the nose: the point of the middle that stands out most.
        points = net.data.splines[0].points
        middle = [p for p in points if abs(p.co.x) < 0.02 and abs(p.co.z) < 0.05]
        min(middle, key=lambda p: p.co.y).select = True
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.transform.translate(value=(0, -0.012, 0))


@step(2.0)
def turn():
    view()[0].spaces.active.region_3d.view_rotation = TURNED


picture("artist_coarse", panels=("surface",))


@step()
def keys():
    call("coarse_done")
    call("arkit_keys", "INVOKE_DEFAULT")


@step(2.0)
def with_keys():
    if running():
        return 0.5
    blocks = state().face.data.shape_keys.key_blocks
    print("FACT keys on the surface:", len(blocks) - 1, flush=True)
    blocks["jawOpen"].value, blocks["mouthSmileLeft"].value = 0.6, 0.8
    state().face.active_shape_key_index = blocks.find("jawOpen")
    return None


picture("artist_keys", panels=("expressions",))


@step()
def mesh():
    for block in state().face.data.shape_keys.key_blocks:
        block.value = 0.0
    call("surface_to_mesh", "INVOKE_DEFAULT")


@step(3.0)
def meshed():
    if running():
        return 0.5
    made = bpy.data.objects[f"{state().face.name} mesh"]
    state().face.hide_set(True)
    facts("mesh", made)
    smile(made)
    return None


picture("artist_mesh")


@step()
def written():
    state().face.hide_set(False)
    call("export", filepath=str(Path(tempfile.gettempdir()) / "Portrait.glb"))


@step(3.0)
def empty_file():
    if running():
        return 0.5
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return None


@step(40.0)  # until the shaders are there
def opened_again():
    with bpy.context.temp_override(**view()[1]):
        bpy.ops.import_scene.gltf(
            filepath=str(Path(tempfile.gettempdir()) / "Portrait.glb")
        )
    made = next(obj for obj in bpy.data.objects if obj.type == "MESH")
    facts("GLB", made)
    smile(made)
    area, where = view()
    area.spaces.active.shading.type = "MATERIAL"
    area.spaces.active.show_region_ui = False
    area.spaces.active.region_3d.view_rotation = TURNED
    with bpy.context.temp_override(**where):
        bpy.ops.view3d.view_all()


picture("artist_glb")


@step()
def new_file():
    bpy.ops.wm.read_homefile(use_factory_startup=True)


@step(1.5)  # a sidebar of a view that was not drawn yet crashes Blender 5.2
def sidebar_again():
    view()[0].spaces.active.show_region_ui = True


@step(1.5)
def tab_again():
    tab()
    call("photos_add", directory=str(make_photos()))


@step()
def fail():
    # A sentence as the core says it, made by a run on a photo without a face.
    for row in state().photos:
        row.use = row.name == "landscape.jpg"
    call("reconstruct", "INVOKE_DEFAULT")


@step(1.0)
def failed():
    return 0.5 if running() else None


picture("artist_help", panels=("support",), what="panels")

position = {"at": 0, "since": time.monotonic()}


def play():
    if position["at"] >= len(steps) or time.monotonic() - position["since"] > LIMIT_S:
        bpy.ops.wm.quit_blender()
        return None
    function, wait = steps[position["at"]]
    try:
        again = function()
    except Exception:
        traceback.print_exc()
        sys.stderr.flush()
        bpy.ops.wm.quit_blender()
        return None
    if again:
        return again
    position["at"] += 1
    return wait


bpy.app.timers.register(play, first_interval=2.0, persistent=True)
