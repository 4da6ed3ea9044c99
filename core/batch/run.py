"""Many people: one reconstruction a folder, on any ``concurrent.futures`` executor.

PEOPLE holds one sub-folder of photos a person; OUT gets one folder a person and
``summary.csv``. A batch may be killed at any time and started again: people that are
finished and whose photos and settings have not changed are skipped, and the end is the
same, byte for byte. A bad folder, a crash and even the death of a worker cost only that
person. A worker process does one person and ends, which gives its memory back.
"""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import os
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import cv2

from .._start import WORKER
from ..errors import ReconstructionError
from ..files import write_text
from ..formats import ending, export
from ..reconstruct import reconstruct
from ..report.report import write_report
from ..settings import Settings
from ..texture.bake import bake_texture, write_texture
from .memory import (
    check_memory,
    ended_abruptly,
    for_want_of_memory,
    held_to,
    limit_memory,
    too_little,
)
from .record import (
    Outcome,
    fingerprint,
    people_in,
    recall,
    summary_csv,
    sweep,
    write_record,
)

logger = logging.getLogger(__name__)

#: What a batch writes for each person unless told otherwise.
WANTED = ("face.npz", "report.html")
#: Stands for the date in the face files of a batch.
RECORD_DATE = "1980-01-01T00:00:00Z"
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")

Told = Callable[[Outcome, int, int], None]
Outcomes = Generator[Outcome, None, None]


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
        Folder with one sub-folder a person.
    out : path-like
        Folder for the results.
    settings : Settings, optional
        The same for all.
    wanted : sequence of str
        Files a person: ``face.`` with any ending of ``formats``, ``report.html`` and
        ``texture.png``.
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
    ReconstructionError
        When there are no people, OUT cannot be written or ``memory`` cannot be held.
    """
    folders = people_in(people)
    out = Path(out)
    _check_wanted(wanted)
    check_memory(memory)
    if executor is not None and memory is not None:
        raise ReconstructionError(
            "The limit of memory holds for processes here only; give that of "
            "the cluster to its workers (`dask worker --memory-limit`)."
        )
    with contextlib.suppress(OSError):
        out.mkdir(parents=True, exist_ok=True)
        sweep(out)
    values = (settings or Settings()).to_dict()
    jobs = {
        folder.name: (str(folder), str(out / folder.name), values, tuple(wanted))
        for folder in folders
    }
    finished: dict[str, Outcome] = {}
    if executor is None:
        runs = _on_processes(jobs, max(1, workers), memory)
    else:
        runs = _on_executor(executor, jobs)
    try:
        for outcome in runs:
            finished[outcome.person] = outcome
            if told is not None:
                told(outcome, len(finished), len(jobs))
    except BaseException:
        runs.close()
        for name in jobs:
            sweep(out / name)
        raise
    outcomes = tuple(finished[name] for name in jobs)
    write_text(out / "summary.csv", summary_csv(outcomes))
    return outcomes


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
        result = reconstruct(folder, Settings.from_dict(settings))
        texture = None
        if "texture.png" in wanted:
            texture = bake_texture(result)
        for name in wanted:
            path = target / name
            if name == "report.html":
                write_report(path, result, timings=False, title=person)
            elif name == "texture.png" and texture is not None:
                write_texture(path, texture.albedo, mask=texture.measured)
            elif name.endswith(".npz"):
                # A fixed date: a batch ends with the same bytes however often it was
                # stopped.
                result.save(path, date=RECORD_DATE)
            else:
                export(path, result, name=person)
        files = list(wanted)
        if "report.html" in wanted:
            files += ["report.json", "report.png"]
        outcome = Outcome(
            person=person,
            status="done",
            used=sum(r.status == "used" for r in result.reports),
            photos=len(result.reports),
            warnings=tuple(result.warnings),
            files=tuple(files),
            seconds=time.perf_counter() - start,
        )
        write_record(target, mark, outcome)
        return outcome
    except Exception as error:
        reason = _why(error, folder)
    seconds = time.perf_counter() - start
    return Outcome(person, "failed", reason, seconds=seconds)


def _why(error: Exception, folder: str) -> str:
    """What stopped a person, in a sentence."""
    if for_want_of_memory(error):
        return too_little(folder, held_to())
    if isinstance(error, ReconstructionError):
        return str(error)
    # A fault of ours in one folder must not stop the other people.
    logger.error("batch: %s", folder, exc_info=error)
    return f"{folder}: unexpected {type(error).__name__}: {error}"


def _check_wanted(wanted: Sequence[str]) -> None:
    for name in wanted:
        if name in ("report.html", "texture.png"):
            continue
        if Path(name).name != name or not ending(name):
            raise ReconstructionError(
                f"{name!r} cannot be made by a batch; ask for face.npz, face.step, "
                "another ending of a face, report.html or texture.png."
            )


# ----------------------------------------------------------------- execution
def _on_executor(executor: Executor, jobs: dict[str, tuple]) -> Outcomes:
    """Outcomes as they come from an executor that lives elsewhere."""
    futures = {executor.submit(run_person, *job): name for name, job in jobs.items()}
    try:
        for future in as_completed(futures):
            yield _result(future, futures[future])
    finally:
        for future in futures:
            future.cancel()


def _on_processes(
    jobs: dict[str, tuple], workers: int, memory: int | None = None
) -> Outcomes:
    """Outcomes from processes here, which may die without stopping the rest."""
    waiting = dict(jobs)
    with _as_workers():
        while waiting:
            for outcome in _one_pool(waiting, workers, memory):
                waiting.pop(outcome.person)
                yield outcome
            # Left over: a worker died. It was one of the first in line; take these
            # alone, so that the next death has a name.
            for name in list(waiting)[: 2 * workers + 1]:
                outcomes = list(_one_pool({name: waiting[name]}, 1, memory))
                reason = ended_abruptly(waiting[name][0], memory)
                waiting.pop(name)
                yield outcomes[0] if outcomes else Outcome(name, "failed", reason)


def _one_pool(jobs: dict[str, tuple], workers: int, memory: int | None) -> Outcomes:
    """Outcomes of one pool until all are done or one of its processes dies."""
    # A fresh interpreter for every person: nothing is inherited, all memory returns.
    pool = ProcessPoolExecutor(
        min(workers, len(jobs)),
        mp_context=multiprocessing.get_context("spawn"),
        max_tasks_per_child=1,
        initializer=limit_memory,
        initargs=(memory,),
    )
    try:
        futures = {pool.submit(run_person, *job): name for name, job in jobs.items()}
        for future in as_completed(futures):
            if isinstance(future.exception(), BrokenProcessPool):
                continue
            yield _result(future, futures[future])
    except BrokenProcessPool:
        return
    except BaseException:
        # Interrupted: nobody waits for what is being computed.
        for process in list(pool._processes.values()):
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _result(future: Any, person: str) -> Outcome:
    """The outcome of a future; what a worker could not even report is a failure."""
    error = future.exception()
    if error is None:
        return future.result()
    return Outcome(person, "failed", f"{person}: {type(error).__name__}: {error}")


@contextlib.contextmanager
def _as_workers() -> Iterator[None]:
    """Processes that start here compute with one thread and end without a word."""
    names = (*_THREADS, WORKER)
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
