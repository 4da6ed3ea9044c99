"""Ending early, by Ctrl-C, ``kill`` or a closed terminal: tidily, in one sentence."""

from __future__ import annotations

import _thread
import contextlib
import signal
import sys
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
    thread. Catch the KeyboardInterrupt inside of the block: objects that it left half
    made, such as an archive, fail in their ``__del__``, and only the block keeps Python
    from printing that.
    """
    before = {}
    hook = sys.unraisablehook
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
        sys.unraisablehook = hook


def _interrupt(number: int, frame: object) -> None:
    # Tidying up takes no time; the second kill of an impatient system must not stop
    # it.
    for other in _KILLS:
        signal.signal(other, signal.SIG_IGN)
    sys.unraisablehook = _while_ending
    raise KeyboardInterrupt


def _while_ending(ignored: sys.UnraisableHookArgs) -> None:
    # Raised in a ``__del__``, the interrupt itself is what Python ignored.
    if issubclass(ignored.exc_type, KeyboardInterrupt):
        threading.Timer(0.01, _thread.interrupt_main).start()
