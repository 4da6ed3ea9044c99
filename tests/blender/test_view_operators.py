"""Operators that show: maps, trimmed views, photos, cameras, lights."""

import bpy
import numpy as np
import pytest
from blender import faces
from blender.checkout import load

cameras = load("bsface_addon.cameras")
lights = load("bsface_addon.lights")
material = load("bsface_addon.material")


def test_maps(face):
    for kind in ("NORMALS", "PLAIN"):
        bpy.ops.bsface.surface_map(kind=kind)
        assert material.shown(face) == kind
    with pytest.raises(RuntimeError, match="no residual map"):
        bpy.ops.bsface.surface_map(kind="RESIDUAL")


def test_texture_is_saved_with_the_forehead_on_top(face, tmp_path):
    cv2 = pytest.importorskip("cv2")
    picture = np.zeros((8, 6, 3), np.uint8)
    picture[0] = (250, 20, 10)
    square = np.array([[-1, -1], [2, -1], [2, 2], [-1, 2]], float)
    painted = load("bsface_addon.maps").painted(picture, square)
    material.store_map(face, "PHOTO", painted)
    with pytest.raises(RuntimeError, match="No picture"):
        bpy.ops.bsface.texture_save(filepath=str(tmp_path / "a.png"))
    bpy.ops.bsface.surface_map(kind="PHOTO")
    bpy.ops.bsface.texture_save(filepath=str(tmp_path / "a.png"))
    saved = cv2.imread(str(tmp_path / "a.png"))[..., ::-1]
    np.testing.assert_allclose(saved, picture, atol=1)


def test_the_view_is_trimmed_to_the_outline_or_whole(face):
    assert material.is_trimmed(face)
    for trim, alpha in ((False, 1.0), (True, 0.0)):
        bpy.ops.bsface.surface_trim(trim=trim)
        bpy.ops.bsface.surface_map(kind="NORMALS")
        image = material.stored_map(face, "NORMALS")
        pixels = np.empty(4 * image.size[0] * image.size[1], np.float32)
        image.pixels.foreach_get(pixels)
        opacity = pixels.reshape(*image.size, 4)[..., 3]
        assert opacity[0, 0] == alpha and opacity[256, 256] == 1.0


def test_next_and_previous_photo(face):
    seen = []
    for direction in ("NEXT", "NEXT", "NEXT", "NEXT", "PREVIOUS"):
        bpy.ops.bsface.view_photo(direction=direction)
        seen.append(bpy.context.scene.camera[cameras.PHOTO_KEY])
    assert seen == ["0.png", "1.png", "2.png", "0.png", "2.png"]
    bpy.ops.bsface.view_photo(direction="NAMED", photo="1.png")
    assert bpy.context.scene.bsface.active_photo == 1
    render = bpy.context.scene.render
    assert (render.resolution_x, render.resolution_y) == faces.SIZE
    with pytest.raises(RuntimeError, match="No camera"):
        bpy.ops.bsface.view_photo(direction="NAMED", photo="cat.png")


def test_view_switches(face):
    bpy.ops.bsface.view_front(front=True)
    slot = cameras.of_face(face)[0].data.background_images[0]
    assert slot.display_depth == "FRONT" and slot.alpha == 0.5
    bpy.ops.bsface.view_front(front=False)
    assert slot.display_depth == "BACK" and slot.alpha == 1.0
    bpy.ops.bsface.view_show(show=False)
    assert all(view.hide_viewport for view in cameras.of_face(face))
    assert bpy.ops.bsface.view_leave() == {"FINISHED"}


def test_one_sun_at_a_time(face):
    bpy.ops.bsface.view_photo(direction="NAMED", photo="1.png")
    bpy.ops.bsface.light_show()
    assert [sun.hide_render for sun in lights.of_face(face)] == [True, False, True]
    bpy.ops.bsface.light_show(photo="2.png")
    assert [sun.hide_render for sun in lights.of_face(face)] == [True, True, False]
    bpy.ops.bsface.light_show(show=False)
    assert all(sun.hide_render for sun in lights.of_face(face))
    with pytest.raises(RuntimeError, match="No light"):
        bpy.ops.bsface.light_show(photo="cat.png")
