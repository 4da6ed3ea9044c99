"""What a running job tells: one `Step` per piece of work done."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

STAGES = ("photos", "landmarks", "motion", "shading", "refine", "output")


@dataclass(frozen=True)
class Step:
    """One report of progress.

    Parameters
    ----------
    stage : str
        One of `STAGES`.
    done, total : int
        Pieces of work of this stage that are done, and all of them.
    overall : float
        Fraction in [0, 1] of the job that the reporting function does.
    message : str
        One line for people, such as ``"face found in 003.jpg"``.
    """

    stage: str
    done: int
    total: int
    overall: float
    message: str


Progress = Callable[[Step], None]

# Called now and then inside a long piece of work, without news; may raise `Cancelled`.
CheckCancelled = Callable[[], None]


def never_cancelled() -> None:
    """The tick of a job that nobody watches."""
