"""Turned copies of photos: the user's files are never written.

The copies are PNG files (no loss) in the extension's own folder.
"""

from __future__ import annotations

import hashlib
import tempfile
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from .. import __package__ as base_package
from ..core.drawing.pictures import encode_png
from ..core.errors import ReconstructionError
from ..core.files import write_bytes
from ..core.images.read import read_photo


@dataclass(frozen=True)
class PhotoToTurn:
    """A photo and how it shall stand.

    Attributes
    ----------
    name : str
    original : Path
    quarters : int
        Quarter turns of the original clockwise, 0 to 3.
    folder : Path
        Where the copy goes.
    """

    name: str
    original: Path
    quarters: int
    folder: Path


def turn(wanted: PhotoToTurn) -> Path:
    """Make the turned copy; the original itself where it stands upright again."""
    original, quarters = wanted.original, wanted.quarters
    if quarters == 0:
        return original
    photo = read_photo(original)
    if not photo:
        raise ReconstructionError(photo.reason)
    pixels = np.ascontiguousarray(np.rot90(photo.bytes8(), -quarters))
    key = hashlib.sha1(str(original).encode()).hexdigest()[:8]
    name = f"{original.stem}-{key}-{90 * quarters}.png"
    return write_bytes(wanted.folder / name, encode_png(pixels))


def folder() -> Path:
    """Where the copies go; a temporary folder when not run as an extension."""
    try:
        return Path(
            bpy.utils.extension_path_user(base_package, path="turned", create=True)
        )
    except ValueError:
        return Path(bpy.app.tempdir or tempfile.gettempdir()) / "bsface-turned"
