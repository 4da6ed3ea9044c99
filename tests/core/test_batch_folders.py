"""Folders of a batch that others have used, or that stand in each other's way."""

import csv
import json

import pytest
from bsface.batch import record as batch_record
from bsface.batch import run as batch
from bsface.settings import Settings
from executors import InThisProcess
from fake_face import person_folder

QUICK = Settings(detector=False, method="motion", control_points=(12, 12))


@pytest.fixture
def people(tmp_path):
    person_folder(tmp_path / "people" / "ann", seed=0)
    return tmp_path / "people"


def run(people, out, settings=QUICK, wanted=("face.npz",)):
    """The outcomes, and the remarks of the table."""
    with InThisProcess() as executor:
        outcomes = batch.run_batch(
            people, out, settings, wanted=wanted, executor=executor
        )
    table = csv.DictReader((out / "summary.csv").read_text("utf-8").splitlines())
    return outcomes, [row["remark"] for row in table]


def test_files_of_other_settings_are_named(people, tmp_path):
    """`face.step` of the first run is not the face that the second one finds."""
    out = tmp_path / "out"
    both = ("face.npz", "face.step")
    _, (remark,) = run(people, out, wanted=both)
    assert "earlier run" not in remark
    other = Settings(**{**QUICK.to_dict(), "eye_distance_mm": 70.0})
    for status in ("done", "skipped"):
        (outcome,), (remark,) = run(people, out, other)
        assert outcome.status == status
        assert "From an earlier run" in remark and "face.step;" in remark
        assert "face.npz" not in remark
    (out / "ann" / "face.step").unlink()
    (outcome,), (remark,) = run(people, out, other)
    assert outcome.status == "skipped" and "earlier run" not in remark


def test_files_beside_a_failure_are_named(people, tmp_path):
    out = tmp_path / "out"
    run(people, out)
    for path in (people / "ann").iterdir():
        path.unlink()
    (outcome,), (remark,) = run(people, out)
    assert outcome.status == "failed"
    assert remark.startswith(outcome.reason)
    assert remark.endswith("face.npz, result.json; remove what you do not need.")
    assert (out / "ann" / "face.npz").exists()


@pytest.mark.parametrize(
    "content", [None, b"", b"[]", b"\xff", b'{"files": 3}', b"[" * 100000]
)
def test_a_record_that_cannot_be_read_names_nothing(tmp_path, content):
    if content is not None:
        (tmp_path / "done.json").write_bytes(content)
    assert batch_record.left_over(tmp_path, ()) == ()


def test_a_record_of_the_version_before(tmp_path):
    record = {"files": {"face.npz": "", "gone.npz": ""}}
    (tmp_path / "done.json").write_text(json.dumps(record))
    (tmp_path / "face.npz").touch()
    assert batch_record.left_over(tmp_path, ()) == ("face.npz",)


@pytest.mark.parametrize("name", ["summary.csv", "Summary.CSV"])
def test_a_person_with_the_name_of_the_table(people, tmp_path, name):
    (people / name).mkdir()
    with pytest.raises(ValueError, match="has the name of the batch's table"):
        run(people, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_two_people_with_one_folder_of_results(people, tmp_path):
    """As links make them, or a drive that takes ann and Ann for one."""
    person_folder(people / "Ann", seed=1)
    (tmp_path / "out" / "ann").mkdir(parents=True)
    (tmp_path / "out" / "Ann").symlink_to("ann")
    with pytest.raises(ValueError, match="are one folder; give two people two"):
        run(people, tmp_path / "out")
