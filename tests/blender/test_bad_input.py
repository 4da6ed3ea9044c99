"""Every row of the table of bad input, by Blender's operators."""

import os

import bad_input
import bad_input_doors as doors
import bad_photos
import bpy
import pytest
from blender.checkout import load
from bsface import Settings, reconstruct
from permissions import as_ordinary_user

load("core.reconstruct")
face_models = load("core.landmarks.face_models")
errors = load("core.errors")

JOBS = [row for row in bad_input.job_rows() if row.blender]
KINDS = (
    "objects",
    "curves",
    "cameras",
    "lights",
    "materials",
    "images",
    "collections",
    "meshes",
    "shape_keys",
    "texts",
    "worlds",
    "node_groups",
)


def have_models():
    try:
        face_models.find_models()
    except errors.ReconstructionError as gone:
        pytest.skip(f"the model files are not installed: {gone}")


def state():
    """All that is in the file, what is chosen, and the photo list."""
    layer = bpy.context.view_layer
    ours = bpy.context.scene.bsface
    return (
        {kind: [d.name for d in getattr(bpy.data, kind)] for kind in KINDS},
        layer.objects.active and layer.objects.active.name,
        [obj.name for obj in bpy.context.scene.objects if obj.select_get()],
        bpy.context.scene.camera,
        [(row.name, row.path, row.status, row.use) for row in ours.photos],
        ours.face,
        ours.hints,
    )


@pytest.mark.parametrize("row", JOBS, ids=[row.title for row in JOBS])
def test_operators(row, addon, tmp_path, monkeypatch):
    if row.models:
        have_models()
    monkeypatch.chdir(tmp_path)
    words = row.make(tmp_path)
    bpy.ops.mesh.primitive_cube_add()  # what a user has in the scene
    if row.blender == "export":
        doors.make_face(words)
    before, files = state(), set(os.listdir(tmp_path))
    told = doors.operator(row, words)
    assert row.words in told
    assert "\n" not in told and "Traceback" not in told and "Error" not in told
    if row.exit:
        assert state() == before
        assert set(os.listdir(tmp_path)) - files <= {"out"}
        assert not (tmp_path / "out" / "face.npz").is_file()
    else:
        assert bpy.context.scene.bsface.face is not None
        assert before[0]["meshes"] == state()[0]["meshes"]


@pytest.mark.parametrize("rows", ["photo_rows", "detector_rows", "two_faces_rows"])
def test_photo_list_tells_what_the_report_tells(addon, tmp_path, rows):
    detector = rows != "photo_rows"
    if detector:
        have_models()
    expected = getattr(bad_photos, rows)(tmp_path / "photos")
    settings = Settings(**bad_input.SETTINGS, detector=detector)
    words = [str(tmp_path / "photos"), *bad_input.QUICK]
    if not detector:
        words.append("--set=detector=false")
    with as_ordinary_user():
        reports = reconstruct(tmp_path / "photos", settings).reports
        doors.make_face(words)
    told = {r.name: (r.status, r.reason) for r in bpy.context.scene.bsface.photos}
    assert told == {r.name: (r.status, r.reason) for r in reports}
    assert {r.name: told[r.name][0] for r in expected} == {
        r.name: r.code for r in expected
    }
