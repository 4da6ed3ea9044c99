"""Many people: one reconstruction per folder, on any ``concurrent.futures`` executor.

PEOPLE holds one sub-folder of photos per person; OUT gets one folder per person and
``summary.csv``. A batch may be killed at any time and started again: people that are
finished and whose photos and settings have not changed are skipped, and the end is the
same, byte for byte, apart from the logs, which hold times. A bad folder, a crash and
even the death of a worker cost only that person.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2

from ..errors import ReconstructionError
from ..files import why_not_writable, write_text
from ..formats import ending, export
from ..formats.textured import exported_files, textured
from ..json_text import to_json
from ..kinds import expect_paths
from ..reconstruct import reconstruct
from ..report.facts import result_facts
from ..report.log_file import log_file, logged
from ..report.report import write_report
from ..result import Reconstruction
from ..settings import Settings
from ..texture.bake import bake_texture, write_texture
from .lock import only_batch_in
from .memory import check_memory, for_want_of_memory, held_to, too_little
from .processes import Jobs, Outcomes, on_executor, on_processes
from .record import (
    Outcome,
    fingerprint,
    left_over,
    people_in,
    recall,
    summary_csv,
    sweep,
    write_record,
)

#: What a batch writes for each person unless told otherwise.
WANTED = ("face.npz", "report.html")
#: What a batch always writes for each person: the facts (`report.facts`) and a log.
FACTS, LOG = "result.json", "log.txt"
#: And for all of them together.
TABLE = "summary.csv"

#: In the face files of a batch, which are to be the same whenever it is run.
DATE = "1980-01-01T00:00:00Z"

Told = Callable[[Outcome, int, int], None]


def run_batch(
    people: str | os.PathLike,
    out: str | os.PathLike,
    settings: Settings | None = None,
    *,
    wanted: Sequence[str] = WANTED,
    workers: int = 2,
    executor: Executor | None = None,
    memory: int | None = None,
    told: Told | None = None,
) -> tuple[Outcome, ...]:
    """Reconstruct every person of a folder.

    Parameters
    ----------
    people : path-like
        Folder with one sub-folder per person.
    out : path-like
        Folder for the results.
    settings : Settings, optional
        The same for all.
    wanted : sequence of str
        Files per person: ``face.`` with any ending of ``formats``, ``report.html`` and
        ``texture.png``. ``result.json`` and ``log.txt`` are always written.
    workers : int
        Processes on this machine, when no executor is given.
    executor : Executor, optional
        Where to compute instead, such as the executor of a Dask client. Its workers
        must see both folders under the same names.
    memory : int, optional
        Bytes that a process on this machine may have; Linux only. A person who needs
        more fails with a sentence, the others go on.
    told : callable, optional
        Receives each outcome, how many are finished, and how many there are.

    Returns
    -------
    tuple of Outcome
        In the order of the people's names.

    Raises
    ------
    ValueError
        When an argument cannot be carried out: ``workers`` below 1, a file that a batch
        does not make, a limit of memory that cannot be held, OUT inside PEOPLE or in
        a place where nothing can be written.
    ReconstructionError
        When there are no people, or another batch runs in OUT.
    """
    expect_paths(people=people, out=out)
    if not os.fspath(people) or not os.fspath(out):
        # `Path` would take the present folder.
        raise ValueError("The name of a folder of the batch is empty; give both.")
    out = Path(out)
    _check_wanted(wanted)
    _check_out(Path(people), out)
    check_memory(memory)
    if workers < 1:
        raise ValueError(f"A batch needs at least one worker, not {workers}.")
    if executor is not None and memory is not None:
        raise ValueError(
            "The limit of memory holds for processes here only; give that of "
            "the cluster to its workers (`dask worker --memory-limit`)."
        )
    folders = people_in(people)
    wanted = tuple(dict.fromkeys(wanted))
    values = (settings or Settings()).to_dict()
    _check_people(folders, out)
    jobs = {
        folder.name: (str(folder), str(out / folder.name), values, wanted)
        for folder in folders
    }
    with contextlib.suppress(OSError):
        out.mkdir(parents=True, exist_ok=True)
    with only_batch_in(out):
        with contextlib.suppress(OSError):
            sweep(out)
        if executor is None:
            runs = on_processes(run_person, jobs, workers, memory)
        else:
            runs = on_executor(executor, run_person, jobs)
        finished = _finished(runs, out, jobs, told)
        outcomes = tuple(finished[name] for name in jobs)
        write_text(out / TABLE, summary_csv(outcomes))
    return outcomes


def _finished(
    runs: Outcomes, out: Path, jobs: Jobs, told: Told | None
) -> dict[str, Outcome]:
    """The outcomes by name; whoever stops this leaves no unfinished files."""
    finished: dict[str, Outcome] = {}
    try:
        for run in runs:
            outcome = _with_left_over(run, out / run.person)
            finished[outcome.person] = outcome
            if told is not None:
                told(outcome, len(finished), len(jobs))
    except BaseException:
        runs.close()
        for name in jobs:
            sweep(out / name)
        raise
    return finished


def _with_left_over(outcome: Outcome, target: Path) -> Outcome:
    """The outcome with a warning when files of other runs stand beside it."""
    older = left_over(target, outcome.files)
    if not older:
        return outcome
    warning = (
        "From an earlier run, perhaps of other photos or settings: "
        f"{', '.join(older)}; remove what you do not need."
    )
    return replace(outcome, warnings=(*outcome.warnings, warning))


def run_person(
    folder: str, out: str, settings: dict[str, Any], wanted: Sequence[str]
) -> Outcome:
    """One person, in whatever process this is; never raises for a bad folder."""
    # One thread each: the workers share the cores, and sums keep their order.
    cv2.setNumThreads(1)
    person, target = Path(folder).name, Path(out)
    start = time.perf_counter()
    try:
        mark = fingerprint(Path(folder), settings, wanted)
        sweep(target)
        known = recall(target, mark)
        if known is not None:
            return known
        with log_file(target / LOG, f"bsface batch: {folder}"):
            face = reconstruct(
                folder, Settings.from_dict(settings), progress=logged(None)
            )
            files = _write(face, target, wanted)
        outcome = Outcome(
            person=person,
            status="done",
            used=sum(row.status == "used" for row in face.reports),
            photos=len(face.reports),
            warnings=tuple(face.warnings),
            files=files,
            seconds=time.perf_counter() - start,
        )
        write_record(target, mark, outcome)
        return outcome
    except Exception as error:
        reason = _why(error, folder)
        photos = len(getattr(error, "photos", ()))
    seconds = time.perf_counter() - start
    return Outcome(person, "failed", reason, photos=photos, seconds=seconds)


def _write(
    face: Reconstruction, target: Path, wanted: Sequence[str]
) -> tuple[str, ...]:
    """Write a person's files; their names, without that of the log."""
    files: list[str] = []
    with textured(face, wanted) as options:
        for name in wanted:
            path = target / name
            files.append(name)
            if name == "report.html":
                # its JSON would be that of FACTS
                write_report(
                    path, face, timings=False, title=target.name, companions=(".png",)
                )
                files.append("report.png")
            elif name == "texture.png":
                texture = bake_texture(face, detail=False)
                write_texture(path, texture.albedo, mask=texture.measured)
            elif name == "face.npz":
                face.save(path, date=DATE)
            else:
                export(path, face, options=replace(options, name=target.name))
                files += [one.name for one in exported_files(path)[1:]]
    files.append(FACTS)
    facts = result_facts(face, title=target.name, files=[*files, LOG], timings=False)
    write_text(target / FACTS, to_json(facts, indent=1) + "\n")
    return tuple(files)


