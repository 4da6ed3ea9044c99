"""What the commands write to the terminal, and what when it cannot be written."""

from __future__ import annotations

import contextlib
import os
import sys

from ..errors import one_line


def say(sentence: str) -> None:
    """A sentence on the standard error output."""
    with contextlib.suppress(OSError):
        sys.stderr.write(f"bsface: {one_line(sentence)}\n")


def write_out(text: str) -> int:
    """Write the result of a command to the standard output.

    Returns
    -------
    int
        Exit code: 0, or 1 when it cannot be written, which is said. A reader that has
        read enough (``| head``) is no failure.
    """
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except BrokenPipeError:
        _forget_output()
    except OSError as error:
        _forget_output()
        say(f"the standard output cannot be written ({error.strerror}).")
        return 1
    return 0


def _forget_output() -> None:
    """Keep Python from flushing the rest at its end, which would fail again."""
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
