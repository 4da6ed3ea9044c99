"""Faces whose properties, points or nodes a user or another add-on has damaged."""

import bpy
import pytest
from blender.checkout import load

scene = load("bsface_addon.scene")
cameras = load("bsface_addon.cameras")
face_file = load("bsface_addon.face_file")
stored_facts = load("bsface_addon.stored_facts")
coordinates = load("bsface_addon.coordinates")

# What reads the file, the control points, or both.
READERS = ("surface_refit", "surface_to_mesh", "arkit_keys", "export")
CHANGERS = ("surface_symmetrise", "surface_resample", "coarse_edit")


def said(name, tmp_path):
    """The sentence with which an operator refuses; "" if it does its work."""
    words = {"filepath": str(tmp_path / "a.step")} if name == "export" else {}
    try:
        getattr(bpy.ops.bsface, name)(**words)
    except RuntimeError as error:
        return str(error).removeprefix("Error: ").strip()
    return ""


@pytest.mark.parametrize("content", [None, 3, "text", b"", b"x", b"PK\x03\x04"])
@pytest.mark.parametrize("name", [*READERS, "surface_map"])
def test_a_face_without_its_file_is_one_sentence(face, tmp_path, name, content):
    del face[face_file.KEY]
    if content is not None:
        face[face_file.KEY] = content
    sentence = said(name, tmp_path)
    if name == "surface_map":  # shows the plain skin
        return
    assert "Ann" in sentence and "\n" not in sentence
    assert "inside BSface" not in sentence


@pytest.mark.parametrize("name", [*READERS, *CHANGERS])
@pytest.mark.parametrize("place", [float("nan"), None])
def test_points_that_are_no_surface_are_one_sentence(face, tmp_path, name, place):
    points = face.data.splines[0].points
    for point in [points[3]] if place is not None else points:
        point.co = (place or 0.0,) * 3 + (1.0,)
    sentence = said(name, tmp_path)
    told = "Ann has control points that are no finite numbers" in sentence
    # A resampled net of one place is one place again.
    assert told or (name == "surface_resample" and place is None)
    assert "\n" not in sentence


@pytest.mark.parametrize("unit", ["x", 0.0, -1.0, 1e308, float("nan"), [1.0, 2.0]])
def test_a_surface_of_no_size_is_no_face(face, tmp_path, unit):
    face[coordinates.UNIT_KEY] = unit
    assert not scene.is_face(face)
    for name in (*READERS, *CHANGERS, "surface_net"):
        assert "Traceback" not in said(name, tmp_path)


def test_a_face_that_is_scaled_to_nothing_is_one_sentence(face, tmp_path):
    face.scale = (0, 0, 0)
    bpy.context.view_layer.update()
    sentence = said("surface_refit", tmp_path)
    assert sentence == "Ann is scaled to nothing; clear its scale (Alt S)"


@pytest.mark.parametrize("value", ["x", 3, [1], [0, 0], None])
def test_cameras_that_lost_their_photo_are_passed_over(face, tmp_path, value):
    first, second, _ = cameras.of_face(face)
    del first[cameras.SIZE_KEY]
    if value is not None:
        first[cameras.SIZE_KEY] = value
    second[cameras.PHOTO_KEY] = 7
    assert len(cameras.of_face(face)) == 1
    assert said("view_photo", tmp_path) == ""


@pytest.mark.parametrize("fact", ["3", "[3]", '[{"path": 3}]', '{"a": 1}', "[" * 10**5])
def test_facts_of_another_kind_are_no_facts(face, tmp_path, fact):
    face[stored_facts.PHOTOS] = fact
    bpy.context.scene.bsface.photos.clear()
    assert "inside BSface" not in said("surface_refit", tmp_path)
    face[stored_facts.QUALITY] = fact
    found = scene.stored(face, stored_facts.QUALITY, {})
    assert found == ({"a": 1} if fact == '{"a": 1}' else {})


def test_nodes_that_were_deleted_are_made_again(face, tmp_path):
    material = face.data.materials[0]
    material.node_tree.nodes.remove(material.node_tree.nodes["Skin"])
    kept = [node.name for node in material.node_tree.nodes]
    assert said("surface_map", tmp_path) == ""
    assert {*kept, "Skin"} <= {node.name for node in material.node_tree.nodes}


@pytest.mark.parametrize("text", ["{bad", "[]", '{"0.png": "x"}', '{"0.png": [1]}'])
def test_damaged_expressions_are_none(face, text):
    face["bsface_expressions"] = text
    assert bpy.ops.bsface.view_photo() == {"FINISHED"}
    assert face.data.shape_keys is None


@pytest.mark.parametrize("text", ["{bad", "[1]", '{"points": 3}'])
def test_damaged_landmarks_are_none(face, solved, text):
    row = bpy.context.scene.bsface.photos[0]
    row.landmarks = text
    with pytest.raises(RuntimeError, match="no landmarks yet"):
        bpy.ops.bsface.landmarks_edit(photo=row.name)
    assert bpy.ops.bsface.reconstruct() == {"FINISHED"}
    assert row.name not in solved[-1].landmarks


@pytest.mark.parametrize("text", ["{bad", "[]", '{"camera": 3}', "{}"])
def test_a_damaged_memory_of_the_frame(face, text):
    bpy.ops.bsface.view_photo()
    bpy.context.scene["bsface_frame_before"] = text
    assert bpy.ops.bsface.view_leave() == {"FINISHED"}


def test_a_size_that_is_no_number_is_refused(face, tmp_path):
    bpy.context.scene.bsface.size = float("nan")
    with pytest.raises(RuntimeError, match="size of the face is no finite number"):
        bpy.ops.bsface.reconstruct(directory=str(tmp_path / "photos"), separate=True)
