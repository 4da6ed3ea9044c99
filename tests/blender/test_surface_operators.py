"""Operators of the surface: refit, its net, its shape keys, saving and removal."""

import bpy
import numpy as np
import pytest
from blender.checkout import load
from blender.faces import points

scene = load("bsface_addon.scene")
face_file = load("bsface_addon.face_file")
coordinates = load("bsface_addon.coordinates")
surface_object = load("bsface_addon.surface_object")


def test_without_a_face_the_buttons_say_why(addon):
    for name in ("surface_refit", "surface_map", "export", "view_photo", "face_remove"):
        assert not getattr(bpy.ops.bsface, name).poll()
    with pytest.raises(RuntimeError, match="Reconstruct first"):
        bpy.ops.bsface.surface_symmetrise()


# --- refit ---------------------------------------------------------------------------


def test_refit_starts_from_the_edited_net_and_holds_what_moved(face, solved):
    bpy.ops.bsface.surface_net()
    assert face.mode == "EDIT"
    bpy.ops.curve.select_all(action="DESELECT")
    bpy.ops.object.mode_set(mode="OBJECT")
    face.data.splines[0].points[4 * 16 + 3].select = True
    bpy.ops.bsface.surface_net()
    bpy.ops.transform.translate(value=(0, 0, 0.004))
    edited = points(face)
    bpy.ops.bsface.surface_refit()
    (request,) = solved
    np.testing.assert_array_equal(request.start.control_points, edited)
    assert request.settings.control_points == edited.shape[:2]
    assert request.constraint.points.sum() == 1 and request.constraint.points[3, 4]
    assert [obj for obj in bpy.data.objects if scene.is_face(obj)] == [face]
    # The run is now what counts as solved.
    assert not face_file.moved(face).any()


def test_refit_holds_the_selection_or_nothing(face, solved):
    face.data.splines[0].points[5 * 16 + 2].select = True
    bpy.ops.bsface.surface_refit(hold="SELECTED", softness=0)
    held = solved[0].constraint
    assert held.points[2, 5] and held.points.sum() == 1
    assert held.softness_mm == 0
    bpy.ops.bsface.surface_refit(hold="NONE")
    assert solved[1].constraint is None


def test_refit_finds_the_photos_without_the_list(face, solved, tmp_path):
    bpy.ops.bsface.photos_clear()
    bpy.ops.bsface.surface_refit()
    assert [path.name for path in solved[0].photos] == ["0.png", "1.png", "2.png"]
    for path in (tmp_path / "photos").iterdir():
        path.unlink()
    bpy.ops.bsface.photos_clear()
    with pytest.raises(RuntimeError, match="nor beside this file"):
        bpy.ops.bsface.surface_refit()


# --- the net -------------------------------------------------------------------------


def test_resample_keeps_shape_and_shape_keys(face):
    before = face_file.surface(face)
    surface_object.add_shape_key(face, "Smile", points(face) + (0, 0, 2))
    bpy.ops.bsface.surface_resample(control_points_u=29, control_points_v=33)
    assert surface_object.shape(face) == (29, 33)
    # 26 and 30 spans hold the old 13 and 15: exact but for float32.
    grid = before.grid(20, 20)
    np.testing.assert_allclose(face_file.surface(face).grid(20, 20), grid, atol=1e-3)
    smile = face_file.surface(face, "Smile").grid(20, 20)
    np.testing.assert_allclose(smile, grid + (0, 0, 2), atol=1e-3)


