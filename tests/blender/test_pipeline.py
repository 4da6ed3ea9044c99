"""The real thing on a few photos: first run, edit, refit; no fakes."""

import shutil

import bpy
import numpy as np
import pytest
from blender.checkout import ROOT, load

scene = load("bsface_addon.scene")
cameras = load("bsface_addon.cameras")
material = load("bsface_addon.material")
surface_object = load("bsface_addon.surface_object")
face_models = load("core.evidence.face_models")
errors = load("core.errors")


@pytest.fixture
def photos(tmp_path):
    """Five of the example photos."""
    try:
        face_models.find_models()
    except errors.ReconstructionError as error:
        pytest.skip(f"no face models: {error}")
    for path in sorted((ROOT / "examples" / "photos").glob("*.jpg"))[::8]:
        shutil.copy(path, tmp_path)
    return str(tmp_path)


def test_reconstruct_edit_and_refit(addon, photos):
    bpy.context.scene.bsface.texture_size = "512"
    settings = '{"method": "motion"}'
    bpy.ops.bsface.reconstruct(
        directory=photos, settings=settings, control_points_u=20, control_points_v=22
    )
    state = bpy.context.scene.bsface
    face = state.face
    assert [row.status for row in state.photos] == ["used"] * 5
    assert all(row.landmarks for row in state.photos)
    assert len(cameras.of_face(face)) == 5
    assert {"SKIN", "PHOTO", "NORMALS"} <= set(material.stored_kinds(face))
    width = np.ptp(surface_object.read(face)[..., 0])
    assert 120 < width < 260
    # The artist pulls one control point out by 4 mm and refits.
    first = surface_object.read(face)
    edited = first.copy()
    edited[10, 12, 2] += 4
    surface_object.write(bpy.context, face, edited)
    state.settings.method = "motion"
    bpy.ops.bsface.surface_refit(softness=0)
    assert state.face == face
    second = surface_object.read(face)
    np.testing.assert_allclose(second[10, 12], edited[10, 12], atol=0.05)
    # The rest is about where it was: the evidence has not changed.
    away = np.linalg.norm(second - first, axis=2)[4:-4, 4:-4]
    assert np.median(away) < 1.0


def test_detection_alone_gives_landmarks_and_hints(addon, photos):
    bpy.ops.bsface.photos_add(directory=photos)
    assert bpy.ops.bsface.landmarks_detect() == {"FINISHED"}
    state = bpy.context.scene.bsface
    assert [row.status for row in state.photos] == ["found"] * 5
    assert all(row.faces == 1 for row in state.photos)
    assert all(line.endswith(".") for line in state.hints.splitlines())
