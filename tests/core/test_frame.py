"""Facts that are written down in two places and have to agree."""

import importlib.util
import re
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def tool(monkeypatch):
    """Import a script of tools/ by its name."""
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    monkeypatch.delitem(sys.modules, "build_extension", raising=False)
    return importlib.import_module


def toml(name):
    return tomllib.loads((ROOT / name).read_text("utf-8"))


def test_ci_runs_the_test_command_of_the_readme():
    command = "python3 dev.py test"
    assert (ROOT / ".ci" / "run").read_text().splitlines()[-1] == command
    lines = (ROOT / "README.md").read_text("utf-8").splitlines()
    assert [line for line in lines if line.startswith(command)]


def test_one_version():
    manifest, project = toml("blender_manifest.toml"), toml("pyproject.toml")
    assert manifest["version"] == project["project"]["version"]


def test_example_photos_are_there_with_their_licence():
    folder = ROOT / "examples" / "photos"
    assert 24 <= len(list(folder.glob("*.jpg"))) <= 40
    assert "CC0" in (folder / "LICENSE.txt").read_text("utf-8")


def test_each_zip_is_for_one_platform_and_one_python(tool):
    """The two Pythons share no Blender version: two zips never both fit."""
    build_extension = tool("build_extension")
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


def test_tested_blender_lines_are_pinned():
    spec = importlib.util.spec_from_file_location("dev", ROOT / "dev.py")
    dev = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(dev)
    text = (ROOT / "requirements" / "run.txt").read_text("utf-8")
    pinned = re.findall(r'^bpy==(\d+\.\d+)\.\d+ ; python_version == "(.*)"', text, re.M)
    lines = {line: "{}.{}".format(*version) for line, version in dev.LINES.items()}
    assert dict(pinned) == lines
