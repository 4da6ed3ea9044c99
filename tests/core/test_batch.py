"""Batches: restartable to the last byte, one bad folder costs only itself."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time

import pytest
from bsface import export, reconstruct
from bsface.batch import (
    memory as batch_memory,
)
from bsface.batch import (
    record as batch_record,
)
from bsface.batch import (
    run as batch,
)
from bsface.batch.processes import on_processes
from bsface.cli import batch as command
from bsface.errors import ReconstructionError
from bsface.formats.textured import exported_files, textured
from bsface.settings import Settings
from executors import InThisProcess
from fake_face import person_folder
from permissions import no_larger_files

QUICK = Settings(detector=False, method="motion", control_points=(12, 12))
WANTED = ("face.npz", "face.step")


@pytest.fixture(scope="module")
def people(tmp_path_factory):
    folder = tmp_path_factory.mktemp("people")
    for seed, name in enumerate(("ann", "bob", "zoe")):
        person_folder(folder / name, seed=seed)
    (folder / "empty").mkdir()
    (folder / "junk").mkdir()
    (folder / "junk" / "a.jpg").write_bytes(b"not a picture")
    return folder


@pytest.fixture(scope="module")
def whole(people, tmp_path_factory):
    """An uninterrupted run in this process."""
    out = tmp_path_factory.mktemp("whole")
    with InThisProcess() as executor:
        outcomes = batch.run_batch(people, out, QUICK, wanted=WANTED, executor=executor)
    return out, outcomes


def contents(folder):
    """All files but the logs, which hold times."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != "log.txt"
    }


def test_good_people_are_done_and_bad_folders_say_why(whole):
    out, outcomes = whole
    found = {o.person: o for o in outcomes}
    assert [o.person for o in outcomes] == sorted(found)
    for name in ("ann", "bob", "zoe"):
        assert found[name].status == "done" and found[name].used == 4
        assert {*WANTED, "result.json", "log.txt", "done.json"} == {
            p.name for p in (out / name).iterdir()
        }
        facts = json.loads((out / name / "result.json").read_text("utf-8"))
        assert facts["title"] == name and facts["photos"] == {"all": 4, "used": 4}
        assert facts["files"] == [*WANTED, "result.json", "log.txt"]
        assert "motion 1/1" in (out / name / "log.txt").read_text("utf-8")
    assert "holds no photos" in found["empty"].reason
    assert found["junk"].status == "failed" and "a.jpg" in found["junk"].reason
    table = list(csv.reader((out / "summary.csv").read_text().splitlines()))
    assert len(table) == 6
    assert table[1] == ["ann", "done", "4", "4", " ".join(found["ann"].warnings)]
    lines = batch_record.summary_lines(outcomes)
    assert len(lines) == 6 and "4 of 4" in lines[1]


def test_a_mesh_of_a_batch_has_the_pictures_of_a_single_run(people, tmp_path):
    shutil.copytree(people / "ann", tmp_path / "people" / "ann")
    out = tmp_path / "out"
    with InThisProcess() as executor:
        batch.run_batch(
            tmp_path / "people", out, QUICK, wanted=["face.obj"], executor=executor
        )
    face = reconstruct(people / "ann", QUICK)
    with textured(face, ["face.obj"]) as options:
        single = exported_files(export(tmp_path / "face.obj", face, options=options))
    names = [path.name for path in single]
    assert names[:3] == ["face.obj", "face.mtl", "face.png"]
    for path in single[1:]:
        assert (out / "ann" / path.name).read_bytes() == path.read_bytes()
    facts = json.loads((out / "ann" / "result.json").read_text("utf-8"))
    assert facts["files"] == [*names, "result.json", "log.txt"]
    assert {path.name for path in (out / "ann").iterdir()} == {
        *facts["files"],
        "done.json",
    }


def test_killed_and_restarted_batch_ends_with_the_same_bytes(people, whole, tmp_path):
    out = tmp_path / "out"
    script = (
        "from bsface.batch import run as batch\n"
        "from bsface.settings import Settings\n"
        "if __name__ == '__main__':\n"
        f"    batch.run_batch({str(people)!r}, {str(out)!r},\n"
        f"        Settings.from_dict({QUICK.to_dict()!r}), wanted={WANTED!r})\n"
    )
    path = tmp_path / "run.py"
    path.write_text(script)
    first = subprocess.Popen(
        [sys.executable, str(path)],
        start_new_session=True,
        stderr=subprocess.DEVNULL,
    )
    # Kill the whole group in the middle: as soon as the first person is finished.
    limit = time.monotonic() + 120
    while not list(out.glob("*/done.json")) and time.monotonic() < limit:
        assert first.poll() is None or list(out.glob("*/done.json"))
        time.sleep(0.02)
    if first.poll() is None:
        os.killpg(first.pid, signal.SIGKILL)
    first.wait()
    assert not (out / "summary.csv").exists() or first.returncode == 0
    subprocess.run([sys.executable, str(path)], check=True, timeout=300)
    assert contents(out) == contents(whole[0])


