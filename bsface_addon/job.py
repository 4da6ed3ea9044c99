"""A long piece of core work beside Blender's user interface.

The worker thread runs core code only: it holds no bpy object and not the operator
(a bpy call from a thread during a redraw crashes Blender).  What it has to tell
goes through a queue; the main thread empties it on a timer.
"""

from __future__ import annotations

import queue
import threading
import time
import traceback
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..core._types import Array
    from ..core.progress import Progress, Step


class Job:
    """``work(progress)`` in a thread; the main thread calls `poll`.

    Parameters
    ----------
    work : callable
        Takes the core's progress callback; must not touch bpy.
    cancelled : type
        The exception by which the callback stops the work (core.errors.Cancelled).

    Attributes
    ----------
    step : Step or None
        The newest report of the core.
    control_points : array or None
        The newest that came with a report.
    result, error : object
        Set when `finished`: exactly one of them unless the job was cancelled.
    trace : str
        The error's traceback, for the copyable error block.
    """

    def __init__(
        self, work: Callable[[Progress], object], cancelled: type[Exception]
    ) -> None:
        self.step: Step | None = None
        self.control_points: Array | None = None
        self.result: object = None
        self.error: BaseException | None = None
        self.trace = ""
        self.finished = False
        self.started = time.monotonic()
        self._news = queue.SimpleQueue()
        self._stop = threading.Event()
        self._thread = threading.Thread(
            target=_run,
            args=(work, self._news, self._stop, cancelled),
            name="bsface",
            daemon=True,
        )
        self._thread.start()

    def poll(self) -> bool:
        """Take what the worker sent; whether there was news."""
        news = False
        while True:
            try:
                kind, value = self._news.get_nowait()
            except queue.Empty:
                return news
            news = True
            if kind == "step":
                self.step = value
                if value.control_points is not None:
                    self.control_points = value.control_points
            else:
                self.finished = True
                if kind == "result":
                    self.result = value
                elif kind == "error":
                    self.error, self.trace = value

    def cancel(self) -> None:
        """Ask the worker to stop; returns at once, its result is dropped."""
        self._stop.set()

    @property
    def cancelled(self) -> bool:
        return self._stop.is_set()

    def wait(self, seconds: float) -> bool:
        """Wait for the worker to end (tests and quitting only)."""
        self._thread.join(seconds)
        return not self._thread.is_alive()

    @property
    def fraction(self) -> float:
        """Done part in [0, 1]."""
        return 0.0 if self.step is None else min(max(self.step.overall, 0.0), 1.0)

    def remaining(self) -> float | None:
        """Seconds left by the pace so far; None while that would be a guess."""
        passed = time.monotonic() - self.started
        if self.fraction < 0.05 or passed < 2.0:
            return None
        return passed * (1.0 - self.fraction) / self.fraction


def _run(work, news, stop, cancelled):
    def progress(step):
        if stop.is_set():
            raise cancelled()
        news.put(("step", step))

    try:
        news.put(("result", work(progress)))
    except cancelled:
        news.put(("cancelled", None))
    except BaseException as error:
        news.put(("error", (error, traceback.format_exc())))
