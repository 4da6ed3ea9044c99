"""A log of one run: versions, every step with its time, warnings, and what failed."""

from __future__ import annotations

import contextlib
import logging
import sys
from collections.abc import Iterator
from pathlib import Path

from ..errors import ReconstructionError
from ..files import is_named_pipe
from ..progress import Progress, Step
from .facts import versions


class _Handler(logging.FileHandler):
    """Keeps the reason when a line cannot be written, as on a full disk."""

    failure: BaseException | None = None

    def handleError(self, record: logging.LogRecord) -> None:
        """Instead of a traceback on the terminal for every line."""
        self.failure = self.failure or sys.exc_info()[1]

    def close(self) -> None:
        try:
            super().close()
        except OSError as error:
            self.failure = self.failure or error


# The logger of the whole package, whatever its name (another one inside Blender).
_PACKAGE = logging.getLogger(__name__.rsplit(".", 2)[0])
_FORMAT = "%(asctime)s %(levelname)-7s %(message)s"


@contextlib.contextmanager
def log_file(path: Path | None, about: str) -> Iterator[logging.Logger]:
    """Write what the package logs inside the block to a file.

    Parameters
    ----------
    path : Path or None
        The file, replaced if it is there; None writes nothing.
    about : str
        The first line: what is run.

    Raises
    ------
    ReconstructionError
        When the file cannot be written.
    """
    if path is None:
        yield _PACKAGE
        return
    try:
        if is_named_pipe(path):
            raise OSError("it is no regular file")
        path.parent.mkdir(parents=True, exist_ok=True)
        # Names of files need not be text.
        handler = _Handler(path, "w", encoding="utf-8", errors="backslashreplace")
    except OSError as error:
        raise _unwritten(path, error) from None
    handler.setFormatter(logging.Formatter(_FORMAT))
    level = _PACKAGE.level
    _PACKAGE.addHandler(handler)
    _PACKAGE.setLevel(logging.INFO)
    try:
        _PACKAGE.info("%s", about)
        _PACKAGE.info("%s", ", ".join(f"{k} {v}" for k, v in versions().items()))
        yield _PACKAGE
    except BaseException as error:
        sentence = isinstance(error, ReconstructionError)
        for photo in error.photos if sentence else ():
            _PACKAGE.info("%s: %s", photo.name, photo.reason)
        _PACKAGE.error(
            "%s: %s", type(error).__name__, error, exc_info=None if sentence else error
        )
        raise
    finally:
        _PACKAGE.removeHandler(handler)
        _PACKAGE.setLevel(level)
        handler.close()
    if handler.failure is not None:
        raise _unwritten(path, handler.failure)


def _unwritten(path: Path, error: BaseException) -> ReconstructionError:
    why = getattr(error, "strerror", None) or str(error)
    return ReconstructionError(
        f"{path}: the log cannot be written ({why}); choose another file."
    )


def logged(progress: Progress | None) -> Progress:
    """The same progress, each of its steps also in the log, once."""
    last = ""

    def tell(step: Step) -> None:
        nonlocal last
        line = f"{step.stage} {step.done}/{step.total} {step.message}"
        if line != last:
            _PACKAGE.info("%s", line)
        last = line
        if progress is not None:
            progress(step)

    return tell