def test_finished_people_are_skipped_until_something_changes(people, whole):
    out, _ = whole

    def again(settings=QUICK):
        with InThisProcess() as executor:
            outcomes = batch.run_batch(
                people, out, settings, wanted=WANTED, executor=executor
            )
        return {o.person: o.status for o in outcomes}

    def written():
        return {p.name: p.stat().st_mtime_ns for p in (out / "ann").iterdir()}

    before = written()
    assert again()["ann"] == "skipped" and written() == before
    marks = [
        batch_record.fingerprint(people / "ann", settings.to_dict(), wanted)
        for settings, wanted in (
            (QUICK, WANTED),
            (QUICK, WANTED[:1]),
            (Settings(eye_distance_mm=60.0), WANTED),
        )
    ]
    assert len(set(marks)) == 3
    # A file that was damaged or a photo that was added asks for the work again.
    whole_bob = contents(out / "bob")
    (out / "bob" / "face.npz").write_bytes(b"")
    assert batch_record.recall(out / "bob", "x") is None
    assert again()["bob"] == "done" and contents(out / "bob") == whole_bob
    record = json.loads((out / "ann" / "done.json").read_text())
    assert set(record["files"]) == {*WANTED, "result.json"}


def test_death_of_a_worker_costs_only_its_person(people, tmp_path):
    """A process that dies is found and named; the others are done."""
    jobs = {
        name: (str(people / name), str(tmp_path / name), QUICK.to_dict(), ("face.npz",))
        for name in ("ann", "bob")
    }
    jobs["killer"] = (_Bomb(), str(tmp_path / "killer"), {}, ())
    outcomes = {o.person: o for o in on_processes(batch.run_person, jobs, 2)}
    assert outcomes["ann"].status == outcomes["bob"].status == "done"
    assert outcomes["killer"].status == "failed"
    assert "ended abruptly" in outcomes["killer"].reason


class _Bomb:
    """Ends the process that unpickles it."""

    def __reduce__(self):
        return os._exit, (9,)


@pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="memory is limited on Linux only"
)
def test_want_of_memory_costs_only_its_person(people, tmp_path):
    crowd = tmp_path / "crowd"
    shutil.copytree(people / "ann", crowd / "ann")
    (crowd / "big").mkdir()
    # 96 megapixels that take no room on the disk but 288 MB in memory
    with (crowd / "big" / "a.pgm").open("wb") as file:
        start = file.write(b"P5\n12000 8000\n255\n")
        file.truncate(start + 96_000_000)
    outcomes = batch.run_batch(
        crowd, tmp_path / "out", QUICK, wanted=WANTED, memory=batch_memory.LEAST
    )
    found = {o.person: o for o in outcomes}
    assert found["ann"].status == "done" and found["big"].status == "failed"
    reason = found["big"].reason
    assert str(crowd / "big") in reason and "0.35 GB" in reason and "--memory" in reason
    assert reason in (tmp_path / "out" / "summary.csv").read_text()


@pytest.mark.parametrize(
    "text, size",
    [("2G", 2e9), ("1.5 GB", 1.5e9), ("800m", 8e8), ("512000000", 512e6)],
)
def test_sizes_of_memory(text, size):
    assert batch_memory.parse_memory(text) == size


def test_an_empty_size_of_memory_is_no_missing_one(people, tmp_path, capsys):
    words = [str(people), str(tmp_path / "out"), "--memory="]
    assert command.main(words, InThisProcess()) == 2
    assert "is no size" in capsys.readouterr().err


def test_limits_of_memory_that_cannot_be_held(people, tmp_path):
    for text in ("", "much", "-1G", "2X"):
        with pytest.raises(ValueError, match="2G"):
            batch_memory.parse_memory(text)
    for text in ("9" * 23, "9" * 400, "10000000T"):
        with pytest.raises(ValueError, match="more than any machine"):
            batch_memory.parse_memory(text)
    with pytest.raises(ValueError, match="too low|on Linux only"):
        batch.run_batch(people, tmp_path, memory=10**6)
    with InThisProcess() as executor, pytest.raises(ValueError):
        batch.run_batch(people, tmp_path, memory=10**9, executor=executor)


