"""Every row of the table of bad input, by the library and by the command line.

By Blender's operators: tests/blender/test_bad_input.py.
"""

import json
import os
from pathlib import Path

import bad_input
import bad_input_doors as doors
import bad_photos
import numpy as np
import pytest
from bsface import ReconstructionError, Settings, reconstruct
from bsface.landmarks.face_models import find_models
from permissions import as_ordinary_user

JOBS = bad_input.job_rows()


def sentence(text: str) -> None:
    assert text[-1] in ".)", text
    assert "\n" not in text
    assert "Traceback" not in text and "Error" not in text


# --- bad photos among good ones ------------------------------------------------------


def check_folder(folder, rows, detector):
    """One run of each door; both tell the same of every photo."""
    settings = Settings(**bad_input.SETTINGS, detector=detector)
    found = reconstruct(folder, settings)
    assert np.isfinite(found.surface.control_points).all()
    told = {row.name: row for row in found.reports}
    assert set(told) == {row.name for row in rows}
    for row in rows:
        assert told[row.name].status == row.code, row
        if row.code != "used":
            sentence(told[row.name].reason)
    out = folder.parent / "out" / "face.npz"
    words = [str(folder), "-o", str(out), "--json", "-q", *bad_input.QUICK]
    if not detector:
        words.append("--set=detector=false")
    said = doors.run(words, out.parent)
    assert said.exit == 0
    assert said.left == {"face.npz"}
    assert "Traceback" not in said.errors
    printed = {row["name"]: row for row in json.loads(said.printed)["report"]}
    for name, row in told.items():
        assert (printed[name]["status"], printed[name]["reason"]) == (
            row.status,
            row.reason,
        )
    return told


@pytest.fixture(scope="module")
def dirty(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dirty") / "photos"
    rows = bad_photos.photo_rows(folder)
    with as_ordinary_user():  # one photo may not be read
        return rows, check_folder(folder, rows, detector=False)


def test_bad_photos_are_told_and_the_good_ones_used(dirty):
    rows, told = dirty
    assert sum(row.code == "used" for row in rows) >= 9
    for row in rows:
        if row.code == "used":
            continue
        # landmark files are named themselves
        stem = Path(row.name).stem
        assert stem in told[row.name].reason


def have_models():
    try:
        find_models()
    except ReconstructionError as gone:
        pytest.skip(f"the model files are not installed: {gone}")


def test_bad_photos_that_only_a_detector_meets(tmp_path):
    have_models()
    rows = bad_photos.detector_rows(tmp_path / "photos")
    told = check_folder(tmp_path / "photos", rows, detector=True)
    assert "of 2 from the left" in told["two.png"].reason


def test_two_faces_in_all_photos(tmp_path):
    have_models()
    rows = bad_photos.two_faces_rows(tmp_path / "photos")
    told = check_folder(tmp_path / "photos", rows, detector=True)
    assert all("of 2 from the left" in row.reason for row in told.values())


# --- calls that cannot be carried out ------------------------------------------------


@pytest.mark.parametrize("row", JOBS, ids=[row.title for row in JOBS])
def test_command_line(row, tmp_path, monkeypatch):
    if row.models:
        have_models()
    monkeypatch.chdir(tmp_path)  # where a hostile file would leave its trace
    words = row.make(tmp_path)
    before = set(os.listdir(tmp_path))
    with row.hold():
        said = doors.run(words, tmp_path / "out")
    assert said.exit == row.exit, said.errors
    told = doors.message(row, said)
    sentence(told)
    assert row.words in told
    assert "Traceback" not in said.errors
    assert said.printed == ""
    assert not (tmp_path / "hostile").exists()
    if row.exit:
        assert said.errors.strip().splitlines()[-1].startswith("bsface: ")
        # nothing new, and nothing half-written
        assert set(os.listdir(tmp_path)) <= before | {"out"}
        assert said.left <= {"face.npz"} & before | {"face.npz"}
        assert not (tmp_path / "out" / "face.npz").is_file()
    else:
        assert said.left == {"face.npz"}


DOORS = [row for row in JOBS if row.library]


@pytest.mark.parametrize("row", DOORS, ids=[row.title for row in DOORS])
def test_library(row, tmp_path, monkeypatch):
    """The same by Python: an exception of the promised kind with the same sentence."""
    if row.models:
        have_models()
    monkeypatch.chdir(tmp_path)
    words = row.make(tmp_path)
    with row.hold():
        told = doors.library(row, words)
    sentence(told)
    assert row.words in told
    assert not (tmp_path / "hostile").exists()
    if row.exit:
        assert not (tmp_path / "out" / "face.npz").is_file()


def test_old_output_stays_when_the_job_fails(tmp_path):
    row = next(row for row in JOBS if row.title == "the disk fills up")
    words = row.make(tmp_path)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "face.npz").write_bytes(b"the old one")
    with row.hold():
        assert doors.run(words, tmp_path / "out").exit == 1
    assert os.listdir(tmp_path / "out") == ["face.npz"]
    assert (tmp_path / "out" / "face.npz").read_bytes() == b"the old one"
    assert doors.run(words, tmp_path / "out").exit == 0
    assert (tmp_path / "out" / "face.npz").read_bytes()[:2] == b"PK"
