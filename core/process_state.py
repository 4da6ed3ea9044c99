"""Settings of the whole process, changed while any thread needs them so."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator

Undo = Callable[[], object]


def nothing() -> None:
    """Undo nothing."""


class WhileAnyone:
    """Holds a setting of the process while at least one thread is inside the block.

    ``with setting():``, or ``@setting()`` before a function. Blocks of several threads
    may overlap in any order: the first one changes the setting, and the last one that
    ends brings back what was there before.

    Parameters
    ----------
    change : callable
        Changes the setting and returns what undoes that.
    """

    def __init__(self, change: Callable[[], Undo]) -> None:
        self._change = change
        self._lock = threading.Lock()
        self._inside = 0
        self._undo: Undo = nothing

    @contextlib.contextmanager
    def __call__(self) -> Iterator[None]:
        """Hold the setting inside the block."""
        with self._lock:
            if self._inside == 0:
                self._undo = self._change()
            self._inside += 1
        try:
            yield
        finally:
            with self._lock:
                self._inside -= 1
                if self._inside == 0:
                    undo, self._undo = self._undo, nothing
                    undo()
