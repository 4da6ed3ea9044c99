"""Refit, resample, symmetrise, maps, mesh, views, expressions, export, support."""

import sys

import bpy
import numpy as np
import pytest
from blender import faces
from blender.checkout import load
from mathutils import Vector

scene = load("bsface_addon.scene")
cameras = load("bsface_addon.cameras")
lights = load("bsface_addon.lights")
maps = load("bsface_addon.maps")
material = load("bsface_addon.material")
face_file = load("bsface_addon.face_file")
surface_object = load("bsface_addon.surface_object")
formats = load("core.formats")
errors = load("core.errors")
load_template = load("core.surface.template").load_template


@pytest.fixture
def face(addon, solved, tmp_path):
    """A face made by the operator."""
    bpy.ops.bsface.reconstruct(directory=str(tmp_path / "photos"), name="Ann")
    solved.clear()
    return bpy.context.scene.bsface.face


def points(face, key=None):
    return surface_object.read(face, key)


def test_without_a_face_the_buttons_say_why(addon):
    for name in ("surface_refit", "surface_map", "export", "view_photo", "face_remove"):
        assert not getattr(bpy.ops.bsface, name).poll()
    with pytest.raises(RuntimeError, match="Reconstruct first"):
        bpy.ops.bsface.surface_symmetrise()


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
    with pytest.raises(RuntimeError, match="not where they were"):
        bpy.ops.bsface.surface_refit()


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


@pytest.mark.parametrize("side", ["BOTH", "LEFT", "RIGHT"])
def test_symmetrise(face, side):
    b = points(face)
    b[3, 4] += (1, 2, 3)
    surface_object.write(bpy.context, face, b)
    bpy.ops.bsface.surface_symmetrise(side=side)
    made = points(face)
    np.testing.assert_allclose(made[::-1] * (-1, 1, 1), made, atol=1e-4)


@pytest.mark.parametrize("openings", [True, False])
def test_the_mesh_lies_on_the_surface_and_moves_with_its_keys(face, openings):
    bpy.ops.bsface.surface_to_mesh(density="LOW", openings=openings, keys=True)
    obj = bpy.data.objects["Ann mesh"]
    mesh = obj.data
    assert {len(polygon.vertices) for polygon in mesh.polygons} == {4}
    skin = np.array([p.material_index == 0 for p in mesh.polygons]).repeat(4)
    uv = np.empty(len(mesh.loops) * 2, np.float32)
    mesh.uv_layers["UVMap"].data.foreach_get("uv", uv)
    corner = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", corner)
    local = np.array([v.co for v in mesh.vertices])[corner]
    xyz = surface_object.from_local(face, local)[skin]
    at = uv.reshape(-1, 2).astype(float)[skin]
    away = np.linalg.norm(xyz - face_file.surface(face).evaluate(*at.T), axis=1)
    # Only the rims of the lids leave the surface, for the eyeballs behind them.
    assert (away > 1e-3).mean() < (0.03 if openings else 1e-9)
    assert mesh.materials[0] == face.data.materials[0]
    assert len(mesh.materials) == (3 if openings else 1)
    assert obj.matrix_world == face.matrix_world
    assert np.mean([polygon.normal.y for polygon in mesh.polygons]) < -0.3
    assert {"forehead", "nose", "lip_upper"} <= {g.name for g in obj.vertex_groups}
    names = load("core.rig.names").ARKIT_NAMES
    blocks = mesh.shape_keys.key_blocks
    assert [key.name for key in blocks[1:]] == list(names)
    assert all(key.value == 0 for key in blocks[1:])
    moved = [
        np.ptp(
            [p.co - q.co for p, q in zip(blocks[k].data, blocks[0].data, strict=True)]
        )
        for k in ("jawOpen", "tongueOut")
    ]
    assert moved[0] > 0.003 and moved[1] == 0


