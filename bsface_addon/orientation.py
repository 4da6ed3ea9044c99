"""How the core turns a picture by its EXIF data, which Blender does not do."""

from __future__ import annotations

import math
import os

import cv2
import numpy as np

#: Counter-clockwise turn in radians, a multiple of a quarter turn, and whether left and
#: right are exchanged before it.
Turn = tuple[float, bool]


def orientation(path: str | os.PathLike) -> Turn:
    """The turn of the picture in a file, found by comparing the two ways to read it."""
    small = cv2.IMREAD_REDUCED_COLOR_8
    data = np.fromfile(path, np.uint8)
    stored = cv2.imdecode(data, small | cv2.IMREAD_IGNORE_ORIENTATION)
    shown = cv2.imdecode(data, small)
    if stored is None or shown is None:
        return 0.0, False
    for flip in (False, True):
        start = stored[:, ::-1] if flip else stored
        for quarter in range(4):
            if np.array_equal(np.rot90(start, quarter), shown):
                return quarter * math.pi / 2, flip
    return 0.0, False
