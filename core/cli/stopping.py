"""Ending early, by Ctrl-C, ``kill`` or a closed terminal: tidily, in one sentence."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator

# Those of them that this system has.
_KILLS = [
    getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)
]


@contextlib.contextmanager
def stoppable() -> Iterator[None]:
    """Within the block SIGTERM and SIGHUP raise KeyboardInterrupt, as Ctrl-C does.

    Unfinished files are then removed on the way out. Signals that somebody else
    handles or ignores (``nohup``) stay as they are, and so do all outside of the main
    thread.
    """
    before = {}
    if threading.current_thread() is threading.main_thread():
        for number in (*_KILLS, signal.SIGINT):
            found = signal.getsignal(number)
            if found in (signal.SIG_DFL, signal.default_int_handler):
                before[number] = found
                signal.signal(number, _interrupt)
    try:
        yield
    finally:
        for number, found in before.items():
            signal.signal(number, found)


def _interrupt(number: int, frame: object) -> None:
    # Tidying up takes no time; the second kill of an impatient system must not stop
    # it.
    for other in _KILLS:
        signal.signal(other, signal.SIG_IGN)
    raise KeyboardInterrupt
