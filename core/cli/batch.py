"""``python -m bsface batch``: one face from each sub-folder of photos.

python -m bsface batch PEOPLE OUT [--workers 2] [--memory 2G]
                                  [--scheduler tcp://host:8786]
                                  [--set NAME=VALUE ...] [--write FILE ...]
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor

from ..batch.memory import parse_memory
from ..batch.record import Outcome, summary_lines
from ..batch.run import WANTED, run_batch
from ..errors import ReconstructionError
from ..settings import Settings
from .arguments import parse_settings


def parser() -> argparse.ArgumentParser:
    """The command line of ``python -m bsface batch``."""
    p = argparse.ArgumentParser(
        prog="bsface batch", description="One face from each sub-folder of photos."
    )
    p.add_argument("people", help="folder with one sub-folder of photos a person")
    p.add_argument("out", help="folder for the results")
    p.add_argument("--workers", type=int, default=2, help="processes here, default 2")
    p.add_argument(
        "--memory", metavar="SIZE", help="most memory a worker, such as 2G (Linux)"
    )
    p.add_argument("--scheduler", metavar="ADDRESS", help="a Dask scheduler instead")
    p.add_argument(
        "--write",
        action="append",
        metavar="FILE",
        help="file a person, such as face.step or texture.png; may be given again "
        f"(default {', '.join(WANTED)})",
    )
    p.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a setting, the same for all people",
    )
    return p


def main(argv: Sequence[str], settings: Settings | None = None) -> int:
    """Run a batch from the command line.

    Returns
    -------
    int
        0 all done, 1 some failed or the batch could not run, 2 the call is wrong,
        130 interrupted.
    """
    options = parser().parse_args(argv)
    try:
        if options.set or settings is None:
            settings = parse_settings(options.set)
        memory = parse_memory(options.memory) if options.memory else None
    except ValueError as error:
        sys.stderr.write(f"bsface: {error}\n")
        return 2

    def told(outcome: Outcome, finished: int, total: int) -> None:
        sys.stderr.write(f"[{finished}/{total}] {outcome.person}: {outcome.status}\n")

    try:
        with _client(options.scheduler) as executor:
            outcomes = run_batch(
                options.people,
                options.out,
                settings,
                wanted=options.write or WANTED,
                workers=options.workers,
                executor=executor,
                memory=memory,
                told=told,
            )
    except ReconstructionError as error:
        sys.stderr.write(f"bsface: {error}\n")
        return 1
    except KeyboardInterrupt:
        sys.stderr.write("bsface: interrupted; the same command goes on from here\n")
        return 130
    sys.stdout.write("\n".join(summary_lines(outcomes)) + "\n")
    return int(any(outcome.status == "failed" for outcome in outcomes))


@contextlib.contextmanager
def _client(address: str | None) -> Iterator[Executor | None]:
    if address is None:
        yield None
        return
    try:
        from distributed import Client  # type: ignore[import-not-found]
    except ImportError:
        raise ReconstructionError(
            "--scheduler needs Dask; pip install 'bsface[batch]'."
        ) from None
    try:
        client = Client(address, timeout=10)
    except (OSError, ValueError) as error:
        raise ReconstructionError(
            f"{address}: no Dask scheduler answers there ({error}); start one with "
            "`dask scheduler` and workers with `dask worker ADDRESS`."
        ) from None
    with client:
        yield client.get_executor()
