"""What the 3D views show: nothing in the way, maps as they are, the view given back."""

import bpy
import pytest
from blender.checkout import load

scene = load("bsface_addon.scene")
editor = load("bsface_addon.landmark_editor")
cameras = load("bsface_addon.cameras")


@pytest.fixture
def face(addon, solved, tmp_path):
    """A face made by the operator."""
    bpy.ops.bsface.reconstruct(directory=str(tmp_path / "photos"), name="Ann")
    return bpy.context.scene.bsface.face


def cube(size):
    bpy.ops.mesh.primitive_cube_add(size=size)
    return bpy.context.object


def test_only_what_surrounds_the_face_is_hidden(face):
    around, small = cube(2.0), cube(0.001)
    beside = cube(2.0)
    beside.location.x = 5
    scene.select_only(bpy.context, face)
    assert scene.surrounding(bpy.context, face) == [around]
    bpy.ops.bsface.surroundings_hide()
    assert around.hide_get() and not (small.hide_get() or beside.hide_get())
    assert not around.hide_viewport
    assert scene.surrounding(bpy.context, face) == []


def solid_views():
    return [
        area.spaces.active.shading
        for area in bpy.context.window.screen.areas
        if area.type == "VIEW_3D"
    ]


def test_maps_without_light_and_back(face):
    views = solid_views()
    if not views:
        pytest.skip("this build of Blender has no 3D view")
    for shading in views:
        shading.type, shading.light = "SOLID", "MATCAP"
    for kind in ("NORMALS", "NORMALS"):
        bpy.ops.bsface.surface_map(kind=kind)
        assert {s.light for s in views} == {"FLAT"}
        assert {s.color_type for s in views} == {"TEXTURE"}
    bpy.ops.bsface.surface_map(kind="PLAIN")
    assert {s.light for s in views} == {"MATCAP"}


def test_the_landmark_editor_gives_the_view_back(face):
    views = list(cameras.views(bpy.context))
    if not views:
        pytest.skip("this build of Blender has no 3D view")
    for view in views:
        view.view_perspective = "PERSP"
        view.view_distance, view.view_location = 3.0, (1, 2, 3)
        view.view_rotation = (0.5, 0.5, 0.5, 0.5)
    bpy.ops.bsface.landmarks_edit()
    for view in views:
        assert view.view_perspective == "CAMERA"
        # As Blender does when it draws through the camera.
        view.view_rotation, view.view_distance = (1, 0, 0, 0), 7.0
    bpy.ops.bsface.landmarks_done()
    for view in views:
        assert view.view_perspective == "PERSP"
        assert view.view_distance == pytest.approx(3)
        assert list(view.view_location) == pytest.approx([1, 2, 3])
        assert list(view.view_rotation) == pytest.approx([0.5] * 4)
