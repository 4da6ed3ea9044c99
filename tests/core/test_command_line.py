"""``python -m bsface``: exit codes, sentences, and nothing half-written."""

import dataclasses
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys

import cv2
import numpy as np
import pytest
from bsface import Settings, __main__, load, reconstruct
from bsface.cli.arguments import parse_settings
from bsface.errors import Cancelled, ReconstructionError
from fake_face import painted_reconstruction, person_folder

QUICK = [
    "--set=method=motion",
    "--set=control_points=10,11",
    "--set=detector=false",
    "--set=landmarks=68",
]
needs_full_device = pytest.mark.skipif(
    not os.path.exists("/dev/full"), reason="needs /dev/full"
)


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    """Three drawn photos with landmark files beside them: no detector needed."""
    return person_folder(tmp_path_factory.mktemp("person") / "photos", count=3)


def run(capsys, *words, job=reconstruct) -> tuple[int, str, str]:
    """Exit code, what was printed, what was said on stderr."""
    try:
        code = __main__.main([str(w) for w in words], job)
    except SystemExit as end:  # argparse
        code = end.code
    said = capsys.readouterr()
    assert "Traceback" not in said.err
    return code, said.out, said.err


# --- it works ------------------------------------------------------------------------


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


@pytest.fixture(scope="module")
def ready(photos):
    """A job that is done already; without photos the page takes no texture."""
    face = reconstruct(
        photos, Settings(method="motion", control_points=(10, 11), detector=False)
    )
    face = dataclasses.replace(face, photos=(), cameras=(), landmarks=())
    return lambda *args, **kwargs: face


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
    code, *_ = run(capsys, photos, "-o", tmp_path / "a.obj", "-q", job=job)
    assert code == 0
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


@needs_full_device
def test_output_that_cannot_be_printed(photos, tmp_path):
    """`--json > /dev/full`: a sentence, and no second complaint when Python ends."""
    out = str(tmp_path / "a.npz")
    words = [sys.executable, "-m", "bsface", str(photos), "-o", out, "--json", "-q"]
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [*words, *QUICK], stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert done.returncode == 1
    assert done.stderr == (
        "bsface: the standard output cannot be written (No space left on device).\n"
    )


@needs_full_device
@pytest.mark.parametrize("command", [[], ["batch"], ["export"], ["info"], ["models"]])
def test_help_that_cannot_be_printed(capfd, command):
    with open("/dev/full", "w") as full:
        words = [sys.executable, "-m", "bsface", *command, "--help"]
        assert subprocess.run(words, stdout=full).returncode == 1
    assert "cannot be written" in capfd.readouterr().err


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


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may")
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


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
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


# --- parts ---------------------------------------------------------------------------


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


# --- terminals that take nothing, or not everything ----------------------------------


SAYS = "from bsface.cli import terminal; import sys\n"


@needs_full_device
@pytest.mark.parametrize("ending", ["2>/dev/full", "2>&-", "2>&1 | true"])
def test_sentences_that_nobody_reads_do_no_harm(ending):
    """Also not at the end, when Python flushes what it could not write."""
    program = f"{SAYS}terminal.say('hello.'); terminal.tell('bye')"
    words = f"{shlex.quote(sys.executable)} -c {shlex.quote(program)} {ending}"
    found = subprocess.run(["sh", "-c", words], capture_output=True, text=True)
    assert (found.returncode, found.stdout, found.stderr) == (0, "", "")


@pytest.mark.parametrize(
    "ending, code, said",
    [
        (">&-", 1, "bsface: the standard output is closed.\n"),
        ("| head -c 1 > /dev/null", 0, ""),
    ],
)
def test_results_that_cannot_be_written(ending, code, said):
    program = f"{SAYS}sys.exit(terminal.write_out('{{}}'))"
    words = f"{shlex.quote(sys.executable)} -c {shlex.quote(program)} {ending}"
    found = subprocess.run(["sh", "-c", words], capture_output=True, text=True)
    assert (found.returncode, found.stderr) == (code, said)


def test_a_terminal_without_the_letters_of_a_name():
    program = f"{SAYS}sys.exit(terminal.write_out('gr\\u00f6\\u00dfe \\udcff'))"
    found = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
        capture_output=True,
        text=True,
    )
    assert (found.returncode, found.stdout) == (0, "gr\\xf6\\xdfe \\udcff")
