"""``python -m bsface batch``: one face from each sub-folder of photos.

python -m bsface batch PEOPLE OUT [--workers 2] [--memory 2G]
                                  [--scheduler tcp://host:8786]
                                  [--set NAME=VALUE ...] [--write FILE ...] [--json]
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor

from ..batch.memory import parse_memory
from ..batch.record import Outcome, batch_facts, summary_lines
from ..batch.run import WANTED, run_batch
from ..errors import ReconstructionError, one_line
from ..report.facts import failure_facts
from .arguments import Parser, parse_settings
from .terminal import say, tell, write_json, write_out


def parser() -> Parser:
    """The command line of ``python -m bsface batch``."""
    p = Parser(
        prog="bsface batch", description="One face from each sub-folder of photos."
    )
    p.add_argument("people", help="folder with one sub-folder of photos per person")
    p.add_argument("out", help="folder for the results")
    p.add_argument("--workers", type=int, default=2, help="processes here, default 2")
    p.add_argument(
        "--memory", metavar="SIZE", help="most memory per worker, such as 2G (Linux)"
    )
    p.add_argument("--scheduler", metavar="ADDRESS", help="a Dask scheduler instead")
    p.add_argument(
        "--write",
        action="append",
        metavar="FILE",
        help="file per person, such as face.step or texture.png; may be given again "
        f"(default {', '.join(WANTED)})",
    )
    p.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a setting, the same for all people",
    )
    p.add_argument("--json", action="store_true", help="print the table as JSON")
    return p


def main(argv: Sequence[str], executor: Executor | None = None) -> int:
    """Run a batch from the command line.

    Parameters
    ----------
    argv : sequence of str
    executor : Executor, optional
        Where to compute, unless ``--scheduler`` is given; by default processes here.

    Returns
    -------
    int
        0 all done, 1 some failed or the batch could not run, 2 the call is wrong,
        130 interrupted.
    """
    options = parser().parse_args(argv)

    def told(outcome: Outcome, finished: int, total: int) -> None:
        person = one_line(outcome.person)
        tell(f"[{finished}/{total}] {person}: {outcome.status}\n")

    try:
        settings = parse_settings(options.set)
        memory = None if options.memory is None else parse_memory(options.memory)
        with _executor(options.scheduler, executor) as chosen:
            outcomes = run_batch(
                options.people,
                options.out,
                settings,
                wanted=options.write or WANTED,
                workers=options.workers,
                executor=chosen,
                memory=memory,
                told=told,
            )
    except ValueError as error:
        say(str(error))
        return 2
    except ReconstructionError as error:
        say(str(error))
        if options.json:
            write_json(failure_facts(str(error)))
        return 1
    except KeyboardInterrupt:
        say("interrupted; the same command goes on from here")
        return 130
    if options.json:
        code = write_json(batch_facts(outcomes))
    else:
        code = write_out("\n".join(summary_lines(outcomes)) + "\n")
    return code or int(any(outcome.status == "failed" for outcome in outcomes))


@contextlib.contextmanager
def _executor(address: str | None, given: Executor | None) -> Iterator[Executor | None]:
    """The executor of the Dask scheduler at an address, else the given one."""
    if address is None:
        yield given
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
