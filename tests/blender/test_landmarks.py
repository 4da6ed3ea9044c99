"""Landmarks: detection, moving them by hand, files."""

import dataclasses
import json

import bpy
import numpy as np
import pytest
from blender import faces
from blender.checkout import load

photo_list = load("bsface_addon.photo_list")
landmark_editor = load("bsface_addon.landmark_editor")
solving = load("bsface_addon.solving")
core_landmarks = load("core.landmarks.landmarks")
errors = load("core.errors")
PhotoCollection = load("core.prepare").PhotoCollection


def some(name, scheme="68", count=68):
    points = np.random.default_rng(1).uniform(20, 140, (count, 2))
    return core_landmarks.Landmarks(name, scheme, points, np.full(count, 0.5), faces=2)


@pytest.fixture
def rows(addon, tmp_path):
    """Three photos; the first has landmarks."""
    faces.photo_files(tmp_path / "photos")
    bpy.ops.bsface.photos_add(directory=str(tmp_path / "photos"))
    rows = bpy.context.scene.bsface.photos
    photo_list.keep_landmarks(rows[0], some("0.png"))
    return rows


def test_rows_keep_landmarks(rows):
    found = photo_list.landmarks(rows[0])
    np.testing.assert_allclose(found.points, some("0.png").points, atol=1e-3)
    assert (found.photo, found.scheme, found.faces) == ("0.png", "68", 2)
    assert photo_list.landmarks(rows[1]) is None


def test_detection_fills_the_rows_and_keeps_hand_work(rows, solver):
    failure = errors.PhotoFailure("2.png", "no_face", "No face was found in 2.png.")
    found = PhotoCollection((), (some("0.png"), some("1.png")), (failure,))
    solver.detection = solving.Detection.of(found, ("Add one from the left.",))
    photo_list.keep_landmarks(rows[1], some("1.png"))
    stored = json.loads(rows[0].landmarks)
    rows[0].landmarks = json.dumps({**stored, "source": "hand"})
    bpy.ops.bsface.landmarks_detect()
    assert list(solver.requests[0].landmarks) == ["0.png"]
    assert bpy.context.scene.bsface.hints == "Add one from the left."
    assert [row.status for row in rows] == ["found", "found", "no_face"]
    assert "2.png" in rows[2].reason
    assert photo_list.landmarks(rows[1]) is not None


def test_editor_shows_each_landmark_on_its_pixel(rows):
    assert bpy.ops.bsface.landmarks_edit(photo="0.png") == {"FINISHED"}
    obj = landmark_editor.editor()
    assert obj.mode == "EDIT" and len(obj.data.vertices) == 68
    from bpy_extras.object_utils import world_to_camera_view

    scene = bpy.context.scene
    bpy.context.view_layer.update()
    width, height = faces.SIZE
    obj.update_from_editmode()
    for vertex, expected in zip(
        obj.data.vertices, photo_list.landmarks(rows[0]).points, strict=True
    ):
        seen = world_to_camera_view(scene, scene.camera, obj.matrix_world @ vertex.co)
        pixel = (seen.x * width - 0.5, (1 - seen.y) * height - 0.5)
        np.testing.assert_allclose(pixel, expected, atol=0.02)
    bpy.ops.bsface.landmarks_done(keep=False)


def test_moved_landmarks_outweigh_the_others(rows):
    start = photo_list.landmarks(rows[0])
    bpy.ops.bsface.landmarks_edit(photo="0.png")
    obj = landmark_editor.editor()
    bpy.ops.mesh.select_all(action="DESELECT")
    bpy.ops.object.mode_set(mode="OBJECT")
    obj.data.vertices[7].select = True
    bpy.ops.object.mode_set(mode="EDIT")
    longer = max(faces.SIZE)
    bpy.ops.transform.translate(value=(5 / longer, -3 / longer, 0))
    bpy.ops.bsface.landmarks_done()
    found = photo_list.landmarks(rows[0])
    moved = found.points - start.points
    np.testing.assert_allclose(moved[7], (5, 3), atol=0.01)
    np.testing.assert_array_equal(np.delete(moved, 7, axis=0), 0)
    assert found.weight[7] > start.weight.max() and found.source == "hand"
    assert np.delete(found.weight, 7).max() == 0.5


@pytest.mark.parametrize("keep", [True, False])
def test_leaving_the_editor_leaves_nothing(rows, keep):
    scene = bpy.context.scene
    other = bpy.data.objects.new("other", None)
    scene.collection.objects.link(other)
    bpy.context.view_layer.objects.active = other
    resolution = (scene.render.resolution_x, scene.render.resolution_y)
    before = rows[0].landmarks
    bpy.ops.bsface.landmarks_edit(photo="0.png")
    bpy.ops.bsface.landmarks_done(keep=keep)
    assert [obj.name for obj in bpy.data.objects] == ["other"]
    for kind in ("meshes", "cameras", "images", "collections"):
        assert not getattr(bpy.data, kind)
    assert scene.camera is None and bpy.context.view_layer.objects.active == other
    assert (scene.render.resolution_x, scene.render.resolution_y) == resolution
    assert rows[0].landmarks == before
    assert not bpy.ops.bsface.landmarks_done.poll()


