"""Writing a file so that a reader never sees half of it.

Every writer of this package writes to a temporary name in the target's own
folder (a rename is atomic only inside one file system) and moves the finished
file into place.
"""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from .errors import ReconstructionError

# Ask for the rights that writing will have, where the system can be asked.
_EFFECTIVE = os.access in os.supports_effective_ids


@contextlib.contextmanager
def replacing(path: str | os.PathLike) -> Iterator[Path]:
    """Give a temporary name beside ``path``; move it to ``path`` on success.

    Parameters
    ----------
    path : path-like
        Where the finished file is to stand. Its folder is made when missing.

    Yields
    ------
    Path
        A name in the same folder with the same ending. On an exception inside
        the block the temporary file is removed and ``path`` stays as it was.

    Raises
    ------
    ReconstructionError
        When the folder or the file cannot be written.
    """
    target = Path(path)
    why = why_not_writable(target)
    if why:
        raise ReconstructionError(f"{target}: {why}.")
    # Through a link: what it leads to is replaced, the link stays.
    place = Path(os.path.realpath(target))
    # The name is known before the file is there, so that an interruption at any moment
    # finds what to remove.
    word = f".{place.stem[:40]}-{secrets.token_hex(4)}{place.suffix}"
    temporary = place.with_name(word)
    try:
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
            temporary.open("xb").close()
        except OSError as error:
            raise ReconstructionError(
                f"{target}: cannot be written ({error.strerror}); choose another "
                "folder."
            ) from error
        yield temporary
        # Who may read the old file may read the new one, and nobody else.
        with contextlib.suppress(FileNotFoundError):
            shutil.copymode(place, temporary)
        os.replace(temporary, place)
    except OSError as error:
        _remove(temporary)
        raise ReconstructionError(
            f"{target}: cannot be written ({error.strerror or error}); "
            "check the free space and the permissions of its folder."
        ) from error
    except BaseException:
        _remove(temporary)
        raise


@contextlib.contextmanager
def temporary_folder() -> Iterator[Path]:
    """A new folder in the system's place for temporary files, removed after the block.

    Raises
    ------
    ReconstructionError
        The system has no such place that can be written.
    """
    try:
        folder = tempfile.TemporaryDirectory(prefix="bsface-")
    except OSError as error:
        raise ReconstructionError(
            f"No temporary file can be written ({error.strerror}); set TMPDIR to a "
            "folder with free space."
        ) from None
    with folder as name:
        yield Path(name)


def _remove(path: Path) -> None:
    with contextlib.suppress(OSError):
        path.unlink()


def is_temporary(name: str) -> bool:
    """Whether a file is one that `replacing` has not finished, by its name."""
    return re.fullmatch(r"\..{0,40}-[0-9a-f]{8}(\.[^.]*)?", name, re.DOTALL) is not None


def why_not_writable(path: Path) -> str:
    """Why no file can be written there, as the end of a sentence; "" if it may do."""
    try:
        path = Path(os.path.realpath(path))
        if path.is_symlink():
            return "is a link in a circle; choose another name"
        if path.is_dir():
            return "is a folder; give the name of a file in it"
        if path.exists():
            if not path.is_file():
                return "is no regular file; choose another name"
            # A rename asks for no right on the file itself.
            if not os.access(path, os.W_OK, effective_ids=_EFFECTIVE):
                return "is write-protected; choose another name"
        folder = path.parent
        while not os.path.lexists(folder) and folder != folder.parent:
            folder = folder.parent
        if not folder.is_dir():
            kind = "a file" if folder.exists() else "a link in a circle"
            return f"cannot be written ({folder} is {kind}); choose another folder"
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or str(error)
        return f"cannot be written ({why}); choose another name"
    if not os.access(folder, os.W_OK, effective_ids=_EFFECTIVE):
        return f"cannot be written (no permission in {folder}); choose another folder"
    return ""


def file_beside(path: str | os.PathLike, ending: str) -> Path | None:
    """The file with the same name and this ending, also in capitals, or None."""
    wanted = Path(path).with_suffix(ending)
    # Whatever it is: a link that leads nowhere is said, and not passed over.
    if os.path.lexists(wanted):
        return wanted
    stem = Path(path).stem
    with contextlib.suppress(OSError):
        found = [
            name
            for name in os.listdir(wanted.parent)
            if name[: -len(ending)] == stem and name.lower().endswith(ending)
        ]
        return wanted.with_name(min(found)) if found else None
    return None


def is_named_pipe(path: str | os.PathLike) -> bool:
    """Whether a file is a named pipe, which waits for a reader when it is opened.

    The streams of this process are none, such as ``/dev/stderr`` in a pipeline.
    """
    if os.path.abspath(path).startswith("/dev/"):
        return False
    # On Linux the place of a stream under /proc has no file behind it.
    return Path(os.path.realpath(path)).is_fifo()


def write_bytes(path: str | os.PathLike, content: bytes) -> Path:
    """Write ``content`` to ``path`` in one step; see :func:`replacing`."""
    with replacing(path) as temporary:
        temporary.write_bytes(content)
    return Path(path)


def write_text(path: str | os.PathLike, content: str) -> Path:
    """Write ``content`` as UTF-8 with ``\\n`` line ends; see :func:`replacing`.

    What no UTF-8 can hold, from names of files that are no text, is written out.
    """
    return write_bytes(path, content.encode("utf-8", "backslashreplace"))
