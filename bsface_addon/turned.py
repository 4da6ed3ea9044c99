"""Turned copies of photos: the user's files are never written.

The copies are PNG files (no loss) in the extension's own folder.
"""

from __future__ import annotations

import hashlib
import tempfile
from pathlib import Path

import bpy

from .. import __package__ as base_package
from ..core.errors import ReconstructionError
from . import photo_list


def turn(row, quarters):
    """Make the turned copy of a row's photo.

    Parameters
    ----------
    quarters : int
        Quarter turns clockwise, added to those that the row has.

    Returns
    -------
    path : pathlib.Path
        The copy, or the original where it stands upright again.
    quarters : int
        0 to 3, all turns of the original together.
    """
    import numpy as np

    from ..core.drawing.pictures import encode_png
    from ..core.files import write_bytes
    from ..core.images.read import read_photo

    original = Path(bpy.path.abspath(row.original)) if row.original else None
    original = original or photo_list.absolute(row)
    total = (row.quarters + quarters) % 4
    if total == 0:
        return original, 0
    photo = read_photo(original)
    if not photo:
        raise ReconstructionError(photo.reason)
    pixels = np.ascontiguousarray(np.rot90(photo.bytes8(), -total))
    key = hashlib.sha1(str(original).encode()).hexdigest()[:8]
    target = folder() / f"{original.stem}-{key}-{90 * total}.png"
    return write_bytes(target, encode_png(pixels)), total


def folder():
    """Where the copies go; a temporary folder when not run as an extension."""
    try:
        return Path(
            bpy.utils.extension_path_user(base_package, path="turned", create=True)
        )
    except ValueError:
        return Path(bpy.app.tempdir or tempfile.gettempdir()) / "bsface-turned"
