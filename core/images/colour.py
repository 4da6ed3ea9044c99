"""The sRGB transfer curve (IEC 61966-2-1) between linear and stored intensities."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from .._types import Array32


def encode_srgb(linear: npt.ArrayLike) -> Array32:
    """Linear intensities to encoded ones, both in [0, 1]; others are clipped."""
    linear = np.clip(np.asarray(linear, np.float32), 0.0, 1.0)
    return np.where(
        linear <= 0.0031308,
        12.92 * linear,
        1.055 * np.maximum(linear, 0.0031308) ** np.float32(1 / 2.4) - 0.055,
    ).astype(np.float32)


@lru_cache(maxsize=2)
def srgb_table(dtype: str) -> Array32:
    """Linear intensity of each value of an unsigned type, such as ``"<u2"``."""
    top = np.iinfo(np.dtype(dtype)).max
    c = np.arange(top + 1) / top
    low = c / 12.92
    high = ((c + 0.055) / 1.055) ** 2.4
    return np.where(c <= 0.04045, low, high).astype(np.float32)


def to_picture(linear: npt.ArrayLike, depth: int = 8) -> npt.NDArray:
    """Linear intensities as an sRGB picture of 8 or 16 bits a channel."""
    kind = stored_type(depth)
    return np.round(encode_srgb(linear) * np.iinfo(kind).max).astype(kind)


def stored_type(depth: int) -> type[np.uint8] | type[np.uint16]:
    """The type of pictures with 8 or 16 bits a channel."""
    if isinstance(depth, bool) or not isinstance(depth, int | np.integer):
        raise TypeError(f"depth must be 8 or 16 bits, not {type(depth).__name__}.")
    if depth not in (8, 16):
        raise ValueError(f"depth must be 8 or 16 bits, not {depth}.")
    return np.uint8 if depth == 8 else np.uint16
