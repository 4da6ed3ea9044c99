"""Cameras and suns outlive the next run; what the user hung on them outlives all."""

import bpy
import numpy as np
import pytest
from blender.checkout import load

cameras = load("bsface_addon.cameras")
lights = load("bsface_addon.lights")
rig = load("bsface_addon.rig")


def linked(name, data=None, parent=None):
    obj = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(obj)
    obj.parent = parent
    return obj


def copied(obj, name):
    """As by Shift D: with data of its own."""
    copy = obj.copy()
    copy.name, copy.data = name, obj.data.copy()
    bpy.context.scene.collection.objects.link(copy)
    return copy


@pytest.mark.parametrize("noted", [True, False])
def test_a_new_run_renews_the_cameras_that_are_there(face, noted):
    view, sun = cameras.of_face(face)[1], lights.of_face(face)[1]
    if not noted:  # a file of before
        rig.find(face).pop(rig.MADE)
    scene = bpy.context.scene
    marker = scene.timeline_markers.new("shot", frame=1)
    marker.camera = view
    lamp = linked("lamp", parent=view)
    target = linked("card").constraints.new("TRACK_TO")
    target.target = view
    copy, sun_copy = copied(view, "mine"), copied(sun, "my sun")
    copy.data.lens, sun_copy.data.energy = 123.0, 7.0
    view.data.dof.use_dof, view["note"], view.data.clip_end = True, "hero", 77
    shots = bpy.data.collections.new("shots")
    scene.collection.children.link(shots)
    shots.objects.link(view)
    view.location.x += 1  # a run puts it back
    place = view.matrix_basis.copy()
    bpy.ops.bsface.reconstruct()
    assert cameras.of_face(face)[1] == view and lights.of_face(face)[1] == sun
    assert marker.camera == view == target.target == lamp.parent
    assert view.matrix_basis.translation.x == pytest.approx(
        place.translation.x - 1, abs=1e-6
    )
    assert view.data.dof.use_dof and view["note"] == "hero"
    assert view.data.clip_end == 77 and shots.objects[:] == [view]
    assert copy.name == "mine" and copy.data.lens == 123
    assert sun_copy.name == "my sun" and sun_copy.data.energy == 7
    assert len(cameras.of_face(face)) == len(lights.of_face(face)) == 3
    # A second time too, with the copy as the scene's own camera.
    scene.camera = copy
    bpy.ops.bsface.reconstruct()
    assert cameras.of_face(face)[1] == view and scene.camera == copy
    scene.render.resolution_x = 1920
    bpy.ops.bsface.view_photo()
    bpy.ops.bsface.view_leave()
    assert scene.camera == copy and scene.render.resolution_x == 1920


def test_removing_a_face_leaves_what_is_the_users(face):
    view, empty = cameras.of_face(face)[1], rig.find(face)
    copy = copied(view, "mine")
    hung = [
        linked(name, None, parent)
        for name, parent in (("lamp", view), ("hat", empty), ("glasses", face))
    ]
    for obj in hung:
        obj.location = (0.1, 0.2, 0.3)
    own = bpy.data.collections.new("BSface props")
    bpy.context.scene.collection.children.link(own)
    own.objects.link(face)
    bpy.context.view_layer.update()
    places = [np.array(obj.matrix_world) for obj in (*hung, copy)]
    bpy.ops.bsface.face_remove()
    names = {"lamp", "hat", "glasses", "mine"}
    assert set(bpy.data.objects.keys()) == names
    assert bpy.data.collections.keys() == ["BSface props"]
    bpy.context.view_layer.update()
    for obj, place in zip((*hung, copy), places, strict=True):
        assert obj.parent is None
        np.testing.assert_allclose(obj.matrix_world, place, atol=1e-6)
