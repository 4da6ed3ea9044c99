"""Outputs that would take another file with them are refused before the work."""

import os
import tempfile
from pathlib import Path

import numpy as np
import pytest
from bsface.cli.arguments import parse_settings
from bsface.drawing.pictures import write_png
from bsface.errors import PhotoFailure, ReconstructionError, one_line
from bsface.files import (
    is_named_pipe,
    is_temporary,
    replacing,
    temporary_folder,
    why_not_writable,
    write_text,
)
from bsface.formats import load_face
from bsface.formats.mesh import write_mesh_obj
from bsface.report.log_file import log_file
from bsface.report.outputs import check_outputs, files_of
from bsface.surface.template import load_template
from needs import needs_full_device
from permissions import as_ordinary_user


@pytest.fixture
def photos(tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    for name in ("1.png", "1.json", "1.mask.png", "2.jpg", "clip.mp4"):
        (folder / name).write_bytes(b"mine")
    return folder


def inside(folder, words):
    """The arguments of `check_outputs` with all names in a folder."""
    words = {"outputs": [], **words}
    outputs = [str(folder / name) for name in words.pop("outputs")]
    return {"outputs": outputs} | {k: str(folder / name) for k, name in words.items()}


@pytest.mark.parametrize(
    "words",
    [
        {"log": "1.png"},
        {"log": "1.json"},
        {"log": "clip.mp4"},
        {"report": "1.html"},  # with 1.json and 1.png
        {"outputs": ["1.obj"]},  # with 1.png
        {"report": "1.mask.html"},
    ],
    ids=str,
)
def test_no_photo_nor_what_belongs_to_it_is_written_over(photos, words):
    with pytest.raises(ValueError, match="belongs to the photos"):
        check_outputs(**inside(photos, words), photos=str(photos))


def test_results_may_stand_beside_the_photos_and_be_written_again(photos):
    for name in ("face.npz", "face.html", "face.json", "face.png"):
        (photos / name).write_bytes(b"an earlier result")
    outputs = [str(photos / "face.npz"), str(photos / "sub" / "1.obj")]
    check_outputs(outputs, report=str(photos / "face2.html"), photos=str(photos))


@pytest.mark.parametrize(
    "words",
    [
        {"outputs": ["a.obj"], "report": "a.html"},  # both write a.png
        {"outputs": ["a.npz"], "report": "b.html", "log": "b.json"},
        {"outputs": ["a b.obj", "a_b.obj"]},
    ],
    ids=str,
)
def test_two_outputs_with_one_file(tmp_path, words):
    with pytest.raises(ValueError, match="would both write"):
        check_outputs(**inside(tmp_path, words))


@pytest.mark.parametrize("name", ["", "a.npz", "a.OBJ", "a.nurbs.obj"])
def test_a_log_does_not_take_the_name_of_a_face(name):
    with pytest.raises(ValueError, match=r"such as run\.log"):
        check_outputs([], log=name)


def test_the_same_output_twice_is_one_output(tmp_path):
    check_outputs([str(tmp_path / "a.npz")] * 2)


@pytest.mark.parametrize("name", [".npz", "x/.nurbs.obj", ".STEP"])
def test_an_ending_alone_is_no_name(name):
    with pytest.raises(ValueError, match="a name before its ending"):
        check_outputs([name])


def test_what_goes_with_an_output_is_judged_too(tmp_path):
    (tmp_path / "a.json").mkdir()
    (tmp_path / "b.mtl").mkdir()
    with pytest.raises(ValueError, match=r"a\.json: is a folder"):
        check_outputs([], report=str(tmp_path / "a.html"))
    with pytest.raises(ValueError, match=r"b\.mtl: is a folder"):
        check_outputs([str(tmp_path / "b.obj")])


def test_a_textured_obj_makes_no_other_files_than_are_judged(tmp_path):
    picture = write_png(tmp_path / "x.png", np.zeros((8, 8, 3), np.uint8))
    path = tmp_path / "made" / "my face.obj"
    path.parent.mkdir()
    write_mesh_obj(
        path,
        load_template().surface.resampled((8, 8)),
        tolerance=5.0,
        texture=picture,
        normals=picture,
        displacement=picture,
    )
    made = set(path.parent.iterdir())
    assert len(made) == 5 and made <= set(files_of(path))


def test_places_where_no_file_can_stand(tmp_path):
    assert "null" in why_not_writable(tmp_path / "a\0b.npz")
    os.mkfifo(tmp_path / "pipe.npz")
    assert "no regular file" in why_not_writable(tmp_path / "pipe.npz")
    (tmp_path / "loop.npz").symlink_to("loop.npz")
    assert "in a circle" in why_not_writable(tmp_path / "loop.npz")
    (tmp_path / "kept.npz").write_bytes(b"old")
    (tmp_path / "kept.npz").chmod(0o444)
    with as_ordinary_user():
        assert "write-protected" in why_not_writable(tmp_path / "kept.npz")
    check_outputs([], log="/dev/null")


def test_a_log_waits_for_no_reader_of_a_pipe(tmp_path):
    pipe = tmp_path / "run.log"
    os.mkfifo(pipe)
    with pytest.raises(ValueError, match=r"run\.log: is no regular file"):
        check_outputs([], log=str(pipe))
    with pytest.raises(ReconstructionError, match="no regular"), log_file(pipe, "test"):
        pass
    # a pipeline's
    end, other = os.pipe()
    assert not is_named_pipe(f"/proc/self/fd/{other}")
    for handle in (end, other):
        os.close(handle)


def test_a_link_stays_and_what_it_leads_to_is_replaced(tmp_path):
    (tmp_path / "there").mkdir()
    real, link = tmp_path / "there" / "real.txt", tmp_path / "link.txt"
    real.write_text("old")
    link.symlink_to(real)
    write_text(link, "new")
    assert link.is_symlink() and real.read_text() == "new"
    assert os.listdir(tmp_path / "there") == ["real.txt"]


def test_unfinished_files_are_known_by_their_names(tmp_path):
    for name in ("face.npz", "summary.csv", "x" * 200 + ".obj", "no ending"):
        with replacing(tmp_path / name) as temporary:
            assert is_temporary(temporary.name)
    for name in (".my-notes", ".git-credentials", "a-12345678.npz", ".a-1234567g.npz"):
        assert not is_temporary(name)


@pytest.mark.parametrize("load", [load_face, load_template])
def test_a_pipe_or_a_device_is_no_file_to_read(tmp_path, load):
    """To open a pipe, or to read /dev/zero, takes for ever."""
    os.mkfifo(tmp_path / "pipe.npz")
    for path in (tmp_path / "pipe.npz", "/dev/zero"):
        with pytest.raises((ReconstructionError, ValueError), match="no regular file"):
            load(path)


@needs_full_device
def test_a_log_on_a_full_disk_is_a_sentence(capfd):
    with (
        pytest.raises(ReconstructionError, match=r"the log cannot be written \(No sp"),
        log_file(Path("/dev/full"), "test") as log,
    ):
        log.info("a line")
    assert capfd.readouterr().err == ""


def test_a_log_takes_names_that_are_no_text(tmp_path):
    with log_file(tmp_path / "a.log", "test") as log:
        log.info("%s", os.fsdecode(b"caf\xe9.jpg"))
    assert r"caf\udce9.jpg" in (tmp_path / "a.log").read_text("utf-8")


def test_no_place_for_temporary_files_is_a_sentence(tmp_path):
    before, tempfile.tempdir = tempfile.tempdir, str(tmp_path / "gone")
    try:
        with pytest.raises(ReconstructionError, match="set TMPDIR"), temporary_folder():
            pass
    finally:
        tempfile.tempdir = before


def test_sentences_stay_on_one_line_and_steer_no_terminal():
    name = "a\nb\x1b[2J\udcff\u202egpj.jpg"
    for text in (
        str(ReconstructionError(f"{name}: bad.")),
        PhotoFailure(name, "unreadable", f"{name} is bad.").reason,
    ):
        assert text.isprintable() and r"a\nb\x1b[2J\udcff\u202egpj.jpg" in text
    assert one_line("größe 脸 🙂") == "größe 脸 🙂"


@pytest.mark.parametrize("second", ["FACE.npz", "Face.html"])
def test_names_that_many_systems_take_for_one(tmp_path, second):
    """macOS and Windows do not tell capitals from small letters."""
    outputs = ["face.npz"] + ([second] if second.endswith("npz") else [])
    words = {"outputs": outputs}
    if second.endswith("html"):
        words = {"outputs": ["face.glb"], "report": second, "log": "FACE.json"}
    with pytest.raises(ValueError, match="which many systems take for one"):
        check_outputs(**inside(tmp_path, words))


def test_a_template_is_not_written_over(tmp_path):
    mine = tmp_path / "mine.npz"
    mine.write_bytes(b"a template")
    for name in ("mine.npz", "./mine.npz"):
        with pytest.raises(ValueError, match="is read and would be written over"):
            check_outputs([f"{tmp_path}/{name}"], read=[str(mine)])
    check_outputs([f"{tmp_path}/other.npz"], read=[str(mine)])


@pytest.mark.parametrize(
    "words",
    [
        {"log": "2.pts"},
        {"log": "2.JSON"},
        {"outputs": ["2.mask.obj"]},  # with 2.mask.png
        {"report": "2.html"},  # with 2.json
    ],
    ids=str,
)
def test_nothing_is_written_that_the_next_run_takes_for_part_of_a_photo(photos, words):
    with pytest.raises(ValueError, match="landmarks or the mask of a photo"):
        check_outputs(photos=str(photos), **inside(photos, words))


def test_the_texture_of_an_obj_may_be_a_jpeg(photos):
    with pytest.raises(ValueError, match=r"2\.jpg belongs to the photos"):
        check_outputs([str(photos / "2.obj")], photos=str(photos))


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o664])
def test_a_replaced_file_keeps_its_permissions(tmp_path, mode):
    path = tmp_path / "a.npz"
    path.write_bytes(b"old")
    path.chmod(mode)
    with replacing(path) as temporary:
        temporary.write_bytes(b"new")
    assert path.read_bytes() == b"new"
    assert path.stat().st_mode & 0o777 == mode


def test_a_setting_that_is_given_twice():
    with pytest.raises(ValueError, match="The setting lam is given twice"):
        parse_settings(["lam=1", "method=paper", "lam=2"])


def test_words_of_set_that_are_no_json():
    digits = "control_points=" + "9" * 5000 + ",3"
    words = ("lam=" + "[" * 100_000, "=5", "=", "control_points=\u00b2,3", digits)
    for word in words:
        with pytest.raises(ValueError, match="--set takes|must be|no setting") as said:
            parse_settings([word])
        assert len(str(said.value)) < 200
