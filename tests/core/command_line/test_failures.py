"""``python -m bsface`` when it fails: exit codes, and nothing half-written."""

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from bsface import Constraint
from bsface.__main__ import main
from bsface.errors import Cancelled, ReconstructionError
from bsface.files import is_temporary
from command_line import QUICK, run
from fake_face import bare_reconstruction, painted_reconstruction
from json_schema import RESULT_SCHEMA as SCHEMA
from json_schema import problems
from needs import needs_permissions, needs_signals

# --- it is called wrongly: exit code 2 -----------------------------------------------


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["-o", "a.npz", "--set", "method"], "--set takes NAME=VALUE, got 'method'."),
        (["-o", "a.npz", "--set", "method=magic"], "method must be one of"),
        (["-o", "a.npz", "--set", "colour=red"], "There is no setting colour;"),
        (["-o", "a.npz", "--set", "control_points=4,5"], "from 8 to 120, got [4, 5]."),
        (["-o", "a.npz", "--set", "iterations=1e9"], "between 1 and 50, got 1e+09."),
        (["-o", "a.npz", "--set", "distance_mm=nan"], "got 'nan'."),
        (["-o", "a.npz", "--set", "distance_mm=NaN"], "got nan."),
        (["-o", "a.npz", "--set", "detector=False"], "true or false, got 'False'."),
        (["-o", "a.xyz"], "a.xyz: unknown ending; choose one of .npz"),
        (["-o", "a.npz", "-o", "noending"], "noending: unknown ending"),
        (["-o", "a.npz", "--report", "page.doc"], "must end in .html."),
        (["-o", "a.npz", "--template", "none.npz"], "none.npz is not a template file"),
        (["-o", "a.npz", "--template", ""], "The name given for template is empty"),
        (["-o", "a.npz", "--start", ""], "The name given for start is empty"),
        (["-o", "a.npz", "--report", ""], "The name given for report is empty"),
        (["-o", "a.npz", "--set", "lam=1", "--set", "lam=2"], "lam is given twice"),
        (["-o", "sub/.npz/b.npz"], ""),
    ],
)
def test_wrong_call(capsys, photos, tmp_path, monkeypatch, words, sentence):
    monkeypatch.chdir(tmp_path)
    if not sentence:
        (tmp_path / "sub").write_text("a file where a folder is wanted")
        sentence = "is a file); choose another folder."
    code, printed, said = run(capsys, photos, *words)
    assert code == 2
    assert printed == ""
    assert sentence in said
    assert said.startswith("bsface: ")
    assert said.count("\n") == 1
    assert set(os.listdir(tmp_path)) <= {"sub"}


@pytest.mark.parametrize("words", [[], ["photos"], ["photos", "-o"], ["-o", "a.npz"]])
def test_missing_words(capsys, words):
    code, _, said = run(capsys, *words)
    assert code == 2
    assert said.startswith("usage:")


def test_output_that_is_a_folder(capsys, photos, tmp_path):
    (tmp_path / "a.npz").mkdir()
    code, _, said = run(capsys, photos, "-o", tmp_path / "a.npz", *QUICK)
    assert code == 2
    assert "is a folder; give the name of a file in it." in said


def test_name_that_is_too_long(capsys, photos, tmp_path):
    name = tmp_path / ("x" * 300 + ".npz")
    code, _, said = run(capsys, photos, "-o", name, *QUICK)
    assert code in (1, 2)
    assert "cannot be written" in said
    assert os.listdir(tmp_path) == []


@needs_permissions
def test_folder_without_permission(capsys, photos, tmp_path):
    tmp_path.chmod(0o500)
    code, _, said = run(capsys, photos, "-o", tmp_path / "a.npz", *QUICK)
    assert code == 2
    assert "no permission" in said


# --- the job fails: exit code 1, and the old file stays ------------------------------


@pytest.mark.parametrize(
    ("error", "code", "sentence"),
    [
        (ReconstructionError("No photo; add one."), 1, "bsface: No photo; add one."),
        (MemoryError(), 1, "bsface: There is not enough memory; use fewer"),
        (KeyboardInterrupt(), 130, "bsface: interrupted, nothing written"),
        (Cancelled(), 130, "bsface: interrupted, nothing written"),
    ],
)
def test_failed_job(capsys, photos, tmp_path, error, code, sentence):
    def stop(*args, **kwargs):
        raise error

    out = tmp_path / "a.npz"
    out.write_bytes(b"the old one")
    found, printed, said = run(capsys, photos, "-o", out, job=stop)
    assert found == code
    assert printed == ""
    assert sentence in said
    assert out.read_bytes() == b"the old one"
    assert os.listdir(tmp_path) == ["a.npz"]


