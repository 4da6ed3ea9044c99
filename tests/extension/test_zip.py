"""The zip as a user gets it: built, validated, installed and run from the zip.

Only the zip for the running platform and Python; its wheels are downloaded once
into the user's cache. All operators are tested from it by `tests/blender` with
`--from-zip`. The environment that runs the tests holds SciPy and OpenCV
itself, and its copies would win over those in the zip. So Blender is started with
all of its packages but these, as an application would be: what runs is the zip.
"""

import importlib
import json
import os
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path

import pytest
import zip_file

ROOT = Path(__file__).resolve().parents[2]
PHOTOS = ROOT / "examples" / "photos"


@pytest.fixture(scope="module")
def built() -> Path:
    """The zip for the running platform and Python."""
    return zip_file.built()


def test_each_zip_is_for_one_platform_and_one_python(monkeypatch):
    """The two Pythons share no Blender version: two zips never both fit."""
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    build_extension = importlib.import_module("build_extension")
    text = (ROOT / "blender_manifest.toml").read_text("utf-8")
    ends = {}
    for target in build_extension.all_targets():
        made = tomllib.loads(build_extension.manifest_for(target, text, ["./w.whl"]))
        assert made["platforms"] == [target.platform]
        assert made["id"] == "bsface"
        ends[target.python] = (
            made["blender_version_min"],
            made.get("blender_version_max"),
        )
    assert ends["3.11"][1] == ends["3.13"][0]


def test_zip_holds_what_runs_and_nothing_else(built):
    with zipfile.ZipFile(built) as archive:
        names = set(archive.namelist())
        manifest = tomllib.loads(archive.read("blender_manifest.toml").decode())
    files = {name for name in names if not name.endswith("/")}
    models = "core/data/models/"
    for needed in (
        "__init__.py",
        "LICENSE",
        "bsface_addon/__init__.py",
        "core/__init__.py",
        "core/data/template.npz",
        models + "face_detection_short_range.tflite",
        models + "face_landmark.tflite",
        models + "LICENSE-mediapipe.txt",
        "manual/artist_guide.html",
        "manual/images/artist_finished.png",
    ):
        assert needed in files
    allowed = {"__init__.py", "blender_manifest.toml", "LICENSE"}
    tops = ("core/", "bsface_addon/", "manual/", "wheels/")
    assert not {f for f in files - allowed if not f.startswith(tops)}
    assert not {f for f in files if "__pycache__" in f or f.endswith(".pyc")}
    assert {f"./{f}" for f in files if f.startswith("wheels/")} == set(
        manifest["wheels"]
    )
    assert not [wheel for wheel in manifest["wheels"] if "numpy-" in wheel]
    assert "network" not in manifest["permissions"]


def site_without(folder: Path, left_out: tuple[str, ...]) -> Path:
    """A folder of links to the installed packages, some left out by name."""
    folder.mkdir()
    installed = Path(sysconfig.get_paths()["purelib"])
    for entry in installed.iterdir():
        if not entry.name.startswith(left_out) and entry.suffix != ".pth":
            (folder / entry.name).symlink_to(entry)
    return folder


# Runs in a Blender of its own with an empty user folder. What it finds goes to a
# file, because bpy writes to the standard output as it likes.
PROGRAM = """
import json, os, sys
import bpy
zip_file, photos, result = sys.argv[1:]
found = {}
try:
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.extensions.package_install_files(
        filepath=zip_file, repo="user_default", enable_on_install=True
    )
    import bl_ext.user_default.bsface as extension
    found["file"] = extension.__file__
    found["enabled"] = "bl_ext.user_default.bsface" in bpy.context.preferences.addons
    site = os.path.join(os.environ["BLENDER_USER_RESOURCES"], "extensions", ".local")
    found["unpacked"] = sorted(
        name for _, names, _ in os.walk(site) for name in names
        if name.endswith(".dist-info")
    )
    import cv2, scipy
    found["wheels"] = [cv2.__file__, scipy.__file__]
    found["models"] = str(
        extension.bsface_addon and
        __import__("bl_ext.user_default.bsface.core.landmarks.face_models",
                   fromlist=["find_models"]).find_models().mesh
    )
    found["returned"] = sorted(bpy.ops.bsface.reconstruct(
        directory=photos, control_points_u=12, control_points_v=12
    ))
    found["surfaces"] = [
        [len(s.points) for s in o.data.splines]
        for o in bpy.data.objects if o.type == "SURFACE"
    ]
    bpy.ops.preferences.addon_disable(module="bl_ext.user_default.bsface")
    found["left"] = hasattr(bpy.types, "BSFACE_OT_reconstruct")
except BaseException as error:
    found["error"] = repr(error)
with open(result, "w") as stream:
    json.dump(found, stream)
# bpy 4.5 has hung at interpreter exit.
sys.stdout.flush()
os._exit(0)
"""


@pytest.fixture(scope="module")
def ran(built, tmp_path_factory) -> dict:
    """What an empty Blender found after installing the zip and one small job."""
    folder = tmp_path_factory.mktemp("blender")
    photos = folder / "photos"
    photos.mkdir()
    for path in sorted(PHOTOS.glob("*.jpg"))[::5]:
        (photos / path.name).write_bytes(path.read_bytes())
    program = folder / "program.py"
    program.write_text(PROGRAM)
    result = folder / "result.json"
    # Models must come out of the zip, not out of the cache of this machine.
    env = {k: v for k, v in os.environ.items() if k not in ("BSFACE_MODELS",)}
    env["BLENDER_USER_RESOURCES"] = str(folder / "resources")
    env["XDG_CACHE_HOME"] = str(folder / "cache")
    # -S: without the environment's own site-packages.
    hidden = ("scipy", "cv2", "opencv", "bsface", "__editable__")
    env["PYTHONPATH"] = str(site_without(folder / "site", hidden))
    run = subprocess.run(
        [sys.executable, "-S", str(program), str(built), str(photos), str(result)],
        cwd=folder,
        env=env,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=400,
    )
    assert result.exists(), run.stdout[-3000:]
    found = json.loads(result.read_text())
    assert "error" not in found, found["error"] + "\n" + run.stdout[-3000:]
    found["folder"] = str(folder)
    return found


def test_zip_installs_into_the_user_folder_and_is_enabled(ran):
    assert ran["enabled"]
    assert Path(ran["file"]).is_relative_to(ran["folder"])


def test_blender_unpacks_the_wheels(ran):
    names = " ".join(ran["unpacked"])
    assert "scipy-" in names
    assert "opencv_python_headless-" in names
    assert "numpy-" not in names


def test_runs_on_the_wheels_of_the_zip(ran):
    for file in ran["wheels"]:
        assert Path(file).is_relative_to(Path(ran["folder"]) / "resources")


def test_models_come_out_of_the_zip(ran):
    assert Path(ran["models"]).is_relative_to(ran["folder"])
    assert "core" in Path(ran["models"]).parts


def test_reconstructs_from_the_zip(ran):
    assert ran["returned"] == ["FINISHED"]
    assert ran["surfaces"] == [[144]]


def test_disabling_takes_the_classes_away(ran):
    assert not ran["left"]
