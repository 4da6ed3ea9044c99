"""What a running job tells: one `Step` per piece of work; the time of each stage."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from ._types import Array

STAGES = ("landmarks", "motion", "refine", "output")


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
    control_points : (M, N, 3) array or None
        The face as it is estimated so far, in mm, in the frame and size of results;
        None where this piece of work has not changed it.
    """

    stage: str
    done: int
    total: int
    overall: float
    message: str
    control_points: Array | None = field(default=None, compare=False, repr=False)


Progress = Callable[[Step], None]

# Called now and then inside a long piece of work, without news; may raise `Cancelled`.
CheckCancelled = Callable[[], None]


def never_cancelled() -> None:
    """For a job that nobody can cancel."""


# Share of the whole time at which each stage ends, measured on 40 photos of 400 px.
ENDS = {"landmarks": 0.2, "motion": 0.25, "refine": 0.98, "output": 1.0}


@dataclass
class Clock:
    """Tells the progress of a job and notes what each stage took.

    Parameters
    ----------
    progress : Progress or None
        Whom to tell; may raise `Cancelled`.

    Attributes
    ----------
    seconds : dict of str to float
        Of the stages that are over.
    """

    progress: Progress | None

    def __post_init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.last = time.perf_counter()
        self.newest: Step | None = None

    def lap(self, stage: str) -> None:
        """A stage is over."""
        now = time.perf_counter()
        self.seconds[stage] = now - self.last
        self.last = now

    def nested(self, stage: str) -> Progress | None:
        """A callback for a stage that reports its own fraction."""
        if self.progress is None:
            return None
        tell = self.progress
        return lambda step: tell(replace(step, overall=step.overall * ENDS[stage]))

    def tell(
        self,
        stage: str,
        done: int,
        total: int,
        message: str,
        face: Callable[[], Array] | None = None,
    ) -> None:
        """Report ``done`` of ``total`` pieces of a stage.

        ``face`` makes the control points of the report; it is called where somebody
        listens.
        """
        if self.progress is None:
            return
        names = list(ENDS)
        k = names.index(stage)
        low = ENDS[names[k - 1]] if k else 0.0
        overall = low + (ENDS[stage] - low) * done / max(total, 1)
        known = None if face is None else face()
        self.newest = Step(stage, done, total, overall, message, known)
        self.progress(self.newest)

    def check_cancelled(self) -> None:
        """The newest step again: no news, but a chance to stop."""
        if self.progress is not None and self.newest is not None:
            self.progress(self.newest)
