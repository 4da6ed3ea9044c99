"""Faces of other .blend files, and operators that scripts call with wrong files."""

from pathlib import Path

import bpy
import numpy as np
import pytest
from blender import faces
from blender.checkout import load
from blender.faces import points

scene = load("bsface_addon.scene")
selection = load("bsface_addon.selection")
cameras = load("bsface_addon.cameras")
skin_pictures = load("bsface_addon.skin_pictures")
SkinMask = load("core.photometry.skin").SkinMask

CHANGERS = (
    "surface_refit",
    "surface_resample",
    "surface_symmetrise",
    "surface_map",
    "surface_trim",
    "surface_net",
    "coarse_edit",
    "arkit_keys",
    "expression_key",
    "face_remove",
)


@pytest.fixture
def brought(face, tmp_path):
    """Brings the face of a saved file into a new one."""
    path = str(tmp_path / "people.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)

    def bring(link):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        with bpy.data.libraries.load(path, link=link) as (_, into):
            into.objects = ["Ann"]
        (ann,) = into.objects
        bpy.context.scene.collection.objects.link(ann)
        bpy.context.view_layer.objects.active = ann
        return ann

    return bring


@pytest.mark.parametrize("way", ["linked", "override"])
def test_a_linked_face_is_read_but_not_changed(brought, tmp_path, way):
    ann = brought(link=True)
    if way == "override":
        ann = ann.override_create(remap_local_usages=True)
        bpy.context.view_layer.objects.active = ann
    before = points(ann)
    for name in CHANGERS:
        with pytest.raises(RuntimeError, match="Ann is linked .* make it local"):
            getattr(bpy.ops.bsface, name)()
    photos = str(tmp_path / "photos")
    with pytest.raises(RuntimeError, match="Ann is linked .* make it local"):
        bpy.ops.bsface.reconstruct(directory=photos)
    assert (points(ann) == before).all()
    bpy.ops.bsface.export(filepath=str(tmp_path / "ann.step"))
    bpy.ops.bsface.surface_to_mesh(density="LOW", keys=False)
    # The remedy of the sentence, and a face beside the linked one.
    assert bpy.ops.bsface.reconstruct(directory=photos, separate=True) == {"FINISHED"}
    selection.select_only(bpy.context, ann)
    bpy.ops.object.make_local(type="SELECT_OBDATA")
    assert bpy.ops.bsface.surface_symmetrise() == {"FINISHED"}


@pytest.mark.parametrize("way", ["linked", "override"])
def test_a_face_in_a_linked_collection(face, solver, tmp_path, way):
    half = np.ones((faces.SIZE[1] // 4, faces.SIZE[0] // 4), np.float32)
    photo = solver.answer.result.photos[0]
    skin = skin_pictures.measured(SkinMask(half, (0.0, 0.0, 0.25)), photo)
    for view in cameras.of_face(face):
        view[cameras.SKIN_KEY] = skin
    path = str(tmp_path / "people.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    now = bpy.context.scene
    with bpy.data.libraries.load(path, link=True) as (_, into):
        into.collections = ["BSface Ann"]
    (home,) = into.collections
    now.collection.children.link(home)
    if way == "override":
        home = home.override_hierarchy_create(now, bpy.context.view_layer)
    bpy.context.view_layer.objects.active = home.objects["Ann"]
    given = {"density": "LOW", "keys": False}
    assert bpy.ops.bsface.surface_to_mesh(**given) == {"FINISHED"}
    assert bpy.ops.bsface.full_head(**given) == {"FINISHED"}
    assert [obj.type for obj in now.collection.objects] == ["MESH", "MESH"]
    # The tint would be a change of its cameras.
    with pytest.raises(RuntimeError, match="Ann is linked .* make it local"):
        bpy.ops.bsface.skin_show()
    now.bsface.show_skin = True
    assert bpy.ops.bsface.view_photo() == {"FINISHED"}
    assert len(now.camera.data.background_images) == 1


def test_an_appended_face_is_refitted_to_its_own_photos(brought, solved):
    ann = brought(link=False)
    assert bpy.ops.bsface.surface_refit() == {"FINISHED"}
    assert {path.parent.name for path in solved[-1].photos} == {"photos"}
    assert len(load("bsface_addon.cameras").of_face(ann)) == 3


@pytest.mark.parametrize("filepath", ["", "{}", "{}/"])
def test_a_file_without_a_name_is_refused(face, tmp_path, monkeypatch, filepath):
    monkeypatch.chdir(tmp_path)
    before = {path.name for path in tmp_path.iterdir()}
    with pytest.raises(RuntimeError, match="is a folder; give the file"):
        bpy.ops.bsface.export(filepath=filepath.format(tmp_path), kind=".step")
    assert {path.name for path in tmp_path.iterdir()} == before


def test_photos_that_are_not_there_are_not_listed(addon, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RuntimeError, match="Choose a folder"):
        bpy.ops.bsface.photos_add()
    with pytest.raises(RuntimeError, match="no file .*none.png; choose another"):
        bpy.ops.bsface.photos_add(directory=str(tmp_path), files=[{"name": "none.png"}])
    assert not bpy.context.scene.bsface.photos


def test_a_constraint_of_the_user_on_the_rig(face):
    rig = load("bsface_addon.rig").find(face)
    rig.constraints.new("LIMIT_LOCATION")
    rig.constraints.move(1, 0)
    assert bpy.ops.bsface.surface_refit() == {"FINISHED"}
    assert bpy.ops.bsface.view_photo() == {"FINISHED"}


def test_rows_may_be_relative_to_the_blend_file(face, solved, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    for row in bpy.context.scene.bsface.photos:
        row.path = f"//photos/{row.name}"
    bpy.ops.bsface.surface_refit()
    assert {path.parent for path in solved[-1].photos} == {tmp_path / "photos"}


@pytest.mark.parametrize("at", ["", "scenes"])
def test_photos_that_moved_with_the_blend_file_are_found(face, solved, tmp_path, at):
    old, new = tmp_path / "old", tmp_path / "new"
    (old / at).mkdir(parents=True)
    (tmp_path / "photos").rename(old / "photos")
    bpy.ops.bsface.reconstruct(directory=str(old / "photos"))
    bpy.ops.wm.save_as_mainfile(filepath=str(old / at / "a.blend"))
    old.rename(new)
    bpy.ops.wm.open_mainfile(filepath=str(new / at / "a.blend"))
    there = {new / "photos" / f"{number}.png" for number in range(3)}
    bpy.ops.bsface.view_photo()
    (slot,) = bpy.context.scene.camera.data.background_images
    shown = Path(bpy.path.abspath(slot.image.filepath)).resolve()
    assert shown in there and slot.image.size[0] == faces.SIZE[0]
    for _ in range(2):
        assert bpy.ops.bsface.surface_refit() == {"FINISHED"}
        assert set(solved[-1].photos) == there
        bpy.ops.bsface.photos_clear()  # then the face knows its photos
        bpy.context.view_layer.objects.active = bpy.data.objects["Ann"]
    (new / "photos").rename(tmp_path / "away")
    with pytest.raises(RuntimeError, match="not in .* nor beside this file"):
        bpy.ops.bsface.surface_refit()


def test_paths_of_operators_may_be_relative_to_the_blend_file(face, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.ops.bsface.export(filepath="//b.step")
    assert (tmp_path / "b.step").is_file()
    known = bpy.ops.bsface.export.get_rna_type().properties
    assert known["filepath"].is_path_supports_blend_relative