def test_failure_for_programs(capsys, tmp_path):
    words = [tmp_path / "none", "-o", tmp_path / "a.npz", "--json"]
    code, printed, said = run(capsys, *words)
    assert code == 1
    facts = json.loads(printed)
    assert facts["ok"] is False and said == f"bsface: {facts['error']}\n"


def test_output_that_cannot_be_replaced(capsys, photos, tmp_path, ready):
    """Somebody makes a folder of the output's name while the job runs."""
    out = tmp_path / "a.npz"

    def job(*args, **kwargs):
        (out / "something").mkdir(parents=True)
        return ready()

    code, _, said = run(capsys, photos, "-o", out, job=job)
    assert code == 1
    assert f"{out}: is a folder" in said
    assert os.listdir(tmp_path) == ["a.npz"] and os.listdir(out) == ["something"]


def test_wrong_folder(capsys, tmp_path):
    code, _, said = run(capsys, tmp_path / "none", "-o", tmp_path / "a.npz")
    assert code == 1
    assert "give the folder that holds the photos." in said
    assert os.listdir(tmp_path) == []


def test_every_photo_has_its_reason_when_none_can_be_used(capsys, tmp_path):
    """On the terminal, in the log and in the JSON."""
    folder, log = tmp_path / "photos", tmp_path / "log.txt"
    folder.mkdir()
    for name in ("a.jpg", "b.jpg"):
        (folder / name).write_text("hello")
    words = [folder, "-o", tmp_path / "a.npz", "--log", log]
    code, _, said = run(capsys, *words)
    assert code == 1
    for text in (said, log.read_text()):
        assert text.count("is not a picture") >= 2 and "b.jpg: b.jpg is not" in text
    code, printed, _ = run(capsys, *words, "--json")
    facts = json.loads(printed)
    assert code == 1 and [row["name"] for row in facts["report"]] == ["a.jpg", "b.jpg"]
    assert not problems(facts, SCHEMA)


