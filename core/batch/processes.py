"""Jobs on other processes: an executor that lives elsewhere, or processes here.

A process here does one job and ends, which gives its memory back; its death costs only
that job.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
from collections.abc import Callable, Generator, Iterator, Mapping
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from .._start import WORKER
from ..errors import ReconstructionError
from .memory import ended_abruptly, limit_memory
from .record import Outcome

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")

#: Name of the person -> arguments of the work; the first is the folder.
Jobs = Mapping[str, tuple]
Work = Callable[..., Outcome]
Outcomes = Generator[Outcome, None, None]


def on_executor(executor: Executor, work: Work, jobs: Jobs) -> Outcomes:
    """Outcomes as they come from an executor that lives elsewhere."""
    futures = {executor.submit(work, *job): name for name, job in jobs.items()}
    try:
        for future in as_completed(futures):
            yield _result(future, futures[future])
    finally:
        for future in futures:
            future.cancel()


def on_processes(
    work: Work, jobs: Jobs, workers: int, memory: int | None = None
) -> Outcomes:
    """Outcomes from processes here, which may die without stopping the rest.

    Parameters
    ----------
    work : callable
        At the top level of a module; takes the arguments of a job.
    jobs : mapping
    workers : int
        Processes at a time.
    memory : int, optional
        Bytes that each may have.
    """
    waiting = dict(jobs)
    with _as_workers():
        while waiting:
            for outcome in _one_pool(work, waiting, workers, memory):
                waiting.pop(outcome.person)
                yield outcome
            # Left over: a worker died. It was one of the first in line; take these
            # alone, so that the next death has a name.
            for name in list(waiting)[: 2 * workers + 1]:
                alone = {name: waiting.pop(name)}
                outcomes = list(_one_pool(work, alone, 1, memory))
                reason = ended_abruptly(alone[name][0], memory)
                yield outcomes[0] if outcomes else Outcome(name, "failed", reason)


def _one_pool(work: Work, jobs: Jobs, workers: int, memory: int | None) -> Outcomes:
    """Outcomes of one pool until all are done or one of its processes dies."""
    # A fresh interpreter for every person: nothing is inherited, all memory returns.
    try:
        with hangup_held_back():
            pool = ProcessPoolExecutor(
                min(workers, len(jobs)),
                mp_context=multiprocessing.get_context("spawn"),
                max_tasks_per_child=1,
                initializer=limit_memory,
                initargs=(memory,),
            )
    except OSError as error:  # no room for semaphores
        raise ReconstructionError(
            f"No worker can be started ({error.strerror}); free some space in /dev/shm "
            "and on the disk."
        ) from None
    try:
        futures = {pool.submit(work, *job): name for name, job in jobs.items()}
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
def hangup_held_back() -> Iterator[None]:
    """SIGHUP waits until the block ends, and for ever in processes that start in it.

    The first pool starts Python's tracker of semaphores. A terminal that is closed
    would end it before us, and Python would print tracebacks about that.
    """
    if not hasattr(signal, "SIGHUP"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGHUP])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


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
