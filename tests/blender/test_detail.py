"""The normal map on the face in Blender."""

import math

import cv2
import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="needs Blender's module bpy")

from blender.checkout import load  # noqa: E402
from fake_face import face_surface  # noqa: E402
from mathutils import Vector  # noqa: E402

export_face = load("bsface_addon.export_face")
maps = load("bsface_addon.maps")
material = load("bsface_addon.material")
mesh_copy = load("bsface_addon.mesh_copy")
surface_object = load("bsface_addon.surface_object")
load_template = load("core.surface.template").load_template
relief = load("core.texture.detail")


def dome(face_points):
    """A detail with one bump in the middle of the patch."""
    size = 128
    at = (np.arange(size) + 0.5) / size
    u, v = np.meshgrid(at, at)
    height = 3 * np.exp(-((u - 0.5) ** 2 + (v - 0.5) ** 2) / 0.004).astype(np.float32)
    surface = load("core.surface.bspline").BSplineSurface(face_points)
    normals = relief.tangent_normals(height, relief.tangents_of(surface, size))
    return relief.Detail(height, normals)


def test_the_exported_map_is_that_of_the_library(tmp_path):
    found = dome(face_surface(nose=0).control_points)
    path = tmp_path / "normal.png"
    export_face.write_detail(path, maps.detail_map(found).png)
    written = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., ::-1]
    expected = relief.normal_picture(found)
    assert written.dtype == np.uint8
    assert np.abs(written.astype(int) - expected).max() <= 1
    assert (written[0, 0] == (128, 128, 255)).all()


def test_the_head_has_the_normal_map_of_its_face():
    found = dome(face_surface(nose=0).control_points)
    of_face = maps.detail_map(found).png
    of_head = maps.head(of_face, load_template(), detail=True)
    face, head = (
        cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
        for png in (of_face, of_head)
    )
    # The bottom row is the forehead: a quarter of the picture below the square.
    left, bottom = 32, 192 - 48
    square = head[bottom - 128 : bottom, left : left + 128]
    assert head.dtype == np.uint16 and np.ptp(face[40:88, 40:88, 1].astype(int)) > 1e4
    np.testing.assert_array_equal(square[32:96, 32:96], face[32:96, 32:96])
    around = np.concatenate([head[0], head[-1], head[:, 0], head[:, -1]])
    assert (around == (65535, 32768, 32768)).all()


def test_a_bump_of_the_normal_map_is_lit_from_above(empty_scene, tmp_path):
    """On Blender's own surface: its v runs down, so green and rows are turned."""
    points = face_surface(nose=0).control_points
    face = surface_object.create(bpy.context, "Bumpy", points)
    detail = maps.detail_map(dome(points)).png
    material.store_map(face, "DETAIL", maps.Map(detail))
    image = material.stored_map(face, "DETAIL")
    assert image.colorspace_settings.name == "Non-Color"
    assert "DETAIL" not in material.stored_kinds(face)
    light = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    light.rotation_euler = (math.radians(40), 0, 0)  # from above and in front
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale = "ORTHO", 0.06
    middle = face.matrix_world @ Vector(face.bound_box[0]).lerp(
        Vector(face.bound_box[6]), 0.5
    )
    camera.location = middle + Vector((0, -1, 0))
    camera.rotation_euler = (math.radians(90), 0, 0)
    scene = bpy.context.scene
    for obj in (light, camera):
        scene.collection.objects.link(obj)
    scene.camera = camera
    scene.render.engine, scene.cycles.samples = "CYCLES", 4
    scene.render.resolution_x = scene.render.resolution_y = 32
    scene.render.filepath = str(tmp_path / "lit.png")
    lit = rendered(scene)
    material.drop_others(face, ())
    flat = rendered(scene)
    change = lit - flat
    assert change[8:15, 12:20].mean() > 5
    assert change[17:24, 12:20].mean() < -5
    # On a mesh of quads with the head's picture it is the same.
    patch = grid_mesh(face_surface(nose=0), 40)
    obj = mesh_copy.add(face, mesh_copy.local_mesh(patch, 0.001), "head")
    face.hide_render = True
    png = maps.head(detail, load_template(), detail=True)
    obj.data.materials[0] = mesh_copy.head_skin(face, b"", png)
    lit = rendered(scene)
    obj.data.materials[0] = mesh_copy.head_skin(face, b"")
    change = lit - rendered(scene)
    assert change[8:15, 12:20].mean() > 5
    assert change[17:24, 12:20].mean() < -5


def rendered(scene):
    bpy.ops.render.render(write_still=True)
    return cv2.imread(scene.render.filepath, cv2.IMREAD_GRAYSCALE).astype(float)


def grid_mesh(surface, cells):
    """Quads all over a surface, with places in the head's picture."""
    at = np.linspace(0, 1, cells + 1)
    u, v = (x.ravel() for x in np.meshgrid(at, at, indexing="ij"))
    first = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    quads = first[:, None] + (0, 1, cells + 2, cells + 1)
    left, top, side = load("core.rig.base_head").SQUARE
    return load("core.rig.mesh").QuadMesh(
        points=surface.evaluate(u, v),
        quads=quads,
        uv=np.stack([left + side * u, top + side * v], axis=1),
        groups={},
        part=np.zeros(len(quads), np.int64),
    )