@pytest.mark.parametrize("textured", [True, False])
def test_the_head_holds_the_face_and_its_picture(face, textured):
    if textured:
        stripes = np.zeros((64, 64, 3), np.uint8)
        stripes[:32] = (200, 100, 50)  # the forehead
        stripes[32:] = (50, 200, 100)
        painted = maps.painted(stripes, load_template().outline_uv)
        material.store_map(face, "SKIN", painted)
        material.store_map(face, material.DETAIL, painted)
    bpy.ops.bsface.full_head(density="LOW", keys=True)
    obj = bpy.data.objects["Ann head"]
    mesh = obj.data
    xyz = surface_object.from_local(face, np.array([v.co for v in mesh.vertices]))
    grid = face_file.surface(face).grid(60, 60).reshape(-1, 3)
    assert np.ptp(xyz[:, 2]) > 1.5 * np.ptp(grid[:, 2]), "no back of the head"
    assert obj.matrix_world == face.matrix_world
    assert {"ear_left", "scalp", "neck", "nose"} <= {g.name for g in obj.vertex_groups}
    assert len(mesh.shape_keys.key_blocks) == 53
    assert mesh.materials[0] not in list(face.data.materials)
    nodes = mesh.materials[0].node_tree.nodes
    pictures = [node.image for node in nodes if node.type == "TEX_IMAGE"]
    assert len(pictures) == 2 * textured
    assert ("Normal Map" in nodes) == textured
    if not textured:
        return
    bent = nodes["Normal Map"].inputs["Color"].links[0].from_node.image
    assert bent.colorspace_settings.name == "Non-Color"
    np.testing.assert_allclose(bent.pixels[:3], (0.5, 0.5, 1.0), atol=0.003)
    skin = nodes.active.image
    side = skin.size[0]
    pixels = np.array(skin.pixels[:]).reshape(side, side, -1)
    uv = np.empty(len(mesh.loops) * 2, np.float32)
    mesh.uv_layers["UVMap"].data.foreach_get("uv", uv)
    corner = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", corner)
    index = (uv.reshape(-1, 2) * side).astype(int).clip(0, side - 1)
    colour = np.zeros((len(mesh.vertices), 3))
    # The picture's rows and the coordinates both run up from the lower border.
    colour[corner] = pixels[index[:, 1], index[:, 0], :3]
    groups = {g.name: g.index for g in obj.vertex_groups}
    for name, channel in (("forehead", 0), ("jaw", 1)):
        members = [
            v.index
            for v in mesh.vertices
            if any(g.group == groups[name] for g in v.groups)
        ]
        assert colour[members].mean(axis=0).argmax() == channel


def test_arkit_keys_add_up_on_the_surface(face):
    neutral = points(face)
    bpy.ops.bsface.arkit_keys()
    blocks = face.data.shape_keys.key_blocks
    keys = load("core.rig.arkit").arkit_keys(face_file.saved(face))
    assert [key.name for key in blocks[1:]] == list(keys)
    assert all(key.value == 0 for key in blocks[1:])
    np.testing.assert_array_equal(points(face), neutral)
    for name in ("jawOpen", "mouthSmileLeft"):
        np.testing.assert_allclose(points(face, name) - neutral, keys[name], atol=1e-4)
        assert np.abs(keys[name]).max() > 1
    # Once more: the same keys, not twice as many.
    bpy.ops.bsface.arkit_keys()
    assert len(blocks) == 53


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
    assert [key.value for key in blocks] == [0, 0, 1]
    bpy.ops.bsface.surface_resample(control_points_u=20, control_points_v=21)
    blocks = face.data.shape_keys.key_blocks
    assert [(key.name, key.value) for key in blocks[1:]] == [("Smile", 0), ("Frown", 1)]
    with pytest.raises(RuntimeError, match="No ticked photo"):
        bpy.ops.bsface.expression_key(expression="Grin")
    with pytest.raises(RuntimeError, match="no photo"):
        bpy.ops.bsface.expression_assign(which="NAMED", photos="9.png")


