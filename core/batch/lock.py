"""One batch at a time in a folder of results."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from ..errors import ReconstructionError

try:
    import fcntl
except ImportError:  # Windows has no locks on folders
    fcntl = None


@contextlib.contextmanager
def only_batch_in(folder: Path) -> Iterator[None]:
    """Within the block no other batch may begin in the folder.

    Two would take each other's unfinished files for the litter of a killed one. The
    system gives the lock back however the process ends. Where there are no
    locks (Windows, some network drives) nothing is held.

    Raises
    ------
    ReconstructionError
        When another batch runs in the folder.
    """
    if fcntl is None or not folder.is_dir():
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ReconstructionError(
                f"{folder}: another batch writes its results there; wait until it has "
                "ended, or choose another folder."
            ) from None
        except OSError:
            pass
        yield
    finally:
        os.close(handle)
