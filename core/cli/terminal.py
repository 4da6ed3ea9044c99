"""What the commands write to the terminal, and what when it cannot be written."""

from __future__ import annotations

import codecs
import contextlib
import os
import sys
from typing import TextIO

from ..errors import one_line
from ..json_text import to_json


def say(sentence: str) -> None:
    """A sentence on the standard error output."""
    tell(f"bsface: {one_line(sentence)}\n")


def tell(text: str) -> None:
    """Text for people on the standard error output; lost where nobody reads it."""
    stream = sys.stderr
    if stream is None:  # closed when the program began
        return
    try:
        stream.write(text)
        stream.flush()
    except OSError:
        _forget(stream)


def write_out(text: str) -> int:
    """Write the result of a command to the standard output.

    Returns
    -------
    int
        Exit code: 0, or 1 when it cannot be written, which is said. A reader that has
        read enough (``| head``) is no failure.
    """
    if sys.stdout is None:
        say("the standard output is closed.")
        return 1
    try:
        # Characters that the terminal's encoding does not have are written out.
        coding = sys.stdout.encoding or "utf-8"
        sys.stdout.write(text.encode(coding, "backslashreplace").decode(coding))
        sys.stdout.flush()
    except BrokenPipeError:
        _forget(sys.stdout)
    except OSError as error:
        _forget(sys.stdout)
        say(f"the standard output cannot be written ({error.strerror}).")
        return 1
    return 0


def write_json(value: object) -> int:
    """Write a value as JSON to the standard output; returns as `write_out`."""
    coding = getattr(sys.stdout, "encoding", None) or "utf-8"
    utf8 = codecs.lookup(coding).name == "utf-8"
    return write_out(to_json(value, indent=1, ascii=not utf8) + "\n")


def _forget(stream: TextIO) -> None:
    """Keep Python from flushing the rest at its end, which would fail again."""
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
