"""What an artist does between two runs must not cost the work, nor the next run."""

import bpy
import numpy as np
import pytest
from blender import faces
from blender.checkout import load
from blender.faces import points

coarse_editor = load("bsface_addon.coarse_editor")
scene = load("bsface_addon.scene")
surface_object = load("bsface_addon.surface_object")
shape_keys = load("bsface_addon.shape_keys")
resampled_net = load("core.surface.bspline").resampled_net
Outcome = load("bsface_addon.solving").Outcome


@pytest.fixture
def bob(face, solver, tmp_path):
    """A face of other photos; Ann, who was there before, is active again."""
    folder = tmp_path / "bob"
    solver.answer = Outcome.of(faces.reconstruction(folder))
    bpy.ops.bsface.reconstruct(directory=str(folder), name="Bob", separate=True)
    solver.requests.clear()
    bpy.context.view_layer.objects.active = face
    return bpy.context.scene.bsface.face


def exclude(face):
    """Take the face's collection out of the view layer."""
    children = bpy.context.view_layer.layer_collection.children
    children[face.users_collection[0].name].exclude = True


# --- the coarse net is open ----------------------------------------------------------


def test_nothing_changes_the_face_under_its_coarse_net(face):
    bpy.ops.bsface.coarse_edit()
    for name in ("reconstruct", "surface_refit", "surface_symmetrise", "face_remove"):
        with pytest.raises(RuntimeError, match="press Done first"):
            getattr(bpy.ops.bsface, name)()
    with pytest.raises(RuntimeError, match="press Done first"):
        bpy.ops.bsface.surface_net()
    bpy.ops.bsface.coarse_done()
    assert bpy.ops.bsface.surface_refit() == {"FINISHED"}


def test_the_coarse_net_of_a_face_that_is_out_of_sight_can_be_left(face):
    bpy.ops.bsface.coarse_edit()
    exclude(face)
    assert bpy.ops.bsface.coarse_done() == {"FINISHED"}
    assert coarse_editor.editor() is None


# --- the face's collection is excluded or hidden -------------------------------------


@pytest.mark.parametrize("name", ["reconstruct", "surface_refit"])
def test_a_run_updates_a_face_that_is_out_of_sight(face, name):
    surface_object.write(bpy.context, face, points(face) + [0.0, 3.0, 0.0])
    wanted = points(face) - [0.0, 3.0, 0.0]
    exclude(face)
    assert getattr(bpy.ops.bsface, name)() == {"FINISHED"}
    np.testing.assert_allclose(points(face), wanted, atol=1e-3)


@pytest.mark.parametrize("name", ["surface_net", "coarse_edit"])
@pytest.mark.parametrize("way", ["exclude", "hide_viewport"])
def test_a_net_that_nobody_sees_is_not_edited(face, name, way):
    collection = face.users_collection[0].name
    layer = bpy.context.view_layer.layer_collection.children[collection]
    setattr(layer, way, True)
    prop = bpy.data.objects.new("prop", None)
    bpy.context.scene.collection.objects.link(prop)
    prop.select_set(True)
    with pytest.raises(RuntimeError, match="Ann is in a collection that"):
        getattr(bpy.ops.bsface, name)()
    assert bpy.context.selected_objects == [prop]
    assert {obj.mode for obj in bpy.data.objects} == {"OBJECT"}
    assert coarse_editor.editor() is None


# --- two faces -----------------------------------------------------------------------


def test_refit_takes_the_photos_of_the_face_not_those_of_the_other(face, bob, solved):
    bpy.ops.bsface.surface_refit()
    assert {path.parent.name for path in solved[-1].photos} == {"photos"}


def test_new_photos_of_the_list_count_for_the_face(face, solved, tmp_path):
    faces.photo_files(tmp_path / "more")
    bpy.ops.bsface.photos_clear()
    bpy.ops.bsface.photos_add(directory=str(tmp_path / "more"))
    bpy.ops.bsface.surface_refit()
    assert {path.parent.name for path in solved[-1].photos} == {"more"}


