"""Every row of the table of bad input, by the library and by the command line."""

import json
import os
from pathlib import Path

import bad_input
import numpy as np
import pytest
from bsface import ReconstructionError, Settings, load_template, reconstruct
from bsface.evidence.face_models import find_models
from bsface.output.formats import export

JOBS = bad_input.job_rows()
PAGE = bad_input.ROOT / "docs" / "bad_input.md"


def sentence(text: str) -> None:
    assert text[-1] in ".)", text
    assert "\n" not in text
    assert "Traceback" not in text and "Error" not in text


def on_page(folder: Path, *cells: object) -> None:
    """The documentation shows this message."""
    line = bad_input.table_line(folder, *cells)
    assert line in PAGE.read_text("utf-8").splitlines(), (
        f"{line}\nis not in docs/bad_input.md: run python docs/bad_input_page.py"
    )


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
        on_page(folder.parent, row.title, row.code, told[row.name].reason)
    out = folder.parent / "out" / "face.npz"
    words = [str(folder), "-o", str(out), "--json", "-q", *bad_input.QUICK]
    if not detector:
        words.append("--set=detector=false")
    said = bad_input.run(words, out.parent)
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
    rows = bad_input.photo_rows(folder)
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


def test_bad_photos_that_only_a_detector_meets(tmp_path):
    try:
        find_models()
    except ReconstructionError as gone:
        pytest.skip(f"the model files are not installed: {gone}")
    rows = bad_input.detector_rows(tmp_path / "photos")
    told = check_folder(tmp_path / "photos", rows, detector=True)
    assert "of 2 from the left" in told["two.png"].reason


# --- calls that cannot be carried out ------------------------------------------------


@pytest.mark.parametrize("row", JOBS, ids=[row.title for row in JOBS])
def test_command_line(row, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # where a hostile file would leave its trace
    words = row.make(tmp_path)
    before = set(os.listdir(tmp_path))
    with row.hold():
        said = bad_input.run(words, tmp_path / "out")
    assert said.exit == row.exit, said.errors
    on_page(tmp_path, row.title, said.exit, bad_input.message(row, said))
    assert row.words in said.errors
    assert "Traceback" not in said.errors
    assert said.printed == ""
    assert not (tmp_path / "hostile").exists()
    if row.exit:
        last = said.errors.strip().splitlines()[-1]
        assert last.startswith("bsface: ")
        sentence(last)
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
    monkeypatch.chdir(tmp_path)
    words = row.make(tmp_path)
    if row.title == "not enough memory":
        pytest.skip("MemoryError passes through the library as it is")
    folder, out = words[0], words[2]
    options = {w.split("=", 1)[0]: w.split("=", 1)[1] for w in words[3:] if "=" in w}
    pairs = [w.removeprefix("--set=") for w in words[3:] if w.startswith("--set=")]

    def job():
        from bsface.__main__ import parse_settings

        settings: Settings = parse_settings(pairs)
        path = options.get("--template")
        template = load_template(path) if path else None
        ignore = [w.removeprefix("--ignore=") for w in words if "--ignore" in w]
        face = reconstruct(folder, settings, template=template, ignore=ignore)
        export(out, face)
        return face

    with row.hold():
        if row.exit == 0:
            assert any(row.words in warning for warning in job().warnings)
            return
        with pytest.raises((ReconstructionError, ValueError)) as caught:
            job()
    # the command line tells some faults of the output before the work, so the words
    # may differ there
    sentence(str(caught.value))
    if "output" not in row.title:
        assert row.words in str(caught.value)
    assert not (tmp_path / "hostile").exists()
    assert not (tmp_path / "out" / "face.npz").is_file()


def test_old_output_stays_when_the_job_fails(tmp_path):
    row = next(row for row in JOBS if row.title == "the disk is full")
    words = row.make(tmp_path)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "face.npz").write_bytes(b"the old one")
    with row.hold():
        assert bad_input.run(words, tmp_path / "out").exit == 1
    assert os.listdir(tmp_path / "out") == ["face.npz"]
    assert (tmp_path / "out" / "face.npz").read_bytes() == b"the old one"
    assert bad_input.run(words, tmp_path / "out").exit == 0
    assert (tmp_path / "out" / "face.npz").read_bytes()[:2] == b"PK"