@pytest.mark.parametrize("words", [["batch", "none", "out"], ["info", "none.npz"]])
def test_other_commands_fail_in_json_too(capsys, tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    code, printed, said = run(capsys, *words, "--json")
    facts = json.loads(printed)
    assert code == 1 and facts["error"] in said
    assert not problems(facts, SCHEMA)


@pytest.mark.parametrize("coding", ["ascii", "latin-1", "utf-8"])
def test_json_is_json_in_every_encoding(tmp_path, coding):
    folder = tmp_path / "n\u00f6 \U0001f600"
    done = subprocess.run(
        [sys.executable, "-m", "bsface", "info", str(folder), "--json"],
        capture_output=True,
        env={**os.environ, "PYTHONIOENCODING": coding},
    )
    assert str(folder) in json.loads(done.stdout.decode(coding))["error"]


def test_no_folder_for_the_models_is_no_folder(capsys, tmp_path, monkeypatch):
    """Not the present one."""
    monkeypatch.chdir(tmp_path)
    assert run(capsys, "models", "fetch", "--to", "")[0] == 2
    assert os.listdir(tmp_path) == []


@needs_signals
@pytest.mark.parametrize("stop", ["SIGINT", "SIGTERM"])
def test_an_export_that_is_stopped(tmp_path, stop):
    """A sentence, whatever the command."""
    painted_reconstruction(count=2, side=60).save(tmp_path / "a.npz")
    words = ["export", str(tmp_path / "a.npz"), "--tolerance", "0.004"]
    for name in ("a.stl", "b.stl", "c.stl", "d.stl"):
        words += ["-o", str(tmp_path / name)]
    with subprocess.Popen(
        [sys.executable, "-m", "bsface", *words], stderr=subprocess.PIPE, text=True
    ) as process:
        while not any(is_temporary(name) for name in os.listdir(tmp_path)):
            assert process.poll() is None
        process.send_signal(getattr(signal, stop))
        said = process.stderr.read()
        assert process.wait(timeout=60) == 130
    assert said == "bsface: interrupted\n"
    assert not any(is_temporary(name) for name in os.listdir(tmp_path))


@needs_signals
@pytest.mark.parametrize("stop", ["SIGINT", "SIGTERM", "SIGKILL"])
def test_stopped_from_outside(photos, tmp_path, stop):
    """In the middle of the work: the old file stays, and nothing else is there."""
    out = tmp_path / "face.npz"
    out.write_bytes(b"the old one")
    words = [str(photos), "-o", str(out), "--set=iterations=50", "--set=detector=false"]
    with subprocess.Popen(
        [sys.executable, "-m", "bsface", *words],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    ) as process:
        assert process.stderr.readline().startswith("landmarks")
        process.send_signal(getattr(signal, stop))
        said = process.stderr.read()
        code = process.wait(timeout=60)
    if stop == "SIGKILL":
        assert code == -signal.SIGKILL
    else:
        assert code == 130
        assert "interrupted, nothing written" in said
        assert "Traceback" not in said
    assert os.listdir(tmp_path) == ["face.npz"]
    assert out.read_bytes() == b"the old one"


def test_the_face_file_is_written_before_an_export_that_fails(capsys, tmp_path):
    """The sentence can then be followed, by `bsface export`."""
    face = bare_reconstruction()
    tiny = face.with_surface(face.surface.transformed(1 / 62))
    solid, kept = tmp_path / "a.stl", tmp_path / "a.npz"
    words = ["x", "-o", str(solid), "-o", str(kept), "-q"]
    assert main(words, lambda *_, **__: tiny) == 1
    said = capsys.readouterr().err
    assert said.startswith(f"{kept} written\nbsface: {solid}: the inside of the solid")
    assert os.listdir(tmp_path) == ["a.npz"]


def test_a_start_keeps_its_net_and_the_size_of_what_it_holds(capsys, photos, tmp_path):
    face = bare_reconstruction()
    held = Constraint(np.ones(face.surface.shape, bool))
    start = replace(face, constraint=held).save(tmp_path / "start.npz")
    for word, sentence in (
        ("control_points=30,31", "control points, which --start keeps"),
        ("eye_distance_mm=70", "a face with 62 mm between the eyes"),
    ):
        asked = ["--start", start, "--set", word]
        code, _, said = run(capsys, photos, "-o", tmp_path / "a.npz", *asked)
        assert code == 2 and sentence in said


def test_a_start_keeps_its_size_unless_another_is_asked_for(tmp_path):
    """Not the usual one: points that it holds would stand in a face of another size."""
    face = bare_reconstruction()
    sized = replace(face, settings=replace(face.settings, eye_distance_mm=70.0))
    words = ["x", "-o", str(tmp_path / "a.npz"), "-q"]
    words += ["--start", str(sized.save(tmp_path / "start.npz"))]
    given = []

    def stop(photos, settings, **others):
        given.append(settings.eye_distance_mm)
        raise Cancelled

    assert main(words, stop) == main([*words, "--set=eye_distance_mm=64"], stop) == 130
    assert given == [70.0, 64.0]


def test_the_face_that_a_run_starts_from_is_not_written_over(capsys, photos, tmp_path):
    start = tmp_path / "start.npz"
    assert run(capsys, photos, "-o", start, "-q", *QUICK)[0] == 0
    before = start.read_bytes()
    code, _, said = run(capsys, photos, "-o", start, "--start", start)
    assert code == 2 and "is read and would be written over" in said
    assert start.read_bytes() == before
    assert not (tmp_path / "a.npz").exists()


@needs_signals
@pytest.mark.parametrize("words", [[".", "-o", "a.npz"], ["batch", "a", "b"]])
def test_a_folder_that_was_removed_from_under_it(tmp_path, words):
    gone = tmp_path / "gone"
    gone.mkdir()
    program = (
        "import os, sys; from bsface.__main__ import main; "
        f"os.rmdir({str(gone)!r}); sys.exit(main({words!r}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=gone, capture_output=True, text=True
    )
    assert done.returncode == 1
    assert done.stderr == (
        "bsface: The present folder was removed; change to another one (cd).\n"
    )
