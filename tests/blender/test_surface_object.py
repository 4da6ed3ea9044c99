"""The native surface: what Blender evaluates is what the core evaluates."""

import bpy
import numpy as np
import pytest
from blender.checkout import load
from mathutils import Matrix, Vector

coordinates = load("bsface_addon.coordinates")
surface_object = load("bsface_addon.surface_object")
bspline = load("core.surface.bspline")
# Half a unit in the last place of coordinates below 0.25 m.
FLOAT32_MM = 1.6e-5


def face_like(m, n):
    """A bumpy, unsymmetric patch 140 mm wide."""
    u, v = np.meshgrid(np.linspace(-1, 1, m), np.linspace(-1, 1, n), indexing="ij")
    z = 60 * np.sqrt(np.maximum(0.05, 1.6 - u**2 - 0.5 * v**2)) + 9 * np.sin(5 * u * v)
    return np.stack([70 * u + 4 * v**2, -95 * v + 3 * u, z], axis=2)


def evaluated(obj):
    depsgraph = bpy.context.evaluated_depsgraph_get()
    mesh = obj.evaluated_get(depsgraph).to_mesh()
    xyz = np.empty(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", xyz)
    obj.evaluated_get(depsgraph).to_mesh_clear()
    return coordinates.from_local(obj, xyz.reshape(-1, 3).astype(float))


@pytest.mark.parametrize("count", [(40, 40), (7, 12)])
@pytest.mark.parametrize("resolution", [2, 5])
def test_blender_evaluates_the_core_surface(empty_scene, count, resolution):
    points = face_like(*count)
    obj = surface_object.create(bpy.context, "face", points)
    surface_object.set_resolution(obj, resolution)
    m, n = count
    expected = bspline.BSplineSurface(points).grid(m * resolution, n * resolution)
    width = np.ptp(expected[..., 0])
    error = np.abs(evaluated(obj) - expected.reshape(-1, 3)).max()
    assert error <= 1e-5 * width


def test_normals_point_out_of_the_face(empty_scene):
    obj = surface_object.create(bpy.context, "face", face_like(12, 10))
    depsgraph = bpy.context.evaluated_depsgraph_get()
    mesh = obj.evaluated_get(depsgraph).to_mesh()
    assert np.mean([polygon.normal.y for polygon in mesh.polygons]) < -0.5
    assert all(polygon.use_smooth for polygon in mesh.polygons)


def test_reading_back_returns_what_was_written_but_for_float32(empty_scene):
    points = face_like(9, 6)
    obj = surface_object.create(bpy.context, "face", points)
    back = surface_object.read(obj)
    assert back.dtype == np.float64
    np.testing.assert_allclose(back, points, atol=FLOAT32_MM)
    assert surface_object.shape(obj) == (9, 6)


def test_surface_flags(empty_scene):
    obj = surface_object.create(bpy.context, "face", face_like(5, 4))
    spline = obj.data.splines[0]
    assert (spline.order_u, spline.order_v) == (4, 4)
    assert not (spline.use_endpoint_u or spline.use_endpoint_v)
    assert not (spline.use_cyclic_u or spline.use_cyclic_v)
    assert surface_object.is_surface(obj)


def test_same_size_is_written_in_place(empty_scene):
    obj = surface_object.create(bpy.context, "face", face_like(6, 6))
    data = obj.data
    surface_object.write(bpy.context, obj, face_like(6, 6) * 2)
    assert obj.data == data
    np.testing.assert_allclose(
        surface_object.read(obj), face_like(6, 6) * 2, atol=FLOAT32_MM
    )


def test_other_size_keeps_object_and_materials(empty_scene):
    obj = surface_object.create(bpy.context, "face", face_like(6, 6))
    material = bpy.data.materials.new("skin")
    obj.data.materials.append(material)
    surface_object.set_resolution(obj, 7)
    surface_object.write(bpy.context, obj, face_like(8, 5))
    assert surface_object.shape(obj) == (8, 5)
    assert obj.data.materials[0] == material
    assert obj.data.resolution_u == 7
    assert len(bpy.data.curves) == 1 and len(bpy.data.objects) == 1


def test_edits_of_the_artist_are_read_in_edit_mode(empty_scene):
    obj = surface_object.create(bpy.context, "face", face_like(6, 6))
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.curve.select_all(action="SELECT")
    bpy.ops.transform.translate(value=(0.001, -0.003, 0.002))
    back = surface_object.read(obj)
    np.testing.assert_allclose(back, face_like(6, 6) + [1, 2, 3], atol=1e-4)
    assert surface_object.selected(obj).all()
    bpy.ops.object.mode_set(mode="OBJECT")


def test_selection_has_the_order_of_the_control_points(empty_scene):
    obj = surface_object.create(bpy.context, "face", face_like(6, 5))
    obj.data.splines[0].points[3 * 6 + 2].select = True
    expected = np.zeros((6, 5), bool)
    expected[2, 3] = True
    np.testing.assert_array_equal(surface_object.selected(obj), expected)


def test_shape_key_keeps_the_order_and_the_basis(empty_scene):
    points = face_like(6, 5)
    obj = surface_object.create(bpy.context, "face", points)
    smile = points + np.linspace(0, 3, 90).reshape(6, 5, 3)
    surface_object.add_shape_key(obj, "Smile", smile)
    np.testing.assert_allclose(surface_object.read(obj), points, atol=FLOAT32_MM)
    smiling = surface_object.read(obj, "Smile")
    np.testing.assert_allclose(smiling, smile, atol=FLOAT32_MM)
    obj.data.shape_keys.key_blocks["Smile"].value = 1.0
    surface_object.set_resolution(obj, 2)
    expected = bspline.BSplineSurface(smile).grid(12, 10).reshape(-1, 3)
    assert np.abs(evaluated(obj) - expected).max() < 1e-3


def test_shape_keys_move_along_with_the_basis(empty_scene):
    points = face_like(6, 5)
    obj = surface_object.create(bpy.context, "face", points)
    surface_object.add_shape_key(obj, "Smile", points + (0, 2, 1))
    surface_object.write(bpy.context, obj, points * 1.1)
    smile = surface_object.read(obj, "Smile")
    np.testing.assert_allclose(smile, points * 1.1 + (0, 2, 1), atol=1e-4)
    surface_object.remove_shape_keys(obj)
    assert obj.data.shape_keys is None
    np.testing.assert_allclose(surface_object.read(obj), points * 1.1, atol=1e-4)


def test_creation_restores_active_object_selection_and_mode(empty_scene):
    mesh = bpy.data.meshes.new("other")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
    other = bpy.data.objects.new("other", mesh)
    empty_scene.collection.objects.link(other)
    bpy.context.view_layer.objects.active = other
    other.select_set(True)
    bpy.ops.object.mode_set(mode="EDIT")
    obj = surface_object.create(bpy.context, "face", face_like(5, 5))
    assert bpy.context.view_layer.objects.active == other
    assert other.mode == "EDIT" and other.select_get() and not obj.select_get()
    bpy.ops.object.mode_set(mode="OBJECT")


@pytest.mark.parametrize(
    "bad", [np.zeros((3, 9, 3)), np.zeros((5, 5)), np.full((5, 5, 3), np.nan)]
)
def test_bad_control_points_leave_nothing_behind(empty_scene, bad):
    with pytest.raises(ValueError, match="control points"):
        surface_object.create(bpy.context, "face", bad)
    assert not bpy.data.objects and not bpy.data.curves


def test_the_object_itself_has_no_scale_and_no_rotation(empty_scene):
    empty_scene.unit_settings.scale_length = 0.01
    points = face_like(5, 5)
    obj = surface_object.create(bpy.context, "face", points, scale=2.0)
    assert obj.matrix_world == Matrix()
    # Twice life size in centimetres, upright in Blender's front view.
    x, y, z = np.moveaxis(0.2 * points, -1, 0)
    stored = np.array([point.co[:3] for point in obj.data.splines[0].points])
    expected = np.stack([x, -z, y], -1).transpose(1, 0, 2).reshape(-1, 3)
    np.testing.assert_allclose(stored, expected, atol=1e-5)
    frame = coordinates.world_frame(obj)
    np.testing.assert_allclose(
        [frame @ Vector(p) for p in points[0]], np.stack([x, -z, y], -1)[0], atol=1e-5
    )
    local = coordinates.to_local(obj, points)
    np.testing.assert_allclose(coordinates.from_local(obj, local), points)


def test_objects_of_the_first_version_keep_their_own_coordinates(empty_scene):
    """They hold millimetres and the core's axes; their matrix makes them life size."""
    obj = surface_object.create(bpy.context, "face", face_like(6, 5))
    points = np.zeros((30, 4), np.float32)
    points[:, :3] = face_like(6, 5).transpose(1, 0, 2).reshape(-1, 3)
    points[:, 3] = 1
    del obj[coordinates.UNIT_KEY]
    obj.data.splines[0].points.foreach_set("co", points.ravel())
    obj.matrix_world = coordinates.UPRIGHT @ Matrix.Scale(0.001, 4)
    np.testing.assert_allclose(surface_object.read(obj), face_like(6, 5), atol=1e-5)
    assert coordinates.world_frame(obj) == obj.matrix_world
    moved = face_like(6, 5) + (1, 2, 3)
    surface_object.write(bpy.context, obj, moved)
    surface_object.add_shape_key(obj, "Smile", moved + 1)
    np.testing.assert_allclose(surface_object.read(obj), moved, atol=1e-4)
    np.testing.assert_allclose(surface_object.read(obj, "Smile"), moved + 1, atol=1e-4)


def test_survives_saving_and_loading(empty_scene, tmp_path):
    points = face_like(6, 6)
    surface_object.create(bpy.context, "face", points)
    path = str(tmp_path / "face.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    back = surface_object.read(bpy.data.objects["face"])
    np.testing.assert_allclose(back, points, atol=FLOAT32_MM)


def test_a_view_that_shows_no_surfaces_is_no_hindrance(empty_scene):
    areas = [a for a in bpy.context.window.screen.areas if a.type == "VIEW_3D"]
    if not areas:
        pytest.skip("this build of Blender has no 3D view")
    region = next(r for r in areas[0].regions if r.type == "WINDOW")
    areas[0].spaces.active.show_object_viewport_surf = False
    with bpy.context.temp_override(area=areas[0], region=region):
        obj = surface_object.create(bpy.context, "face", face_like(6, 5))
        surface_object.write(bpy.context, obj, face_like(7, 9))
    assert surface_object.shape(obj) == (7, 9)
