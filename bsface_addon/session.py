"""What lives from enabling the add-on to disabling it, and is in no file.

One object, made by `register`: the solver, the job that runs, its timer and what is
drawn of it. A file can so never come up with a locked panel.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from ..core.errors import Cancelled
from .estimate_overlay import Overlay
from .job import Job
from .solving import Solver

if TYPE_CHECKING:
    import bpy

    from ..core.progress import Progress


class Session:
    """The add-on's running state.

    Attributes
    ----------
    solver : Solver
        Does the core's work of all operators.
    job : Job or None
        The one job that runs.
    timer : bpy.types.Timer or None
        Of that job; here and not on its operator, because Blender drops the operator
        without a word when the add-on is disabled.
    overlay : Overlay
        Draws the face as that job has it so far.
    """

    def __init__(self, solver: Solver | None = None) -> None:
        self.solver = solver or Solver()
        self.job: Job | None = None
        self.timer: bpy.types.Timer | None = None
        self.overlay = Overlay()

    def start(self, work: Callable[[Progress], object]) -> Job:
        """Start the job; there must be none."""
        if self.job is not None:
            raise RuntimeError("a job is running already")
        self.job = Job(work, Cancelled)
        return self.job

    def stop(self) -> None:
        """Forget the job; stops it where it still works."""
        if self.job is not None:
            self.job.cancel()
            self.job = None


_session = Session()


def current() -> Session:
    """The session."""
    return _session


def running() -> Job | None:
    """The job that runs, or None."""
    return _session.job


def register() -> None:
    """Begin a session."""
    global _session
    _session = Session()


def unregister() -> None:
    """End the session's job; the rest is the caller's (`operators.running.end`)."""
    _session.stop()