@pytest.mark.parametrize(
    "kind", [".step", ".igs", ".nurbs.obj", ".obj", ".ply", ".glb", ".stl", ".3mf"]
)
def test_export_writes_the_edited_surface(face, tmp_path, kind):
    # The chosen format takes the place of another format's ending.
    bpy.ops.bsface.export(filepath=str(tmp_path / "ann.iges"), kind=kind)
    bpy.ops.bsface.export(filepath=str(tmp_path / f"bea{kind}"))
    sizes = [(tmp_path / f"{name}{kind}").stat().st_size for name in ("ann", "bea")]
    assert min(sizes) > 1000
    assert len(list(tmp_path.glob("ann*"))) == 1


@pytest.mark.parametrize("openings", [True, False])
def test_an_fbx_file_holds_the_mesh_upright_in_metres(face, tmp_path, openings):
    mesh = load("core.rig.mesh")
    made = mesh.quad_mesh(
        face_file.saved(face), "low", eyes=openings, mouth=openings, keys=openings
    )
    path = tmp_path / "Ann.fbx"
    bpy.ops.bsface.surface_map(kind="PLAIN")
    material.store_map(
        face,
        "SKIN",
        load("bsface_addon.maps").normals(
            face_file.surface(face), face_file.outline(face)
        ),
    )
    relief = load("core.texture.detail")
    bent = np.full((32, 32, 3), (0.6, 0.0, 0.8), np.float32)
    detail = relief.Detail(np.zeros((32, 32), np.float32), bent)
    material.store_map(
        face, material.DETAIL, load("bsface_addon.maps").detail_map(detail)
    )
    bpy.ops.bsface.export(
        filepath=str(path), kind=".fbx", density="LOW", openings=openings, keys=openings
    )
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.wm.fbx_import(filepath=str(path))
    (obj,) = bpy.data.objects
    assert obj.name == "Ann" and len(obj.data.polygons) == len(made.quads)
    np.testing.assert_allclose(obj.scale, 1, atol=1e-6)
    assert {len(polygon.vertices) for polygon in obj.data.polygons} == {4}
    # Metres, upright: the core's y is up, its z towards the viewer.
    upright = made.points[:, [0, 2, 1]] * (1, -1, 1) / 1000
    xyz = np.array([obj.matrix_world @ v.co for v in obj.data.vertices])
    np.testing.assert_allclose(xyz, upright, atol=2e-6)
    # What the corners have: the order of the quads is the same.
    uv = np.empty(len(obj.data.loops) * 2, np.float32)
    obj.data.uv_layers[0].data.foreach_get("uv", uv)
    expected = made.uv[made.quads.ravel()] * (1, -1) + (0, 1)
    np.testing.assert_allclose(uv.reshape(-1, 2), expected, atol=1e-6)
    keys = obj.data.shape_keys
    assert (keys is None) == (not openings)
    if openings:
        names = [block.name for block in keys.key_blocks[1:]]
        assert names == list(made.keys) and len(names) == 52
        jaw = np.array([p.co for p in keys.key_blocks["jawOpen"].data])
        jaw = np.array([obj.matrix_world @ Vector(p) for p in jaw])
        moved = made.keys["jawOpen"][:, [0, 2, 1]] * (1, -1, 1) / 1000
        np.testing.assert_allclose(jaw - xyz, moved, atol=2e-6)
    pictures = [i for i in bpy.data.images if i.size[0] > 1]
    assert len(pictures) == (3 if openings else 2)
    assert len(obj.data.materials) == (3 if openings else 1)
    (bump,) = [
        node
        for node in obj.data.materials[0].node_tree.nodes
        if node.type == "NORMAL_MAP"
    ]
    found = bump.inputs["Color"].links[0].from_node.image
    assert found.name == "Ann_normal.png"
    assert found.colorspace_settings.name == "Non-Color"
    np.testing.assert_allclose(found.pixels[:3], (204 / 255, 128 / 255, 230 / 255))
    assert bump.outputs["Normal"].links[0].to_node.type == "BSDF_PRINCIPLED"