def _why(error: Exception, folder: str) -> str:
    """What stopped a person, in a sentence."""
    if for_want_of_memory(error):
        return too_little(folder, held_to())
    if isinstance(error, ReconstructionError):
        return str(error)
    # A fault of ours in one folder must not stop the other people; the log has it all.
    return f"{folder}: unexpected {type(error).__name__}: {error}"


def _check_wanted(wanted: Sequence[str]) -> None:
    """Raise a ValueError for a file that a batch does not make."""
    for name in wanted:
        if name in ("report.html", "texture.png"):
            continue
        if not ending(name) or name != f"face{ending(name)}":
            raise ValueError(
                f"{name!r} cannot be made by a batch; ask for face.npz, face.step, "
                "another ending of a face, report.html or texture.png."
            )


def _check_people(folders: Sequence[Path], out: Path) -> None:
    """Raise a ValueError for people whose results cannot stand side by side."""
    places: dict[tuple[int, int], Path] = {}
    alike = Counter(folder.name.casefold() for folder in folders)
    for folder in folders:
        if folder.name.casefold() == TABLE:
            raise ValueError(
                f"{folder} has the name of the batch's table; rename this folder."
            )
        target = out / folder.name
        with contextlib.suppress(OSError):
            if alike[folder.name.casefold()] > 1:  # one folder on some drives
                target.mkdir(parents=True, exist_ok=True)
            info = target.stat()
            first = places.setdefault((info.st_dev, info.st_ino), target)
            if first != target:
                raise ValueError(
                    f"{first} and {target} are one folder; give two people two."
                )


def _check_out(people: Path, out: Path) -> None:
    """Raise a ValueError for a folder in which results cannot stand."""
    if Path(os.path.realpath(out)).is_relative_to(os.path.realpath(people)):
        raise ValueError(
            f"{out} lies in the folder of the people, so that the next run would take "
            "results for photos; choose another folder for the results."
        )
    table = out / TABLE
    why = why_not_writable(table)
    if why:
        raise ValueError(f"{table if table.is_dir() else out}: {why}.")
