"""Files of a face: every format, what they hold, and where they cannot be written."""

import sys

import bpy
import numpy as np
import pytest
from blender.checkout import load
from blender.faces import points
from mathutils import Vector

material = load("bsface_addon.material")
face_file = load("bsface_addon.face_file")
surface_object = load("bsface_addon.surface_object")
formats = load("core.formats")
errors = load("core.errors")


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


def test_formats_without_their_package_are_not_offered():
    export = load("bsface_addon.operators.export")
    assert (".step", "STEP") in export.available()
    kinds = {kind for kind, _ in export.available({".3dm": "no_such_package"})}
    assert kinds == {kind for kind, _, _ in export.FORMATS} - {".3dm"}


def test_no_photo_is_written_over(face, tmp_path):
    """The skin of an OBJ mesh, or of Save Texture, may have the name of a photo."""
    photo = tmp_path / "photos" / "0.png"
    before = photo.read_bytes()
    with pytest.raises(RuntimeError, match=r"0\.png belongs to the photos"):
        bpy.ops.bsface.export(filepath=str(photo.with_name("0.obj")), kind=".obj")
    bpy.ops.bsface.surface_map(kind="NORMALS")
    with pytest.raises(RuntimeError, match=r"0\.png belongs to the photos"):
        bpy.ops.bsface.texture_save(filepath=str(photo))
    # The mask of a photo that is in a list only.
    mask = tmp_path / "others" / "1.mask.png"
    mask.parent.mkdir()
    (tmp_path / "photos" / "1.png").rename(mask.with_name("1.png"))
    mask.write_bytes(b"mine")
    bpy.ops.bsface.photos_add(directory=str(mask.parent))
    with pytest.raises(RuntimeError, match=r"1\.mask\.png belongs to the photos"):
        bpy.ops.bsface.texture_save(filepath=str(mask))
    assert photo.read_bytes() == before and mask.read_bytes() == b"mine"
    assert not photo.with_suffix(".obj").exists()


def test_a_texture_keeps_the_whole_name(face, tmp_path):
    bpy.ops.bsface.surface_map(kind="NORMALS")
    (tmp_path / "Ann.png").write_bytes(b"mine")
    bpy.ops.bsface.texture_save(filepath=str(tmp_path / "Ann.v2"))
    assert (tmp_path / "Ann.png").read_bytes() == b"mine"
    assert (tmp_path / "Ann.v2.png").stat().st_size > 100


def test_the_endings_that_are_named_include_fbx(face, tmp_path):
    with pytest.raises(RuntimeError, match=r"unknown ending.*\.fbx"):
        bpy.ops.bsface.export(filepath=str(tmp_path / "ann.xyz"))