def test_what_hangs_on_control_points_goes_along(face):
    hung = []
    for kind, numbers in (("VERTEX", (100, 0, 0)), ("VERTEX_3", (100, 101, 117))):
        child = bpy.data.objects.new(kind, None)
        bpy.context.scene.collection.objects.link(child)
        child.parent, child.parent_type, child.parent_vertices = face, kind, numbers
        child.location = (0.01, 0.02, 0.03)
        hung.append(child)
    hook = face.modifiers.new("Hook", "HOOK")
    hook.vertex_indices_set([100])
    bpy.context.view_layer.update()
    before = np.array([child.matrix_world for child in hung])
    spot = points(face)[100 % 16, 100 // 16]
    # Finer, then as coarse as the three points allow.
    for count in (40, 5):
        bpy.ops.bsface.surface_resample(control_points_u=count, control_points_v=count)
        bpy.context.view_layer.update()
        after = np.array([child.matrix_world for child in hung])
        np.testing.assert_allclose(after, before, atol=1e-6)
        assert hung[0].location[:] == pytest.approx((0.01, 0.02, 0.03))
        assert len(set(hung[1].parent_vertices)) == 3
        net = points(face).transpose(1, 0, 2).reshape(-1, 3)
        reach = 10 if count == 40 else 100
        assert np.linalg.norm(net[hung[0].parent_vertices[0]] - spot) < reach
        assert hung[0].parent_vertices[0] in list(hook.vertex_indices)


@pytest.mark.parametrize("side", ["BOTH", "LEFT", "RIGHT"])
def test_symmetrise(face, side):
    b = points(face)
    b[3, 4] += (1, 2, 3)
    surface_object.write(bpy.context, face, b)
    bpy.ops.bsface.surface_symmetrise(side=side)
    made = points(face)
    np.testing.assert_allclose(made[::-1] * (-1, 1, 1), made, atol=1e-4)


def test_expression_becomes_a_shape_key(face, solved):
    bpy.ops.bsface.expression_assign(
        expression="Smile", which="NAMED", photos="0.png|2.png"
    )
    neutral = points(face)
    bpy.ops.bsface.expression_key(expression="Smile")
    (request,) = solved
    assert [path.name for path in request.photos] == ["0.png", "2.png"]
    np.testing.assert_array_equal(request.start.control_points, neutral)
    np.testing.assert_array_equal(points(face), neutral)
    assert request.settings.modes == 0 and not request.settings.expressions
    bpy.ops.bsface.expression_assign(expression="Frown", which="NAMED", photos="1.png")
    bpy.ops.bsface.expression_key(expression="Frown")
    blocks = face.data.shape_keys.key_blocks
    # The new one is shown, alone.
    assert [key.value for key in blocks[1:]] == [0, 1]
    bpy.ops.bsface.surface_resample(control_points_u=20, control_points_v=21)
    blocks = face.data.shape_keys.key_blocks
    assert [(key.name, key.value) for key in blocks[1:]] == [("Smile", 0), ("Frown", 1)]
    with pytest.raises(RuntimeError, match="No ticked photo"):
        bpy.ops.bsface.expression_key(expression="Grin")
    with pytest.raises(RuntimeError, match="no photo"):
        bpy.ops.bsface.expression_assign(which="NAMED", photos="9.png")


def test_proportional_editing_reaches_a_feature_of_the_face(face):
    tool = bpy.context.tool_settings
    for before, after in ((1.0, 0.02), (0.005, 0.005)):
        tool.proportional_size = before
        bpy.ops.bsface.surface_net()
        assert tool.proportional_size == pytest.approx(after)
        bpy.ops.bsface.surface_net()


@pytest.mark.parametrize("way", ["origin", "apply"])
def test_a_net_that_was_moved_as_a_whole_is_told(face, capfd, way):
    bpy.ops.bsface.surface_resample(control_points_u=20, control_points_v=20)
    b = points(face)
    b[3, 4] += (1, 2, 30)
    surface_object.write(bpy.context, face, b)
    bpy.ops.bsface.view_photo()
    assert bpy.ops.bsface.surface_refit() == {"FINISHED"}
    assert "moved or scaled" not in capfd.readouterr().out
    if way == "origin":
        bpy.ops.object.origin_set(type="ORIGIN_GEOMETRY")
    else:
        face.scale = (2, 2, 2)
        bpy.ops.object.transform_apply()
    bpy.ops.bsface.view_photo()
    assert "The whole net of Ann was moved or scaled" in capfd.readouterr().out
    for name in ("surface_refit", "surface_symmetrise"):
        with pytest.raises(RuntimeError, match="whole net of Ann was moved or scaled"):
            getattr(bpy.ops.bsface, name)()
    assert bpy.ops.bsface.surface_refit(hold="NONE") == {"FINISHED"}
    assert bpy.ops.bsface.surface_symmetrise() == {"FINISHED"}


def test_odd_numbers_of_a_script_are_refused(face):
    for name, given in (
        ("surface_symmetrise", {"amount": float("nan")}),
        ("surface_refit", {"softness": float("nan")}),
    ):
        with pytest.raises(RuntimeError, match=r"^Error: The (amount|softness) "):
            getattr(bpy.ops.bsface, name)(**given)
    bpy.ops.bsface.surface_resample(control_points_u=5, control_points_v=130)
    with pytest.raises(RuntimeError, match="5 x 130 control points, .* Resample first"):
        bpy.ops.bsface.surface_refit()


@pytest.mark.parametrize("name", ["surface_resample", "surface_symmetrise"])
def test_edit_mode_comes_back(face, name):
    bpy.ops.bsface.surface_net()
    assert getattr(bpy.ops.bsface, name)() == {"FINISHED"} and face.mode == "EDIT"


def test_a_copy_of_the_coarse_net_does_not_take_the_edit_back(face):
    coarse_editor = load("bsface_addon.coarse_editor")
    bpy.ops.bsface.coarse_edit()
    net = coarse_editor.editor()
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.object.duplicate()
    bpy.context.object.name, net.name = "A", "Z"
    surface_object.write(bpy.context, net, points(net) + (0, 0, 5))
    bpy.ops.bsface.coarse_done()
    edited = points(face)
    assert coarse_editor.editor() is None and "A" in bpy.data.objects
    coarse_editor.follow(bpy.context)
    np.testing.assert_array_equal(points(face), edited)


@pytest.mark.parametrize("keep", [True, False])
def test_a_coarse_net_without_points_can_be_left(face, keep):
    before = points(face)
    bpy.ops.bsface.coarse_edit()
    bpy.ops.curve.select_all(action="SELECT")
    bpy.ops.curve.delete(type="VERT")
    assert bpy.ops.bsface.coarse_done(keep=keep) == {"FINISHED"}
    assert "Ann Coarse Net" not in bpy.data.objects
    np.testing.assert_allclose(points(face), before, atol=1e-4)


@pytest.mark.parametrize("keep", [True, False])
@pytest.mark.parametrize("version", ["0.1", "now"])
def test_the_face_follows_its_coarse_net(face, keep, version):
    coarse_editor = load("bsface_addon.coarse_editor")
    if version == "0.1":
        b = points(face)
        del face[coordinates.UNIT_KEY]
        surface_object.write(bpy.context, face, b)
        face.matrix_world = coordinates.UPRIGHT * 0.001
    face.location.x = 0.3
    before = points(face)
    bpy.ops.bsface.coarse_edit()
    net = coarse_editor.editor()
    assert net.mode == "EDIT" and scene.active_face(bpy.context) == face
    assert net.matrix_world == face.matrix_world
    assert not bpy.ops.bsface.coarse_edit.poll()
    coarse_editor.follow(bpy.context)
    np.testing.assert_array_equal(points(face), before)
    bpy.ops.curve.select_all(action="SELECT")
    bpy.ops.transform.translate(value=(0, 0, 0.004))
    coarse_editor.follow(bpy.context)
    # A coarse net moved as a whole moves the whole face.
    np.testing.assert_allclose(points(face), before + (0, 4, 0), atol=2e-3)
    bpy.ops.bsface.coarse_done(keep=keep)
    moved = (0, 4, 0) if keep else (0, 0, 0)
    np.testing.assert_allclose(points(face), before + moved, atol=2e-3)
    assert coarse_editor.editor() is None and len(bpy.data.curves) == 1
    assert bpy.context.view_layer.objects.active == face


def test_a_coarse_edit_is_mirrored_on_request(face):
    coarse_editor = load("bsface_addon.coarse_editor")
    before = points(face)
    bpy.ops.bsface.coarse_edit()
    net = coarse_editor.editor()
    for mirror in (True, False):
        bpy.context.scene.bsface.mirror = mirror
        bpy.ops.object.mode_set(mode="OBJECT")
        if mirror:
            net.data.splines[0].points[6 * 12 + 2].co[1] -= 0.005
        bpy.ops.object.mode_set(mode="EDIT")
        coarse_editor.follow(bpy.context)
        moved = np.linalg.norm(points(face) - before, axis=2)
        left, right = moved[:8].max(), moved[8:].max()
        assert left > 1
        assert (right > 0.9 * left) == mirror
    bpy.ops.bsface.coarse_done()


# --- the object ----------------------------------------------------------------------


def test_everything_survives_saving(face, tmp_path):
    b = points(face)
    path = str(tmp_path / "a.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    face = bpy.context.scene.bsface.face
    np.testing.assert_array_equal(points(face), b)
    assert [row.name for row in bpy.context.scene.bsface.photos][0] == "0.png"
    bpy.ops.bsface.export(filepath=str(tmp_path / "ann.step"))
    bpy.ops.bsface.surface_refit()


def test_removing_the_face(face):
    bpy.ops.bsface.face_remove()
    assert not bpy.data.objects and not bpy.data.curves and not bpy.data.images
    assert bpy.context.scene.bsface.face is None


def test_holding_no_selected_point_is_refused(face, solved):
    with pytest.raises(RuntimeError, match="No control point of Ann is selected"):
        bpy.ops.bsface.surface_refit(hold="SELECTED")
    assert not solved


def test_no_chosen_row_is_told_with_the_remedy(face):
    bpy.context.scene.bsface.active_photo = 99
    with pytest.raises(RuntimeError, match="No photo is chosen; click one"):
        bpy.ops.bsface.photos_remove()
