"""Face, lights and material: what is placed, and that nothing is left behind."""

import dataclasses
import json

import bpy
import cv2
import numpy as np
import pytest
from blender import faces
from blender.checkout import load
from mathutils import Matrix, Vector

scene = load("bsface_addon.scene")
selection = load("bsface_addon.selection")
stored_facts = load("bsface_addon.stored_facts")
cameras = load("bsface_addon.cameras")
face_file = load("bsface_addon.face_file")
lights = load("bsface_addon.lights")
material = load("bsface_addon.material")
coordinates = load("bsface_addon.coordinates")
maps = load("bsface_addon.maps")
Outcome = load("bsface_addon.solving").Outcome
removal = load("bsface_addon.removal")


def painted(pixels):
    """A map without a border."""
    square = np.array([[-1, -1], [2, -1], [2, 2], [-1, 2]], float)
    return maps.painted(pixels, square)


def everything():
    kinds = ("objects", "curves", "cameras", "lights", "images", "collections")
    kinds += ("materials",)
    return {k: sorted(d.name for d in getattr(bpy.data, k)) for k in kinds}


def test_face_stands_upright_in_life_size(empty_scene, tmp_path):
    face = scene.place(bpy.context, Outcome.of(faces.reconstruction(tmp_path)), "Ann")
    bpy.context.view_layer.update()
    assert face.matrix_world == Matrix()
    width, depth, height = face.dimensions
    assert 0.1 < width < 0.2 < height + 0.1 < 0.35 and 0.03 < depth < 0.1
    nose = coordinates.world_frame(face) @ Vector((0, -20, 60))
    np.testing.assert_allclose(nose, (0, -0.06, -0.02), atol=1e-8)


def test_suns_shine_from_where_the_light_came(empty_scene, tmp_path):
    result = faces.reconstruction(tmp_path)
    face = scene.place(bpy.context, Outcome.of(result), "Ann")
    for sun in lights.of_face(face):
        assert sun.hide_render and sun.hide_viewport
        lights.switch(sun, True)
    bpy.context.view_layer.update()
    for sun, harmonics in zip(
        lights.of_face(face), result.photometric.lights, strict=True
    ):
        shines = sun.matrix_world.to_3x3() @ Vector((0, 0, -1))
        towards = coordinates.world_frame(face).to_3x3() @ Vector(harmonics[1:4])
        assert shines.normalized().dot(towards.normalized()) < -0.9999
        assert sun.data.energy == pytest.approx(
            2 * np.pi * np.linalg.norm(harmonics[1:4])
        )