def test_the_list_is_reconstructed_into_its_own_face(face, bob):
    for one in (face, bob):
        surface_object.write(bpy.context, one, points(one) + [0.0, 3.0, 0.0])
    kept, wanted = points(face), points(bob) - [0.0, 3.0, 0.0]
    bpy.ops.bsface.reconstruct()
    np.testing.assert_array_equal(points(face), kept)
    np.testing.assert_allclose(points(bob), wanted, atol=1e-3)


def test_an_expression_of_another_person_is_refused(face, bob):
    bpy.ops.bsface.expression_assign(expression="Smile", which="USED")
    with pytest.raises(RuntimeError, match="photos of Bob, not of Ann; select Bob"):
        bpy.ops.bsface.expression_key(expression="Smile")
    bpy.context.view_layer.objects.active = bob
    assert bpy.ops.bsface.expression_key(expression="Smile") == {"FINISHED"}
    assert face.data.shape_keys is None


# --- shape keys ----------------------------------------------------------------------


@pytest.mark.parametrize("way", ["reconstruct", "resample"])
def test_keys_and_their_animation_outlive_a_net_of_another_size(face, way):
    if way == "reconstruct":
        bpy.ops.bsface.surface_resample(control_points_u=20, control_points_v=22)
    surface_object.add_shape_key(face, "Smile", points(face) + (0, 0, 2))
    surface_object.add_shape_key(face, "Frown", points(face) - (0, 0, 1))
    keys = face.data.shape_keys
    smile, frown = keys.key_blocks["Smile"], keys.key_blocks["Frown"]
    keys.reference_key.name = "Calm"
    smile.slider_max = 2.0
    for frame, smile.value in ((1, 0.0), (11, 2.0)):
        smile.keyframe_insert("value", frame=frame)
    frown.driver_add("value").driver.expression = "frame / 20"
    name, action = face.data.name, keys.animation_data.action
    if way == "resample":
        bpy.ops.bsface.surface_resample(control_points_u=20, control_points_v=22)
    else:
        bpy.ops.bsface.reconstruct()
    keys = face.data.shape_keys
    assert keys.key_blocks.keys() == ["Calm", "Smile", "Frown"]
    assert keys.animation_data.action == action
    smile = keys.key_blocks["Smile"]
    assert smile.slider_max == 2.0
    bpy.context.scene.frame_set(6)
    assert smile.value == pytest.approx(1.0)
    assert keys.key_blocks["Frown"].value == pytest.approx(0.3)
    moved = points(face, "Smile") - points(face)
    np.testing.assert_allclose(moved[..., 2], 2, atol=1e-3)
    assert face.data.name == name and len(bpy.data.curves) == 1
    # The action goes on being edited.
    assert smile.keyframe_insert("value", frame=21)
    assert keys.animation_data.action == action


def test_what_hangs_on_the_keys_outlives_a_net_of_another_size(face):
    for name in ("Smile", "Grin"):
        surface_object.add_shape_key(face, name, points(face) + (0, 0, 2))
    curve, keys = face.data, face.data.shape_keys
    smile, grin = keys.key_blocks["Smile"], keys.key_blocks["Grin"]
    grin.relative_key, grin.lock_shape, grin.interpolation = smile, True, "KEY_CARDINAL"
    keys.name, keys["note"], curve["note"], curve.use_path = "Ann keys", 5, 6, True
    smile.keyframe_insert("value", frame=1)
    curve.keyframe_insert("eval_time", frame=1)
    action = keys.animation_data.action
    track = keys.animation_data.nla_tracks.new()
    track.strips.new("talk", 1, action)
    keys.animation_data.action = None
    double, reader = face.copy(), bpy.data.objects.new("reader", None)
    for obj in (double, reader):
        bpy.context.scene.collection.objects.link(obj)
    driver = reader.driver_add("location", 0).driver
    target = driver.variables.new().targets[0]
    target.id_type, target.id = "KEY", keys
    target.data_path = 'key_blocks["Smile"].value'
    bpy.ops.bsface.surface_resample(control_points_u=20, control_points_v=22)
    assert face.data == double.data == curve and curve.shape_keys == keys
    assert surface_object.shape(double) == (20, 22)
    assert grin.relative_key == smile and grin.lock_shape
    assert (keys.name, keys["note"], curve["note"]) == ("Ann keys", 5, 6)
    assert curve.use_path and curve.animation_data.action is not None
    assert keys.animation_data.nla_tracks[0].strips[0].action == action
    assert target.id == keys
    moved = points(face, "Grin") - points(face)
    np.testing.assert_allclose(
        moved, np.broadcast_to((0, 0, 2), moved.shape), atol=1e-3
    )


