"""The numbered examples run, on a few photos and with small settings."""

import importlib.util
import runpy
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from bsface import Settings
from bsface.errors import ReconstructionError
from bsface.landmarks.face_models import find_models

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("[0-9][0-9]_*.py"))
QUICK = Settings(control_points=(16, 16), iterations=1, outer_passes=1)
CHOSEN = ("000.jpg", "005.jpg", "011.jpg", "020.jpg")


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    """A folder of a few example photos."""
    try:
        find_models()
    except ReconstructionError as gone:
        pytest.skip(f"the model files are not installed: {gone}")
    folder = tmp_path_factory.mktemp("photos")
    for name in CHOSEN:
        shutil.copy(ROOT / "examples" / "photos" / name, folder)
    return folder


def run(number, photos, out, **more):
    (path,) = (p for p in EXAMPLES if p.name.startswith(f"{number:02d}_"))
    spec = importlib.util.spec_from_file_location(f"example_{number}", path)
    example = importlib.util.module_from_spec(spec)
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))  # as for a script; `_arguments` lies there
    spec.loader.exec_module(example)
    return example.main(photos, out, QUICK, **more)


def test_examples_are_numbered_without_gaps_and_all_tested():
    numbers = [int(path.name[:2]) for path in EXAMPLES]
    assert numbers == list(range(1, len(EXAMPLES) + 1))
    source = Path(__file__).read_text("utf-8")
    untested = [n for n in numbers if f"run({n}, " not in source]
    assert not untested, f"examples without a test: {untested}"


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_examples_say_how_they_are_started(path):
    text = path.read_text("utf-8")
    assert f"python examples/{path.name}" in text
    assert text.rstrip().endswith("start(main, __doc__)")


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_examples_tell_what_they_read(path, tmp_path, capsys, monkeypatch):
    """`--help` is no folder, and a wrong path is told in a sentence."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(path.parent))

    def started(*words):
        monkeypatch.setattr(sys, "argv", [str(path), *words])
        with pytest.raises(SystemExit) as end:
            runpy.run_path(str(path), run_name="__main__")
        return end.value.code

    assert started("--help") == 0
    assert capsys.readouterr().out.startswith(f"usage: {path.name}")
    assert started("none", "out").startswith("none: cannot open this folder")


def test_reconstruct_folder(photos, tmp_path, capsys):
    result = run(1, photos, tmp_path)
    assert len(result.photos) == len(CHOSEN)
    assert {"face.npz", "face.html"} <= {p.name for p in tmp_path.iterdir()}
    said = capsys.readouterr().out
    assert all(f"{name}: yaw" in said for name in CHOSEN)


def test_own_landmarks(photos, tmp_path):
    result = run(2, photos, tmp_path)
    assert {marks.scheme for marks in result.landmarks} == {"68"}
    assert {marks.source for marks in result.landmarks} == {"hand"}


def test_look_inside(photos, tmp_path, capsys):
    run(3, photos, tmp_path)
    assert "3.00 mm, +3.00" in capsys.readouterr().out


def test_export_cad(photos, tmp_path):
    written = run(4, photos, tmp_path)
    assert all(path.stat().st_size > 1000 for path in written)
    assert {".step", ".igs", ".obj", ".ply"} <= {path.suffix for path in written}


def test_batch_people(photos, tmp_path):
    outcomes, again = run(5, photos, tmp_path)
    assert [o.status for o in outcomes] == ["done", "done"]
    assert [o.status for o in again] == ["skipped", "skipped"]


def test_refit_after_edit(photos, tmp_path):
    edited, held, kept = run(6, photos, tmp_path)
    away = np.linalg.norm(kept.control_points - edited.control_points, axis=2)
    assert away[held].max() < 1.0


def test_compare_faces(photos, tmp_path):
    halves, against = run(7, photos, tmp_path)
    assert halves.mean < 5 and against.mean < 5
    assert (tmp_path / "halves.png").is_file()


def test_texture(photos, tmp_path):
    texture = run(8, photos, tmp_path, size=128)
    assert texture.albedo.shape == (128, 128, 3)
    written = {"albedo.png", "mean.png", "normal.png", "displacement.png"}
    assert {*written, "textured.png"} <= {path.name for path in tmp_path.iterdir()}


def test_algorithm_step_by_step(photos, tmp_path):
    states = run(9, photos, tmp_path)
    assert [s.stage for s in states][-1] == "outer"
    assert all(np.isfinite(s.surface.control_points).all() for s in states)


def test_track_new_photo(photos, tmp_path):
    found, face = run(10, photos, tmp_path)
    assert found.name == CHOSEN[-1] and found.residual_mm < 5
    assert found.surface.shape == face.surface.shape
    assert {"known.npz", "tracked.png"} <= {p.name for p in tmp_path.iterdir()}