def test_facts_stay_with_the_object(empty_scene, tmp_path):
    result = faces.reconstruction(tmp_path / "photos")
    scene.place(bpy.context, Outcome.of(result), "Ann")
    path = str(tmp_path / "a.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    face = bpy.data.objects["Ann"]
    assert scene.is_face(face)
    assert json.loads(face[stored_facts.SETTINGS])["eye_distance_mm"] == 62.0
    report = scene.stored(face, stored_facts.REPORT, None)
    assert [row["status"] for row in report] == ["used"] * 3 + ["no_face"]
    assert scene.stored(face, stored_facts.PHOTOS, [])[0]["size"] == list(faces.SIZE)
    saved = face_file.saved(face)
    assert [m.scheme for m in saved.landmarks] == ["40"] * 3
    assert len(saved.cameras) == 3


def test_a_second_run_updates_the_same_object(empty_scene, tmp_path):
    result = faces.reconstruction(tmp_path)
    face = scene.place(bpy.context, Outcome.of(result), "Ann")
    face.location.x = 2
    first = everything()
    again = scene.place(bpy.context, Outcome.of(result), "other name", face=face)
    assert again == face and face.location.x == 2
    assert everything() == first


def test_a_second_face_gets_its_own_collection(empty_scene, tmp_path):
    result = faces.reconstruction(tmp_path)
    first = scene.place(bpy.context, Outcome.of(result), "Ann")
    second = scene.place(bpy.context, Outcome.of(result), "Ann")
    assert second != first
    # Beside the first, without touching it.
    bpy.context.view_layer.update()
    ends = [
        [(face.matrix_world @ Vector(corner)).x for corner in face.bound_box]
        for face in (first, second)
    ]
    assert max(ends[0]) < min(ends[1]) < max(ends[0]) + 0.1
    assert first.users_collection[0] != second.users_collection[0]
    assert len(cameras.of_face(first)) == len(cameras.of_face(second)) == 3


@pytest.mark.parametrize("fault", ["camera", "light", "map"])
@pytest.mark.parametrize("update", [False, True])
def test_a_failure_leaves_the_scene_as_it_was(empty_scene, tmp_path, fault, update):
    result = faces.reconstruction(tmp_path)
    face = scene.place(bpy.context, Outcome.of(result), "Ann") if update else None
    mesh = bpy.data.meshes.new("other")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
    other = bpy.data.objects.new("other", mesh)
    empty_scene.collection.objects.link(other)
    bpy.context.view_layer.objects.active = other
    other.select_set(True)
    if face:
        face.select_set(False)
    bpy.ops.object.mode_set(mode="EDIT")
    before = everything()

    # Each comes after all that is placed before it.
    pictures = {}
    if fault == "camera":
        result = dataclasses.replace(result, cameras=result.cameras[:2])
    elif fault == "light":
        lights = result.photometric.lights[:2]
        few = dataclasses.replace(result.photometric, lights=lights)
        result = dataclasses.replace(result, photometric=few)
    else:
        pictures = {"NO SUCH MAP": painted(np.zeros((4, 4, 3), np.uint8))}
    with pytest.raises((ValueError, KeyError)):
        scene.place(bpy.context, Outcome.of(result, pictures), "Ann", face=face)
    assert everything() == before
    assert bpy.context.view_layer.objects.active == other and other.mode == "EDIT"
    bpy.ops.object.mode_set(mode="OBJECT")
    assert [o.name for o in bpy.context.selected_objects] == ["other"]


def test_maps_are_upright_on_the_surface_and_can_be_switched(empty_scene, tmp_path):
    face = scene.place(bpy.context, Outcome.of(faces.reconstruction(tmp_path)), "Ann")
    texture = np.zeros((8, 6, 3), np.uint8)
    texture[0, :, 0] = 255  # v = 0, the forehead, is red
    image = material.store_map(face, "PHOTO", painted(texture))
    pixels = np.empty(8 * 6 * 4, np.float32)
    image.pixels.foreach_get(pixels)
    # Blender's bottom row has the texture coordinate 0, which is v = 0.
    assert pixels.reshape(8, 6, 4)[0, :, 0].min() == 1.0
    assert image.packed_file is not None
    material.store_map(face, "NORMALS", painted(texture))
    for kind in ("PHOTO", "NORMALS", "PLAIN"):
        material.show(face, kind)
        assert material.shown(face) == kind
    assert material.stored_kinds(face) == ["PHOTO", "NORMALS"]
    with pytest.raises(KeyError):
        material.show(face, "RESIDUAL")


def test_texture_coordinates_are_u_and_v(empty_scene, tmp_path):
    """The assumption behind the maps: row j of the picture is v_j."""
    result = faces.reconstruction(tmp_path)
    face = scene.place(bpy.context, Outcome.of(result), "Ann")
    depsgraph = bpy.context.evaluated_depsgraph_get()
    mesh = bpy.data.meshes.new_from_object(face.evaluated_get(depsgraph))
    uv = np.empty(len(mesh.loops) * 2, np.float32)
    mesh.uv_layers[0].data.foreach_get("uv", uv)
    corner = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", corner)
    xyz = coordinates.from_local(face, np.array([v.co for v in mesh.vertices]))[corner]
    np.testing.assert_allclose(
        xyz, result.surface.evaluate(*uv.reshape(-1, 2).astype(float).T), atol=2e-3
    )


@pytest.fixture
def painted_face(addon, tmp_path):
    """A face with a picture, and what the file held before it."""
    before = everything()
    pictures = {"PHOTO": painted(np.zeros((4, 4, 3), np.uint8))}
    result = faces.reconstruction(tmp_path)
    return scene.place(bpy.context, Outcome.of(result, pictures), "Ann"), before


def test_removing_a_face_removes_what_belongs_to_it(painted_face):
    face, before = painted_face
    bpy.context.scene.bsface.face = face
    removal.remove_face(bpy.context, face)
    assert everything() == before
    assert bpy.context.scene.bsface.face is None


@pytest.mark.parametrize("through", [True, False])
def test_what_blenders_delete_leaves_behind_can_be_removed(painted_face, through):
    face, before = painted_face
    bpy.context.scene.bsface.face = face
    other = bpy.data.objects.new("other", None)
    bpy.context.scene.collection.objects.link(other)
    if through:
        bpy.ops.bsface.view_photo()
    assert not bpy.ops.bsface.leftovers_remove.poll()
    selection.select_only(bpy.context, face)
    bpy.ops.object.delete()
    assert scene.active_face(bpy.context) is None
    assert len(bpy.context.scene.objects) == 8
    assert bpy.ops.bsface.leftovers_remove() == {"FINISHED"}
    assert [obj.name for obj in bpy.data.objects] == ["other"]
    bpy.data.objects.remove(other)
    assert everything() == before
    assert bpy.context.scene.camera is None


def test_sun_has_the_first_order_of_the_light_it_stands_for():
    """The clamped cosine of the sun, projected on the linear harmonics."""
    direction, energy = lights.sun(np.array([1.0, 0, 0.3, 0.4, 0, 0, 0, 0, 0]))
    normals = np.random.default_rng(0).normal(size=(200_000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    shading = energy / np.pi * np.maximum(normals @ direction, 0)
    linear = 3 * (normals * shading[:, None]).mean(axis=0)
    np.testing.assert_allclose(linear, [0, 0.3, 0.4], atol=0.01)


@pytest.mark.parametrize("update", [False, True])
def test_a_result_can_come_without_taking_over(empty_scene, tmp_path, update):
    result = faces.reconstruction(tmp_path)
    face = scene.place(bpy.context, Outcome.of(result), "Ann") if update else None
    bpy.ops.mesh.primitive_cube_add()
    cube = bpy.context.object
    bpy.ops.object.mode_set(mode="EDIT")
    made = scene.place(bpy.context, Outcome.of(result), "Ann", face=face, select=False)
    assert bpy.context.view_layer.objects.active == cube and cube.mode == "EDIT"
    bpy.ops.object.mode_set(mode="OBJECT")
    assert bpy.context.selected_objects == [cube] and scene.is_face(made)


def test_maps_that_a_new_run_has_not_go(empty_scene, tmp_path):
    grey = painted(np.zeros((4, 4, 3), np.uint8))
    result = faces.reconstruction(tmp_path)
    both = {"PHOTO": grey, "DEVIATION": grey}
    face = scene.place(bpy.context, Outcome.of(result, both), "Ann")
    material.show(face, "DEVIATION")
    scene.place(bpy.context, Outcome.of(result, {"PHOTO": grey}), "Ann", face=face)
    assert material.stored_kinds(face) == ["PHOTO"]
    assert material.shown(face) == "PLAIN"


def test_maps_of_the_first_version_get_their_new_name(painted_face):
    face, _ = painted_face
    own = material.of_face(face)
    own.node_tree.nodes["PHOTO"].name = "CONFIDENCE"
    own[material.KIND_KEY] = "CONFIDENCE"
    material.upgrade()
    assert material.shown(face) == "DEVIATION"
    assert material.stored_kinds(face) == ["DEVIATION"]


def test_quality_is_told_in_numbers(tmp_path):
    messages = load("bsface_addon.messages")
    result = faces.reconstruction(tmp_path)
    facts = stored_facts.quality_facts(result)
    assert facts["used"] == 3 and facts["photos"] == 4
    # Its median over the net: that over the face is not far.
    assert facts["deviation_mm"] == pytest.approx(1.0, abs=0.05)
    assert facts["eyes_px"] == pytest.approx(0.9 * 62)
    text = messages.quality(facts)
    assert text == (
        "3 of 4 photos used; median deviation 1.0 mm; eyes 56 pixels apart."
    )
    unknown = stored_facts.quality_facts(dataclasses.replace(result, deviation=None))
    assert "deviation" not in messages.quality(unknown) and not messages.quality({})


def test_normals_are_those_of_the_surface(tmp_path):
    result = faces.reconstruction(tmp_path)
    square = np.array([[-1, -1], [2, -1], [2, 2], [-1, 2]], float)
    png = np.frombuffer(maps.normals(result.surface, square).png, np.uint8)
    picture = cv2.imdecode(png, cv2.IMREAD_COLOR)[::-1, :, ::-1]
    size = maps.RESOLUTION
    rows, columns = np.array([[5, 300, 511], [0, 140, 480]])
    expected = result.surface.normals((columns + 0.5) / size, (rows + 0.5) / size)
    np.testing.assert_allclose(picture[rows, columns] / 127.5 - 1, expected, atol=0.005)