def test_an_fbx_file_that_blender_cannot_write_is_told(face, tmp_path):
    wanted = load("bsface_addon.export_face").FileToWrite(
        tmp_path / "Ann.fbx",
        face_file.stored(face),
        load("core.formats.options").ExportOptions(name="Ann", density="low"),
        blender=(sys.executable, "-c", "raise SystemExit('out of order')"),
    )
    with pytest.raises(errors.ReconstructionError, match=r"Ann\.fbx.*out of order"):
        load("bsface_addon.export_face").write(wanted)
    assert not (tmp_path / "Ann.fbx").exists()


def test_export_of_the_head(face, tmp_path):
    for name, head in (("face", False), ("head", True)):
        path = str(tmp_path / f"{name}.obj")
        bpy.ops.bsface.export(filepath=path, head=head, density="LOW")
    eyes = ["usemtl eyes" in p.read_text() for p in sorted(tmp_path.glob("*.obj"))]
    assert eyes == [False, True]
    path = str(tmp_path / "head.fbx")
    bpy.ops.bsface.export(
        filepath=path, kind=".fbx", head=True, density="LOW", keys=False
    )
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.wm.fbx_import(filepath=path)
    (obj,) = bpy.data.objects
    assert obj.dimensions.y > 0.18, "the back of the head is there"


def test_face_file_has_the_control_points_of_the_object(face, tmp_path):
    b = points(face)
    b[2, 3] += (4, 5, 6)
    surface_object.write(bpy.context, face, b)
    bpy.ops.bsface.export(filepath=str(tmp_path / "ann.npz"))
    saved = formats.load_face(tmp_path / "ann.npz")
    np.testing.assert_array_equal(saved.surface.control_points, points(face))
    assert [row.status for row in saved.reports][:3] == ["used"] * 3
    assert len(saved.cameras) == 3


def test_export_to_an_impossible_place_is_one_sentence(face, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RuntimeError, match="cannot be written"):
        bpy.ops.bsface.export(filepath=str(tmp_path / "file" / "ann.step"))
    with pytest.raises(RuntimeError, match="unknown ending"):
        bpy.ops.bsface.export(filepath=str(tmp_path / "ann.xyz"))


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


def test_reset_and_presets(addon):
    state = bpy.context.scene.bsface
    state.settings.method, state.settings.control_points_u = "motion", 20
    bpy.ops.bsface.preset_add(name="quick")
    bpy.ops.bsface.reset()
    settings_group = load("bsface_addon.settings_group")
    assert settings_group.to_core(state.settings) == load("core.settings").Settings()
    path = next(
        f"{folder}/quick.py" for folder in bpy.utils.preset_paths("bsface/settings")
    )
    bpy.ops.script.execute_preset(filepath=path, menu_idname="BSFACE_MT_presets")
    assert state.settings.method == "motion" and state.settings.control_points_u == 20


def test_system_information_names_the_versions(addon):
    messages = load("bsface_addon.messages")
    text = messages.system_information()
    assert bpy.app.version_string in text and "scipy" in text
    assert bpy.ops.bsface.copy_information() == {"FINISHED"}


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


def test_proportional_editing_reaches_a_feature_of_the_face(face):
    tool = bpy.context.tool_settings
    for before, after in ((1.0, 0.02), (0.005, 0.005)):
        tool.proportional_size = before
        bpy.ops.bsface.surface_net()
        assert tool.proportional_size == pytest.approx(after)
        bpy.ops.bsface.surface_net()


def test_formats_without_their_package_are_not_offered():
    export = load("bsface_addon.operators.export")
    assert (".step", "STEP") in export.available()
    kinds = {kind for kind, _ in export.available({".3dm": "no_such_package"})}
    assert kinds == {kind for kind, _, _ in export.FORMATS} - {".3dm"}


@pytest.mark.parametrize("keep", [True, False])
@pytest.mark.parametrize("version", ["0.1", "now"])
def test_the_face_follows_its_coarse_net(face, keep, version):
    coarse_editor = load("bsface_addon.coarse_editor")
    if version == "0.1":
        b = points(face)
        del face[surface_object.UNIT_KEY]
        surface_object.write(bpy.context, face, b)
        face.matrix_world = surface_object.UPRIGHT * 0.001
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
