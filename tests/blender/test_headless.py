"""The command line of the add-on: files, exit codes, JSON."""

import json
import os
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest
from blender.checkout import load

headless = load("bsface_addon.headless")
arguments = load("bsface_addon.arguments")
scene = load("bsface_addon.scene")
surface_object = load("bsface_addon.surface_object")
load_face = load("core.formats").load_face
SCRIPT = Path(headless.__file__)


def test_photos_in_blend_and_npz_out(addon, solved, tmp_path, capfd):
    blend, npz = tmp_path / "out" / "ann.blend", tmp_path / "ann.npz"
    code = headless.main(
        [str(tmp_path / "photos"), str(blend), "--npz", str(npz), "--points", "9x10"]
    )
    assert code == 0
    assert solved[0].settings.control_points == (9, 10)
    assert "3 of 4 photos used" in capfd.readouterr().err
    # Nothing but the file itself: no backup, no temporary name.
    assert os.listdir(blend.parent) == ["ann.blend"]
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    face = bpy.context.scene.bsface.face
    saved = load_face(npz)
    points = saved.surface.control_points
    np.testing.assert_allclose(surface_object.read(face), points, atol=1e-4)
    assert bpy.context.scene.camera is not None
    for image in bpy.data.images:
        if image.source == "FILE" and not image.packed_file:
            assert image.filepath.startswith("//")
            assert Path(bpy.path.abspath(image.filepath)).is_file()


def test_no_photo_is_written_over(addon, solved, tmp_path, capfd):
    """The page's picture would take the place of a photo of its name."""
    photo = sorted((tmp_path / "photos").glob("*.png"))[0]
    before = photo.read_bytes()
    given = [str(tmp_path / "photos"), str(tmp_path / "a.blend")]
    assert headless.main([*given, "--report", str(photo.with_suffix(".html"))]) == 1
    assert "belongs to the photos" in capfd.readouterr().err
    assert photo.read_bytes() == before and not (tmp_path / "a.blend").exists()


def test_two_names_for_the_result_are_refused(addon, tmp_path, capfd):
    given = [str(tmp_path), str(tmp_path / "a.blend"), "-o", str(tmp_path / "b.blend")]
    assert headless.main(given) == 1
    assert "Give one name for the result" in capfd.readouterr().err


