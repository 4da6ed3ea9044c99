"""Pixels of another colour space to sRGB, with 16 bits so that no step is lost."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from .._types import Picture
from .colour import encode_srgb
from .icc import RgbProfile

# Rows are converted in pieces of so many pixels, which keeps the floats small.
_PIECE = 1_000_000
# A profile that moves no colour by more than a step of 8 bits is sRGB by another name:
# the sRGB profiles in use differ from each other by up to 0.64 steps.
_STEP = 1 / 255


def is_srgb(profile: RgbProfile) -> bool:
    """Whether a profile gives sRGB to a step of 8 bits."""
    steps = np.linspace(0, 1, 6)
    cube = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
    grey = np.repeat(np.linspace(0, 1, 256)[:, None], 3, axis=1)
    stored = np.concatenate([cube, grey])
    moved = np.abs(encode_srgb(profile.linear_srgb(stored)) - stored)
    return bool(moved.max() <= _STEP)


def to_srgb(pixels: Picture, profile: RgbProfile) -> Picture:
    """sRGB pixels of a picture in the colour space of a profile.

    Colours that sRGB has not are brought to its edge, per channel.

    Parameters
    ----------
    pixels : (h, w, 3) uint8 or uint16 array
    profile : RgbProfile

    Returns
    -------
    (h, w, 3) uint16 array
        The pixels themselves if the profile `is_srgb`.
    """
    if is_srgb(profile):
        return pixels
    full = np.iinfo(pixels.dtype).max
    stored = np.linspace(0, 1, full + 1)
    tables = [curve(stored).astype(np.float32) for curve in profile.curves]
    matrix = profile.matrix.astype(np.float32)
    encoded = _encoded()
    result = np.empty(pixels.shape, np.uint16)
    rows = max(_PIECE // pixels.shape[1], 1)
    for start in range(0, len(pixels), rows):
        piece = pixels[start : start + rows]
        linear = np.empty(piece.shape, np.float32)
        for channel, table in enumerate(tables):
            linear[..., channel] = table[piece[..., channel]]
        linear = np.clip(cv2.transform(linear, matrix), 0, 1)
        result[start : start + rows] = encoded[
            np.round(linear * np.float32(65535)).astype(np.uint16)
        ]
    return result


@lru_cache(maxsize=1)
def _encoded() -> Picture:
    """sRGB values of 16 bits for linear ones of 16 bits.

    Near black, where the curve is steepest, one linear step is 13 of the stored
    65535: a twentieth of a step of 8 bits.
    """
    linear = np.arange(65536, dtype=np.float32) / np.float32(65535)
    return np.round(encode_srgb(linear) * 65535).astype(np.uint16)
