"""Writing a file so that a reader never sees half of it.

Every writer of this package writes to a temporary name in the target's own
folder (a rename is atomic only inside one file system) and moves the finished
file into place.
"""

from __future__ import annotations

import contextlib
import os
import secrets
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
    # The name is known before the file is there, so that an interruption at any moment
    # finds what to remove.
    word = f".{target.stem[:40]}-{secrets.token_hex(4)}{target.suffix}"
    temporary = target.with_name(word)
    try:
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            temporary.open("xb").close()
        except OSError as error:
            raise ReconstructionError(
                f"{target}: cannot be written ({error.strerror}); choose another "
                "folder."
            ) from error
        yield temporary
        os.replace(temporary, target)
    except OSError as error:
        _remove(temporary)
        raise ReconstructionError(
            f"{target}: cannot be written ({error.strerror or error}); "
            "check the free space and the permissions of its folder."
        ) from error
    except BaseException:
        _remove(temporary)
        raise


def _remove(path: Path) -> None:
    with contextlib.suppress(OSError):
        path.unlink()


def why_not_writable(path: Path) -> str:
    """Why no file can be written there, as the end of a sentence; "" if it may do."""
    try:
        if path.is_dir():
            return "is a folder; give the name of a file in it"
        folder = path.absolute().parent
        while not folder.exists() and folder != folder.parent:
            folder = folder.parent
        if not folder.is_dir():
            return f"cannot be written ({folder} is a file); choose another folder"
    except OSError as error:
        return f"cannot be written ({error.strerror}); choose another name"
    if not os.access(folder, os.W_OK, effective_ids=_EFFECTIVE):
        return f"cannot be written (no permission in {folder}); choose another folder"
    return ""


def write_bytes(path: str | os.PathLike, content: bytes) -> Path:
    """Write ``content`` to ``path`` in one step; see :func:`replacing`."""
    with replacing(path) as temporary:
        temporary.write_bytes(content)
    return Path(path)


def write_text(path: str | os.PathLike, content: str) -> Path:
    """Write ``content`` as UTF-8 with ``\\n`` line ends; see :func:`replacing`."""
    return write_bytes(path, content.encode("utf-8"))