def test_dask_cluster_gives_the_same_files(people, whole, tmp_path):
    distributed = pytest.importorskip(
        "distributed", reason="dask and distributed are not installed"
    )
    with (
        distributed.LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            dashboard_address=":0",
            local_directory=str(tmp_path / "dask"),
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        out = tmp_path / "out"
        batch.run_batch(
            people, out, QUICK, wanted=WANTED, executor=client.get_executor()
        )
    assert contents(out).keys() == contents(whole[0]).keys()


def test_unusable_requests_are_refused_in_a_sentence(people, tmp_path):
    with pytest.raises(ReconstructionError, match="cannot open this folder"):
        batch.run_batch(tmp_path / "none", tmp_path)
    (tmp_path / "alone").mkdir()
    with pytest.raises(ReconstructionError, match="no sub-folders"):
        batch.run_batch(tmp_path / "alone", tmp_path)
    for name in ("../face.npz", "face.doc", "other.npz", "a/face.npz"):
        with pytest.raises(ValueError, match="cannot be made"):
            batch.run_batch(people, tmp_path, wanted=(name,))
    with pytest.raises(ValueError, match="at least one worker"):
        batch.run_batch(people, tmp_path, workers=0)


@pytest.mark.skipif(not hasattr(os, "symlink"), reason="no links here")
def test_links_that_loop_are_nobody(tmp_path):
    (tmp_path / "people" / "ann").mkdir(parents=True)
    (tmp_path / "elsewhere").mkdir()
    for name, target in (
        ("loop", "."),
        ("up", ".."),
        ("circle", "circle"),
        ("bob", tmp_path / "elsewhere"),
    ):
        (tmp_path / "people" / name).symlink_to(target)
    found = batch_record.people_in(tmp_path / "people")
    assert [path.name for path in found] == ["ann", "bob"]
    # Moved away, or on a drive that is not mounted: a row that fails.
    (tmp_path / "people" / "carl").symlink_to(tmp_path / "gone")
    found = batch_record.people_in(tmp_path / "people")
    assert [path.name for path in found] == ["ann", "bob", "carl"]


@pytest.mark.parametrize("name", ["=1+1", "+1", "-1", "@a", "\tx"])
def test_no_cell_of_the_table_is_a_formula(name):
    outcome = batch_record.Outcome(name, "failed", f"{name}: no photos")
    text = batch_record.summary_csv([outcome])
    (_, row) = csv.reader(text.splitlines())
    assert row[0] == f"'{name}" and row[-1] == f"'{name}: no photos"


def test_failed_people_are_told_on_the_terminal(people, whole, capsys):
    words = [str(people), str(whole[0])]
    for name in WANTED:
        words += ["--write", name]
    words += ["--set=detector=false", "--set=method=motion"]
    words += ["--set=control_points=12,12"]
    with InThisProcess() as executor:
        code = command.main(words, executor)
    said = capsys.readouterr()
    assert code == 1 and "ann" in said.out and "[5/5]" in said.err


# --- hostile folders -----------------------------------------------------------------


def test_a_second_batch_in_the_folder_is_refused_while_the_first_runs(people, tmp_path):
    """It would take the unfinished files of the first for litter."""
    said = []

    def again(outcome, finished, total):
        with InThisProcess() as other, pytest.raises(ReconstructionError) as found:
            batch.run_batch(people, tmp_path, QUICK, wanted=WANTED, executor=other)
        said.append(str(found.value))

    with InThisProcess() as executor:
        first = batch.run_batch(
            people, tmp_path, QUICK, wanted=WANTED, executor=executor, told=again
        )
        assert [o.status for o in first].count("done") == 3
        assert len(said) == len(first) and "another batch writes" in said[0]
        # and when it has ended the folder is free
        after = batch.run_batch(
            people, tmp_path, QUICK, wanted=WANTED, executor=executor
        )
    assert [o.status for o in after].count("skipped") == 3


def test_only_unfinished_files_are_swept_away(tmp_path):
    """Hidden files of the user have a hyphen too."""
    for name in (".my-notes", ".git-credentials.txt", ".face-0123abcd.npz"):
        (tmp_path / name).write_text("mine")
    batch_record.sweep(tmp_path)
    assert sorted(os.listdir(tmp_path)) == [".git-credentials.txt", ".my-notes"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_pipe_or_a_device_among_the_photos_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.jpg")
    (tmp_path / "endless.jpg").symlink_to("/dev/zero")
    assert len(batch_record.fingerprint(tmp_path, {}, WANTED)) == 64


@pytest.mark.skipif(sys.platform != "linux", reason="semaphores are files on Linux")
def test_no_room_to_start_workers_is_a_sentence(people, tmp_path):
    with (
        no_larger_files(0),
        pytest.raises(ReconstructionError, match=r"No worker can be started \(File"),
    ):
        batch.run_batch(people, tmp_path / "out", QUICK)


def test_a_person_whose_name_is_no_text_costs_nobody(tmp_path):
    """The table is UTF-8, and so is the terminal's line."""
    folder = tmp_path / "people" / os.fsdecode(b"caf\xe9\n")
    folder.mkdir(parents=True)
    (folder / "a.jpg").write_bytes(b"no picture")
    out = tmp_path / "out"
    with InThisProcess() as executor:
        outcomes = batch.run_batch(tmp_path / "people", out, QUICK, executor=executor)
    assert [outcome.status for outcome in outcomes] == ["failed"]
    assert r"caf\udce9" in (out / "summary.csv").read_text("utf-8")
    assert all(line.isprintable() for line in batch_record.summary_lines(outcomes))


def test_a_folder_in_the_place_of_the_table_is_named(tmp_path):
    (tmp_path / "people" / "ann").mkdir(parents=True)
    (tmp_path / "out" / "summary.csv").mkdir(parents=True)
    with pytest.raises(ValueError, match=r"summary\.csv: is a folder"):
        batch.run_batch(tmp_path / "people", tmp_path / "out")
