"""The pictures of a folder, in the order in which a person would number them."""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path

from ..errors import ReconstructionError
from .decode import why_not

READABLE_ENDINGS = frozenset(
    [
        ".jpg",
        ".jpeg",
        ".jpe",
        ".jfif",
        ".png",
        ".apng",
        ".webp",
        ".bmp",
        ".dib",
        ".tif",
        ".tiff",
        ".pgm",
        ".ppm",
        ".pnm",
        ".pbm",
    ]
)
# Pictures that people do put into the folder and that we cannot read: they are
# listed so that each gets its sentence.
FOREIGN_ENDINGS = frozenset(
    [
        ".gif",
        ".heic",
        ".heif",
        ".avif",
        ".jxl",
        ".jp2",
        ".cr2",
        ".cr3",
        ".nef",
        ".arw",
        ".dng",
        ".raf",
        ".orf",
        ".rw2",
        ".psd",
    ]
)


def list_photos(folder: str | os.PathLike) -> tuple[Path, ...]:
    """The pictures directly in a folder, in natural order of their names.

    Sub-folders are not entered, hidden files are passed over. A file counts by
    its ending; whether it can be read is `read_photo`'s question.

    Raises
    ------
    ReconstructionError
        If there is no such folder, it is a file, it may not be read, or it
        holds no picture.
    """
    folder = Path(folder)
    try:
        mode = folder.stat().st_mode
    except OSError as error:
        raise ReconstructionError(
            f"{folder}: cannot open this folder ({why_not(error)}); "
            "give the folder that holds the photos."
        ) from None
    except ValueError:
        raise ReconstructionError(
            f"{str(folder)!r} is not a possible folder name; "
            "give the folder that holds the photos."
        ) from None
    if not stat.S_ISDIR(mode):
        raise ReconstructionError(
            f"{folder} is a file, not a folder; give the folder that holds the photos."
        )
    endings = READABLE_ENDINGS | FOREIGN_ENDINGS
    try:
        with os.scandir(folder) as entries:
            names = [
                entry.name
                for entry in entries
                if Path(entry.name).suffix.lower() in endings
                and not entry.name.startswith(".")
                and not _is_folder(entry)
            ]
    except OSError as error:
        raise ReconstructionError(
            f"{folder}: the folder cannot be read ({why_not(error)}); "
            "check its permissions."
        ) from None
    if not names:
        raise ReconstructionError(
            f"{folder} holds no photos; put JPEG, PNG, TIFF, WebP or BMP "
            "pictures of one person into it."
        )
    return tuple(folder / name for name in sorted(names, key=natural_key))


def natural_key(name: str) -> tuple:
    """Sort key by which ``2.jpg`` comes before ``10.jpg``, whatever the case."""
    parts = re.split(r"(\d+)", name.casefold())
    # Text and numbers alternate, so equal positions always compare like kinds.
    return tuple(int(p) if p.isdecimal() else p for p in parts), name


def _is_folder(entry: os.DirEntry) -> bool:
    try:
        return entry.is_dir()
    except OSError:
        return False