def test_an_opened_file_keeps_its_libraries_and_pictures(addon, solved, tmp_path):
    """Written into another folder, it goes on finding what it found before."""
    shelf = tmp_path / "shelf"
    shelf.mkdir()
    bpy.data.objects.new("prop", None).use_fake_user = True
    bpy.ops.wm.save_as_mainfile(filepath=str(shelf / "props.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(shelf / "mine.blend"))
    library = str(shelf / "props.blend")
    with bpy.data.libraries.load(library, link=True, relative=True) as (_, into):
        into.objects = ["prop"]
    bpy.context.scene.collection.objects.link(into.objects[0])
    for name, source in (("walk.0001.png", "SEQUENCE"), ("tile.1001.png", "TILED")):
        (shelf / name).write_bytes((tmp_path / "photos" / "0.png").read_bytes())
        picture = bpy.data.images.load(str(shelf / name))
        picture.source, picture.use_fake_user = source, True
        picture.filepath = f"//{name.replace('1001', '<UDIM>')}"
    bpy.ops.wm.save_as_mainfile(filepath=str(shelf / "mine.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(shelf / "mine.blend"))
    out = tmp_path / "out" / "deep" / "ann.blend"
    assert headless.main([str(tmp_path / "photos"), str(out), "--quiet"]) == 0
    bpy.ops.wm.open_mainfile(filepath=str(out))
    paths = [library.filepath for library in bpy.data.libraries]
    paths += [i.filepath for i in bpy.data.images if i.filepath and not i.packed_file]
    assert len(paths) == 6
    for path in paths:
        assert path.startswith("//"), path
        real = Path(bpy.path.abspath(path.replace("<UDIM>", "1001")))
        assert real.is_file(), path


def test_json_and_info(addon, solved, tmp_path, capfd):
    blend = tmp_path / "ann.blend"
    given = ["reconstruct", str(tmp_path / "photos"), "-o", str(blend), "--json"]
    assert headless.main([*given, "--name", "Ann"]) == 0
    said = json.loads(capfd.readouterr().out.splitlines()[-1])
    assert said["ok"] and said["face"] == "Ann" and said["files"] == [str(blend)]
    assert [photo["status"] for photo in said["report"]] == ["used"] * 3 + ["no_face"]
    assert headless.main(["info", str(blend), "--json"]) == 0
    (face,) = json.loads(capfd.readouterr().out.splitlines()[-1])["faces"]
    assert face["control_points"] == [16, 18] and face["used"] == 3
    assert headless.main(["info", str(blend)]) == 0
    assert "16 x 18 control points" in capfd.readouterr().out


@pytest.mark.parametrize("kind", ["step", "npz", "obj"])
def test_export_of_a_blend(addon, solved, tmp_path, kind):
    blend, target = tmp_path / "ann.blend", tmp_path / f"ann.{kind}"
    headless.main([str(tmp_path / "photos"), str(blend), "--quiet"])
    assert headless.main(["export", str(blend), str(target)]) == 0
    assert target.stat().st_size > 1000


def test_an_export_writes_over_no_photo_and_not_what_it_reads(
    addon, solved, tmp_path, capfd
):
    blend, npz = tmp_path / "ann.blend", tmp_path / "ann.npz"
    photo = tmp_path / "photos" / "0.png"
    before = photo.read_bytes()
    headless.main([str(tmp_path / "photos"), str(blend), "--npz", str(npz)])
    capfd.readouterr()
    assert headless.main(["export", str(blend), str(photo.with_suffix(".obj"))]) == 1
    assert "0.png belongs to the photos" in capfd.readouterr().err
    assert headless.main(["export", str(npz), str(npz)]) == 1
    assert "is read and would be written over" in capfd.readouterr().err
    assert photo.read_bytes() == before


def test_export_of_a_face_file(addon, solved, tmp_path):
    npz = tmp_path / "ann.npz"
    headless.main(
        [str(tmp_path / "photos"), str(tmp_path / "a.blend"), "--npz", str(npz)]
    )
    assert headless.main(["export", str(npz), str(tmp_path / "ann.igs")]) == 0
    assert (tmp_path / "ann.igs").stat().st_size > 1000


@pytest.mark.parametrize(
    "given, code, words",
    [
        (["/no/such", "out.blend"], 1, "cannot open this folder"),
        (["PHOTOS", "out.png"], 1, "ends in .blend"),
        (["PHOTOS"], 1, "ends in .blend"),
        (["PHOTOS", "out.blend", "--points", "many"], 1, "40x40"),
        (["PHOTOS", "out.blend", "--settings", "{"], 1, "settings"),
        (["PHOTOS", "out.blend", "--settings", "[" * 100_000], 1, "settings"),
        (["PHOTOS", "out.blend", "--npz", "a.step"], 1, "must end in .npz"),
        (["PHOTOS", "out.blend", "--size", "nan"], 2, "0.001 to 1000"),
        (["PHOTOS", "out.blend", "--size", "0"], 2, "0.001 to 1000"),
        (["PHOTOS", "/proc/version/a.blend"], 1, "is a file"),
        (["", "out.blend"], 1, "is empty"),
        (["info", "/no/such.blend"], 1, "no file"),
        (["export", "/no/such.blend", "a.step"], 1, "no file"),
        (["reconstruct"], 2, "PHOTOS"),
        (["info", "a", "b"], 2, "unrecognized"),
        (["--help"], 0, "usage"),
    ],
)
def test_failures_are_one_sentence_and_an_exit_code(
    addon, solved, tmp_path, capfd, given, code, words
):
    swap = {"PHOTOS": str(tmp_path / "photos"), "out.blend": str(tmp_path / "o.blend")}
    assert headless.main([swap.get(item, item) for item in given]) == code
    captured = capfd.readouterr()
    assert words in captured.out + captured.err
    assert "Traceback" not in captured.err
    assert not list(tmp_path.glob("*.blend"))


def test_a_name_that_is_no_text(addon, solved, tmp_path):
    blend = tmp_path / "a.blend"
    given = [str(tmp_path / "photos"), str(blend), "--name", "Zo\udceb\n"]
    assert headless.main(given) == 0
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    assert bpy.context.scene.bsface.face.name == r"Zo\udceb\n"


def test_a_file_that_is_no_blend(addon, tmp_path, capfd):
    (tmp_path / "a.blend").write_text("nothing")
    assert headless.main(["info", str(tmp_path / "a.blend")]) == 1
    assert "a.blend" in capfd.readouterr().err


def test_the_command_is_known_to_blender(addon):
    assert headless._handle is not None


def test_no_option_begins_like_those_that_cycles_reads():
    for verb in (arguments.parser(), *arguments.verbs().values()):
        for action in verb._actions:
            assert not any(name.startswith("--c") for name in action.option_strings)


def test_as_a_script_on_real_photos(tmp_path, example_photos):
    """No fixtures, no fakes: a process of its own, five photos, no shading."""
    photos = tmp_path / "photos"
    photos.mkdir()
    example_photos(photos, range(0, 40, 8))
    blend = tmp_path / "face.blend"
    run = subprocess.run(
        [sys.executable, SCRIPT, "--", photos, blend, "--method", "motion"]
        + ["--texture", "512", "--json", "--report", tmp_path / "page.html"],
        capture_output=True,
        text=True,
        timeout=400,
    )
    assert run.returncode == 0, run.stderr
    said = json.loads(run.stdout.splitlines()[-1])
    assert [photo["status"] for photo in said["report"]] == ["used"] * 5
    page = [str(tmp_path / f"page.{ending}") for ending in ("html", "json", "png")]
    assert said["files"] == [str(blend), *page]
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    (face,) = [obj for obj in bpy.data.objects if scene.is_face(obj)]
    report = scene.stored(face, load("bsface_addon.stored_facts").REPORT, [])
    assert max(row["reprojection_pct"] for row in report) < 5
