"""Bilinear reading of a picture between its pixels, the same in all OpenCV versions.

OpenCV 4 rounds places to 1/32 pixel, OpenCV 5 does not. Places that are rounded before
give both the same numbers: products of eight-bit values and multiples of 1/1024 are
exact in single precision.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.float32]

_STEPS = 32
# What cv2.remap takes at a time.
_CHANNELS, _COLUMNS = 4, 1024


def read_between(
    picture: Picture, xy: NDArray, border: int = cv2.BORDER_REPLICATE
) -> Picture:
    """Values at places of a picture.

    Parameters
    ----------
    picture : (h, w) or (h, w, c) float32 array
    xy : (..., 2) array
        Pixels, centres at integers; rounded to 1/32.
    border : int
        ``cv2.BORDER_REPLICATE``, or ``cv2.BORDER_CONSTANT`` for zeros outside.

    Returns
    -------
    (...) or (..., c) float32 array
    """
    places = np.asarray(xy).reshape(-1, 2)
    rows = max(-(-len(places) // _COLUMNS), 1)
    x, y = np.zeros((2, rows * _COLUMNS), np.float32)
    x[: len(places)], y[: len(places)] = np.rint(places.T * _STEPS) / _STEPS
    x, y = x.reshape(rows, _COLUMNS), y.reshape(rows, _COLUMNS)
    channels = picture[..., None] if picture.ndim == 2 else picture
    parts = [
        cv2.remap(
            np.ascontiguousarray(channels[..., k : k + _CHANNELS]),
            x,
            y,
            cv2.INTER_LINEAR,
            borderMode=border,
        ).reshape(rows * _COLUMNS, -1)
        for k in range(0, channels.shape[2], _CHANNELS)
    ]
    values = np.concatenate(parts, 1)[: len(places)].astype(np.float32, copy=False)
    return values.reshape(*np.shape(xy)[:-1], *picture.shape[2:])