def test_a_failure_after_the_net_changed_its_size_costs_no_face(face):
    surface_object.add_shape_key(face, "Smile", points(face) + (0, 0, 2))
    net = resampled_net(points(face), (20, 22))
    with pytest.raises(MemoryError), scene.all_or_nothing(bpy.context):
        shape_keys.write(bpy.context, face, net)
        raise MemoryError
    assert bpy.data.objects["Ann"] == face
    np.testing.assert_allclose(points(face), net, atol=1e-3)
    assert face.data.shape_keys.key_blocks.keys() == ["Neutral", "Smile"]


def test_a_word_that_is_too_long_for_a_key_is_refused(face):
    for word in ("é" * 60, "e" * 64):
        bpy.ops.bsface.expression_assign(expression=word, which="USED")
        with pytest.raises(RuntimeError, match="use a shorter word"):
            bpy.ops.bsface.expression_key(expression=word)
        assert face.data.shape_keys is None


def test_a_word_that_is_the_name_of_another_key_is_refused(face):
    bpy.ops.bsface.arkit_keys()
    face.data.shape_keys.reference_key.name = "Calm"
    face.shape_key_add(name="Mine", from_mix=False)
    before = points(face)
    for word, why in (
        ("Neutral", "BSface needs the name"),
        ("Calm", "BSface needs the name"),
        ("As in Photo", "BSface needs the name"),
        ("jawOpen", "was not made from photos"),
        ("Mine", "was not made from photos"),
    ):
        bpy.ops.bsface.expression_assign(expression=word, which="USED")
        with pytest.raises(RuntimeError, match=why):
            bpy.ops.bsface.expression_key(expression=word)
    np.testing.assert_array_equal(points(face), before)


def test_an_expression_is_made_again_and_other_sliders_stay(face):
    bpy.ops.bsface.arkit_keys()
    bpy.ops.bsface.expression_assign(expression="Smile", which="USED")
    blocks = face.data.shape_keys.key_blocks
    blocks["jawOpen"].value = 0.4
    for _ in range(2):
        assert bpy.ops.bsface.expression_key(expression="Smile") == {"FINISHED"}
    assert blocks["Smile"].value == 1 and blocks["jawOpen"].value == pytest.approx(0.4)


@pytest.mark.parametrize("net", [None, (20, 22)])
def test_keys_that_were_changed_by_hand_are_not_made_again(face, capfd, net):
    bpy.ops.bsface.arkit_keys()
    if net is not None:
        bpy.ops.bsface.surface_resample(control_points_u=20, control_points_v=22)
    blocks = face.data.shape_keys.key_blocks
    blocks["jawOpen"].data[100].co.z += 0.01
    mine = np.array([point.co for point in blocks["jawOpen"].data])
    # Their basis may move meanwhile: that is not a change of theirs.
    surface_object.write(bpy.context, face, points(face) + [0.0, 1.0, 0.0])
    mine[:, 2] += 0.001
    capfd.readouterr()
    bpy.ops.bsface.arkit_keys()
    text = "51 shape keys added; 1 that you made or changed stay as they are"
    assert text in capfd.readouterr().out
    now = np.array([point.co for point in blocks["jawOpen"].data])
    np.testing.assert_allclose(now, mine, atol=1e-6)


# --- the add-on is disabled ----------------------------------------------------------


def test_disabling_the_addon_ends_what_follows_the_coarse_net(addon, face):
    bpy.ops.bsface.coarse_edit()
    bpy.app.timers.register(coarse_editor._tick)  # as in a window
    addon.unregister()
    try:
        assert not bpy.app.timers.is_registered(coarse_editor._tick)
    finally:
        addon.register()
    assert bpy.ops.bsface.coarse_done() == {"FINISHED"}
