"""``python -m bsface`` when all goes well: files, facts, sentences."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace

import cv2
import numpy as np
from bsface import Settings, load
from bsface.cli.arguments import parse_settings
from bsface.result import PhotoReport
from command_line import QUICK, run
from fake_face import painted_reconstruction


def test_photos_in_face_out(capsys, photos, tmp_path):
    out = tmp_path / "new" / "face.npz"
    code, printed, said = run(capsys, photos, "-o", out, *QUICK)
    assert code == 0
    assert printed == ""
    assert f"3 of 3 photos used; {out} written" in said
    face = load(out)
    assert face.surface.shape == (10, 11)
    assert np.isfinite(face.surface.control_points).all()
    assert face.settings.method == "motion"
    assert [row.name for row in face.reports] == ["0.png", "1.png", "2.png"]
    assert os.listdir(out.parent) == ["face.npz"]


def test_notes_on_used_photos_are_told(capsys, photos, tmp_path, ready):
    """A copy, a video that is cut short: on the terminal and in the log."""
    face = ready()
    row = PhotoReport("0.png", "used", "looks like a copy of 1.png")
    noted = replace(face, reports=(row, *face.reports[1:]))
    log = tmp_path / "log.txt"
    words = [photos, "-o", tmp_path / "a.npz", "--log", log]
    _, _, said = run(capsys, *words, job=lambda *args, **kwargs: noted)
    for text in (said, log.read_text()):
        assert "0.png: looks like a copy of 1.png" in text
        assert "1.png:" not in text


def test_several_outputs_and_a_page(capsys, photos, tmp_path, ready):
    """All files are written, and the JSON names them all."""
    outputs = [str(tmp_path / name) for name in ("a.npz", "b.obj", "c.step")]
    words = [w for path in outputs for w in ("-o", path)]
    page, log = str(tmp_path / "page.html"), str(tmp_path / "log" / "a.txt")
    words += ["--report", page, "--log", log, "--json"]
    code, printed, _ = run(capsys, photos, *words, job=ready)
    assert code == 0
    facts = json.loads(printed)
    beside = [str(tmp_path / name) for name in ("page.json", "page.png")]
    assert facts["files"] == [*outputs, page, *beside, log]
    assert all(os.path.getsize(path) > 300 for path in facts["files"])
    found = {str(path) for path in tmp_path.rglob("*") if path.is_file()}
    assert found == set(facts["files"])
    # the page's own facts are the same, but for names
    own = json.loads((tmp_path / "page.json").read_text("utf-8"))
    differing = {"files": 0, "title": ""}
    assert {**own, **differing} == {**facts, **differing}


def test_mesh_has_its_pictures_beside_it(capsys, photos, tmp_path):
    """Colours, normals and displacement of a face whose photos are there."""
    face = painted_reconstruction(5)
    job = lambda *args, **kwargs: face  # noqa: E731
    code, said, _ = run(capsys, photos, "-o", tmp_path / "a.obj", "--json", job=job)
    assert code == 0
    written = {str(path) for path in tmp_path.iterdir()}
    assert set(json.loads(said)["files"]) == written and len(written) == 5
    words = (tmp_path / "a.mtl").read_text().split()
    named = [word for word in words if word.endswith(".png")]
    assert set(named) == {"a.png", "a_normal.png", "a_displacement.png"}
    depth = {name: cv2.imread(str(tmp_path / name), -1).dtype for name in named}
    assert depth["a_displacement.png"] == np.uint16
    assert depth["a_normal.png"] == depth["a.png"] == np.uint8


def test_log_tells_steps_and_what_failed(capsys, photos, tmp_path):
    log = tmp_path / "log.txt"
    words = ["-o", tmp_path / "a.npz", "--log", log, "--ignore", "1.png", *QUICK]
    assert run(capsys, photos, *words)[0] == 0
    text = log.read_text("utf-8")
    assert "numpy" in text and "landmarks 3/3" in text
    assert "1.png is set aside." in text and f"{tmp_path / 'a.npz'} written" in text
    words[-1] = "--ignore=9.png"
    assert run(capsys, photos, *words)[0] == 1
    assert "There is no photo '9.png'" in log.read_text("utf-8")


def test_quiet_says_nothing(capsys, photos, tmp_path):
    code, printed, said = run(
        capsys, photos, "-o", tmp_path / "a.npz", "--quiet", *QUICK
    )
    assert (code, printed, said) == (0, "", "")


def test_json_for_programs(capsys, photos, tmp_path):
    """Strict JSON, also where a photo has no numbers."""
    out = tmp_path / "a.npz"
    code, printed, _ = run(
        capsys, photos, "-o", out, "--json", "--ignore", "1.png", *QUICK
    )
    assert code == 0

    def refuse(word):
        raise AssertionError(f"{word} is not JSON")

    said = json.loads(printed, parse_constant=refuse)
    assert said["schema"] == 1 and said["ok"] is True
    assert said["files"] == [str(out)]
    assert said["photos"] == {"all": 3, "used": 2}
    assert [row["status"] for row in said["report"]] == ["used", "ignored", "used"]
    assert said["report"][1]["yaw"] is None
    assert said["warnings"]


def test_versions(capsys):
    code, printed, _ = run(capsys, "--version")
    assert code == 0
    assert printed.startswith("bsface ") and "opencv" in printed


def test_sub_folders_on_request(capsys, photos, tmp_path):
    shutil.copytree(photos, tmp_path / "all" / "monday")
    words = ["-o", tmp_path / "a.npz", "--json", "-q", *QUICK]
    code, _, said = run(capsys, tmp_path / "all", *words)
    assert code == 1 and "--recursive" in said
    code, printed, _ = run(capsys, tmp_path / "all", "--recursive", *words)
    assert code == 0
    assert json.loads(printed)["photos"] == {"all": 3, "used": 3}


def test_left_out_photos_are_named(capsys, photos, tmp_path):
    code, _, said = run(
        capsys, photos, "-o", tmp_path / "a.npz", "--ignore", "1.png", *QUICK
    )
    assert code == 0
    assert "1.png: 1.png is set aside." in said
    assert "2 of 3 photos used" in said


def test_as_a_program_and_the_same_bytes_twice(photos, tmp_path):
    """In processes of their own, with one thread and with two."""
    results = []
    words = ["--set=method=joint", "--set=iterations=1", *QUICK[1:]]
    for threads in ("1", "2"):
        out = tmp_path / f"{threads}.npz"
        names = ("OMP", "OPENBLAS", "MKL")
        limits = {f"{name}_NUM_THREADS": threads for name in names}
        limits["SOURCE_DATE_EPOCH"] = "0"
        done = subprocess.run(
            [sys.executable, "-m", "bsface", str(photos), "-o", str(out), *words],
            env={**os.environ, **limits},
            capture_output=True,
            text=True,
            timeout=300,
        )
        assert done.returncode == 0, done.stderr
        assert "3 of 3 photos used" in done.stderr
        results.append(out.read_bytes())
    assert results[0] == results[1]


def test_settings_from_words():
    made = parse_settings(
        ["method=paper", "control_points=30,32", "lam=2.5", "detector=false"]
    )
    assert made == Settings(
        method="paper", control_points=(30, 32), lam=2.5, detector=False
    )
    assert parse_settings(["landmarks=68"]).landmarks == "68"
    assert parse_settings(["control_points=[9, 10]"]).control_points == (9, 10)
    assert parse_settings([]) == Settings()
