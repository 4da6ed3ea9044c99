"""Bilinear reading of a picture between its pixels, the same in all OpenCV versions.

`interpolate` reads at a place exactly.  Whatever measures the face needs that: values
that change in steps with the place keep the Gauss-Newton steps from converging, and
turn differences in the last digits of a place into hundredths of a millimetre.

`read_between` is for many pixels, such as the input of a network.  OpenCV 4 rounds
places to 1/32 pixel, OpenCV 5 does not. Places that are rounded before give both the
same numbers: products of eight-bit values and multiples of 1/1024 are exact in single
precision.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from .._types import Array

Picture = NDArray[np.float32]

_STEPS = 32
# What cv2.remap takes at a time.
_CHANNELS, _COLUMNS = 4, 1024


def interpolate(picture: Picture, xy: Array) -> Array:
    """Values at places of a picture, in double precision.

    Parameters
    ----------
    picture : (h, w) or (h, w, c) float32 array
    xy : (..., 2) array
        Pixels, centres at integers; outside the picture its rim is read.

    Returns
    -------
    (...) or (..., c) array
    """
    rows_columns = np.asarray(xy, float).reshape(-1, 2).T[::-1]
    channels = picture.reshape(*picture.shape[:2], -1)
    values = np.empty((rows_columns.shape[1], channels.shape[2]))
    for k in range(channels.shape[2]):
        values[:, k] = map_coordinates(
            channels[..., k], rows_columns, output=float, order=1, mode="nearest"
        )
    return values.reshape(*np.shape(xy)[:-1], *picture.shape[2:])


def read_between(picture: Picture, xy: Array) -> Picture:
    """Values at places of a picture, rounded to 1/32 pixel.

    Parameters
    ----------
    picture : (h, w) or (h, w, c) float32 array
    xy : (..., 2) array
        Pixels, centres at integers; outside the picture there is zero.

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
            borderMode=cv2.BORDER_CONSTANT,
        ).reshape(rows * _COLUMNS, -1)
        for k in range(0, channels.shape[2], _CHANNELS)
    ]
    values = np.concatenate(parts, 1)[: len(places)].astype(np.float32, copy=False)
    return values.reshape(*np.shape(xy)[:-1], *picture.shape[2:])
