"""How the core turns a picture by its EXIF data, which Blender does not do."""

from __future__ import annotations

import math
import os

import cv2
import numpy as np

from ..core.images.decode import quiet
from ..core.images.png import plain_png

#: Counter-clockwise turn in radians, a multiple of a quarter turn, and whether left and
#: right are exchanged before it.
Turn = tuple[float, bool]


def orientation(path: str | os.PathLike) -> Turn:
    """The turn of the picture in a file, found by comparing the two ways to read it.

    None of it for a file that has gone, or is no picture that OpenCV reads.
    """
    small = cv2.IMREAD_REDUCED_COLOR_8
    try:
        data = np.fromfile(path, np.uint8)
        png = data[:4].tobytes() == b"\x89PNG"
        whole = plain_png(data) if png else data
        if whole is None:
            return 0.0, False
        with quiet():
            stored = cv2.imdecode(whole, small | cv2.IMREAD_IGNORE_ORIENTATION)
            shown = cv2.imdecode(whole, small)
    except (OSError, cv2.error):
        return 0.0, False
    if stored is None or shown is None:
        return 0.0, False
    for flip in (False, True):
        start = stored[:, ::-1] if flip else stored
        for quarter in range(4):
            if np.array_equal(np.rot90(start, quarter), shown):
                return quarter * math.pi / 2, flip
    return 0.0, False
