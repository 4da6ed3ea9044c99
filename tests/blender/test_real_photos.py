"""The real thing on a few photos: first run, edit, refit; no fakes."""

import dataclasses

import bpy
import numpy as np
import pytest
from blender.checkout import load
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

scene = load("bsface_addon.scene")
camera_views = load("bsface_addon.camera_views")
cameras = load("bsface_addon.cameras")
face_file = load("bsface_addon.face_file")
material = load("bsface_addon.material")
photo_list = load("bsface_addon.photo_list")
coordinates = load("bsface_addon.coordinates")
surface_object = load("bsface_addon.surface_object")


@pytest.fixture
def photos(tmp_path, example_photos):
    """Five of the example photos."""
    return str(example_photos(tmp_path, range(0, 40, 8)))


def reprojection(face):
    """Median way from detected landmarks to the surface in Blender's camera views.

    Over all photos and the landmarks that the camera sees, in % of the eye distance.
    """
    template = load("core.surface.template").load_template()
    surface, saved = face_file.surface(face), face_file.saved(face)
    uv = template.landmark_uv
    world = [coordinates.world_frame(face) @ Vector(q) for q in surface.evaluate(*uv.T)]
    normals = surface.normals(*uv.T)
    rows = {row.name: row for row in bpy.context.scene.bsface.photos}
    ways = []
    views = {view[cameras.PHOTO_KEY]: view for view in cameras.of_face(face)}
    for photo, core in zip(saved.photos, saved.cameras, strict=True):
        name = photo.name
        camera_views.look_through(bpy.context, views[name])
        bpy.context.view_layer.update()
        width, height = views[name][cameras.SIZE_KEY]
        at = [world_to_camera_view(bpy.context.scene, views[name], q) for q in world]
        pixels = [(p.x * width - 0.5, (1 - p.y) * height - 0.5) for p in at]
        facing = (core.toward(surface.evaluate(*uv.T)) * normals).sum(1) > 0.1
        way = np.array(pixels) - photo_list.landmarks(rows[name]).points
        size = np.linalg.norm(way, axis=1) / (core.s * 62.0)
        ways.append(size[facing & template.landmark_reliable])
    return 100 * float(np.median(np.concatenate(ways)))


def test_reconstruct_edit_and_refit(addon, photos):
    bpy.context.scene.bsface.texture_size = "512"
    settings = '{"method": "motion"}'
    bpy.ops.bsface.reconstruct(
        directory=photos, settings=settings, control_points_u=20, control_points_v=22
    )
    state = bpy.context.scene.bsface
    face = state.face
    assert [row.status for row in state.photos] == ["used"] * 5
    assert all(row.landmarks for row in state.photos)
    assert len(cameras.of_face(face)) == 5
    assert {"SKIN", "PHOTO", "NORMALS"} <= set(material.stored_kinds(face))
    assert reprojection(face) < 2.0
    width = np.ptp(surface_object.read(face)[..., 0])
    assert 120 < width < 260
    # The artist pulls one control point out by 4 mm and refits.
    first = surface_object.read(face)
    edited = first.copy()
    edited[10, 12, 2] += 4
    surface_object.write(bpy.context, face, edited)
    state.settings.method = "motion"
    bpy.ops.bsface.surface_refit(softness=0)
    assert state.face == face
    second = surface_object.read(face)
    np.testing.assert_allclose(second[10, 12], edited[10, 12], atol=0.05)
    # The rest is about where it was: the evidence has not changed.
    away = np.linalg.norm(second - first, axis=2)[4:-4, 4:-4]
    assert np.median(away) < 1.0


def test_detection_alone_gives_landmarks_and_hints(addon, photos):
    bpy.ops.bsface.photos_add(directory=photos)
    assert bpy.ops.bsface.landmarks_detect() == {"FINISHED"}
    state = bpy.context.scene.bsface
    assert [row.status for row in state.photos] == ["found"] * 5
    assert all(row.faces == 1 for row in state.photos)
    assert all(line.endswith(".") for line in state.hints.splitlines())


def test_photos_are_read_once_for_two_runs(addon, photos):
    """Another setting reads nothing again; a moved landmark or a new file does."""
    solving, request = load("bsface_addon.solving"), load("bsface_addon.request")
    bpy.ops.bsface.photos_add(directory=photos)
    state = bpy.context.scene.bsface
    state.texture_size = "512"
    solver = solving.Solver()

    def run(**changes):
        read = []

        def progress(step):
            if step.stage == "landmarks":
                read.append(step)

        quick = {"method": "motion", "control_points": (12, 12), **changes}
        asked = request.from_panel(state, None, "", quick)
        found = solver.solve(asked, progress)
        result = found.result
        photo_list.take_landmarks(state, result.landmarks, found.landmarks)
        return bool(read), result

    first = run()
    again = run()
    assert first[0] and not again[0]
    np.testing.assert_array_equal(
        first[1].surface.control_points, again[1].surface.control_points
    )
    assert not run(perspective=False)[0]
    row = state.photos[0]
    moved = photo_list.landmarks(row)
    moved.points[5] += 3
    photo_list.keep_landmarks(row, dataclasses.replace(moved, source="hand"))
    assert run()[0] and not run()[0]
    row.use = False
    assert run()[0]
    solver.forget()
    assert run()[0]