def test_editing_another_photo_closes_the_first(rows):
    photo_list.keep_landmarks(rows[1], some("1.png"))
    bpy.ops.bsface.landmarks_edit(photo="0.png")
    bpy.ops.bsface.landmarks_edit(photo="1.png")
    assert landmark_editor.editor()[landmark_editor.PHOTO] == "1.png"
    assert len(bpy.data.meshes) == len(bpy.data.cameras) == 1
    bpy.ops.bsface.landmarks_done()


def test_deleted_points_are_refused(rows):
    bpy.ops.bsface.landmarks_edit(photo="0.png")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.delete(type="VERT")
    with pytest.raises(RuntimeError, match="0 points instead of 68"):
        bpy.ops.bsface.landmarks_done()
    bpy.ops.bsface.landmarks_done(keep=False)


def test_a_photo_without_landmarks_cannot_be_edited(rows):
    with pytest.raises(RuntimeError, match="no landmarks yet"):
        bpy.ops.bsface.landmarks_edit(photo="1.png")
    assert landmark_editor.editor() is None


@pytest.mark.parametrize("ending", ["json", "pts"])
def test_files_go_out_and_come_back(rows, tmp_path, ending):
    path = str(tmp_path / f"a.{ending}")
    bpy.ops.bsface.landmarks_export(photo="0.png", filepath=path)
    bpy.ops.bsface.landmarks_import(photo="2.png", filepath=path)
    found = photo_list.landmarks(rows[2])
    np.testing.assert_allclose(found.points, some("x").points, atol=2e-3)
    assert found.source == "file" and rows[2].status == "found"


def test_68_of_the_468_are_exported_as_pts(rows, tmp_path):
    photo_list.keep_landmarks(rows[1], some("1.png", "468", 468))
    path = tmp_path / "a.pts"
    bpy.ops.bsface.landmarks_export(photo="1.png", filepath=str(path))
    template = load("core.surface.template").load_template()
    expected = some("x", "468", 468).points[template.schemes["68"]]
    read = core_landmarks.read_landmarks(path).points
    np.testing.assert_allclose(read, expected, atol=2e-3)


def test_wrong_files_are_refused_in_one_sentence(rows, tmp_path):
    path = tmp_path / "a.pts"
    path.write_text("nothing")
    with pytest.raises(RuntimeError, match=r"a\.pts"):
        bpy.ops.bsface.landmarks_import(photo="1.png", filepath=str(path))
    with pytest.raises(RuntimeError, match="is a file"):
        bpy.ops.bsface.landmarks_export(photo="0.png", filepath=str(path / "a.json"))
    for nothing in ("", f"{tmp_path}/"):
        with pytest.raises(RuntimeError, match="Choose a landmark file"):
            bpy.ops.bsface.landmarks_import(photo="1.png", filepath=nothing)
        with pytest.raises(RuntimeError, match="is a folder; give the file"):
            bpy.ops.bsface.landmarks_export(photo="0.png", filepath=nothing)


def test_clearing(rows):
    photo_list.keep_landmarks(rows[1], some("1.png"))
    bpy.context.scene.bsface.active_photo = 1
    bpy.ops.bsface.landmarks_clear()
    assert [bool(row.landmarks) for row in rows] == [True, False, False]
    bpy.ops.bsface.landmarks_clear(which="ALL")
    assert not any(row.landmarks for row in rows)


def test_known_landmarks_go_into_the_next_run(rows, solved):
    bpy.ops.bsface.reconstruct()
    (request,) = solved
    assert list(request.landmarks) == ["0.png"]


def test_another_face_of_the_photo_can_be_chosen(rows, solver):
    left = some("1.png", "468", 468)
    right = dataclasses.replace(left, points=left.points + (200, 0))
    solver.faces = (left, right)
    xs = []
    for _ in range(3):
        bpy.ops.bsface.face_next(photo="1.png")
        xs.append(photo_list.landmarks(rows[1]).points[0, 0])
    np.testing.assert_allclose(np.diff(xs), [200, -200], atol=1e-2)
    assert photo_list.landmarks(rows[1]).source == "hand"
    solver.faces = errors.ReconstructionError("No face was found in 1.png.")
    with pytest.raises(RuntimeError, match="No face was found"):
        bpy.ops.bsface.face_next(photo="1.png")
