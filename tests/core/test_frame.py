"""Facts that are written down in two places and have to agree."""

import importlib.util
import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


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


def test_tested_blender_lines_are_pinned():
    spec = importlib.util.spec_from_file_location("dev", ROOT / "dev.py")
    dev = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(dev)
    text = (ROOT / "requirements" / "run.txt").read_text("utf-8")
    pinned = re.findall(r'^bpy==(\d+\.\d+)\.\d+ ; python_version == "(.*)"', text, re.M)
    lines = {line: "{}.{}".format(*version) for line, version in dev.LINES.items()}
    assert dict(pinned) == lines
