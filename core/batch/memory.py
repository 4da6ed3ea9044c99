"""A limit on the memory of each worker of a batch.

Linux counts what a process has asked for against ``RLIMIT_DATA``; a request beyond it
fails inside the process, which can say so, instead of the system ending some process
when the machine is full. Other systems have no limit that holds, so there none is
promised.
"""

from __future__ import annotations

import re
import sys

from ..errors import out_of_memory
from ..threads import take_working_space

#: Bytes below which not even the program and its networks fit.
LEAST = 350_000_000
_UNITS = {"": 1, "K": 10**3, "M": 10**6, "G": 10**9, "T": 10**12}


def parse_memory(text: str) -> int:
    """Bytes of a size such as ``2G``, ``1.5 GB`` or ``800M`` (powers of ten).

    Raises
    ------
    ValueError
        With a sentence, if it is no such size.
    """
    found = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*([KMGT]?)B?\s*", text, re.IGNORECASE)
    if found is None:
        raise ValueError(f"--memory {text!r} is no size; give for example 2G or 800M.")
    size = float(found[1]) * _UNITS[found[2].upper()]
    if size > sys.maxsize:
        raise ValueError(f"--memory {text:.20} is more than any machine has.")
    return round(size)


def check_memory(limit: int | None) -> None:
    """Raise a ValueError for a limit, in bytes, that cannot be held."""
    if limit is None:
        return
    if not sys.platform.startswith("linux"):
        raise ValueError(
            "The memory of a worker can be limited on Linux only; leave the limit out "
            "and use fewer workers."
        )
    if limit < LEAST:
        raise ValueError(
            f"A limit of {limit / 1e6:.0f} MB is too low for any face; give at least "
            f"{LEAST / 1e6:.0f} MB."
        )


def limit_memory(limit: int | None) -> None:
    """Hold this process to ``limit`` bytes from now on; None leaves it as it is."""
    if limit is None:
        return
    import resource  # not there on Windows

    take_working_space()
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    if hard != resource.RLIM_INFINITY:
        limit = min(limit, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (limit, hard))


def held_to() -> int | None:
    """The limit of this process in bytes, None if it has none."""
    if not sys.platform.startswith("linux"):
        return None
    import resource

    soft, _ = resource.getrlimit(resource.RLIMIT_DATA)
    return None if soft == resource.RLIM_INFINITY else soft


def for_want_of_memory(error: BaseException | None) -> bool:
    """Whether an error, or the one that it replaced, is that memory ran out."""
    if error is None:
        return False
    return out_of_memory(error) or for_want_of_memory(error.__context__)


def too_little(folder: str, limit: int | None) -> str:
    """The sentence for a person whose memory ran out."""
    if limit is None:
        return f"{folder}: not enough memory; use fewer workers or smaller photos."
    return (
        f"{folder}: needs more than the {limit / 1e9:.3g} GB that a worker may have; "
        "raise the limit (--memory) or use fewer or smaller photos."
    )


def ended_abruptly(folder: str, limit: int | None) -> str:
    """The sentence for a person whose process died without a word."""
    remedy = "use fewer workers" if limit is None else "raise the limit (--memory)"
    return (
        f"{folder}: the process ended abruptly, most likely for lack of memory; "
        f"{remedy} or use smaller photos."
    )
