"""A photo: turned RGB pixels with a place in the original, and its cut-outs.

A photo is read once, in a size that is enough for its face, turned as its EXIF
tag says, and soon cut down to the face (`cut`), so that forty pictures of
twelve megapixels stay small in memory. Pixel coordinates always mean the turned
original: x right, y down, pixel centres at integers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from .._types import Array, Array32, Picture, Picture8
from .colour import srgb_table

#: ``x0, y0, scale`` of a part of a picture:
#: ``original_xy = (x0, y0) + (part_xy + 0.5) / scale - 0.5``.
Window = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Photo:
    """A picture, or the part of it that matters, as encoded.

    Parameters
    ----------
    name : str
        File name relative to the folder, or a given name.
    path : pathlib.Path or None
        None for a picture that came as an array.
    size : (int, int)
        Width and height of the whole turned original, in pixels.
    pixels : (h, w, 3) uint8 or uint16 array
        RGB, sRGB-encoded.
    window : Window
        Of `pixels` in the original.
    note : str
        What the reader should know about how it was read, in one sentence; or empty.
    mask : (h', w') float32 array or None
        Of the whole original, from a mask file: 1 = skin, 0 = not, 0.5 = unknown.
    focal_px : float or None
        Focal length in pixels of the original; None if the file does not name it.
    """

    name: str
    path: Path | None
    size: tuple[int, int]
    pixels: Picture
    window: Window = (0.0, 0.0, 1.0)
    note: str = ""
    mask: Array32 | None = None
    focal_px: float | None = None

    def linear(self) -> Array32:
        """(h, w, 3) float32 linear intensity in [0, 1], the sRGB curve undone."""
        return srgb_table(self.pixels.dtype.str)[self.pixels]

    def to_window(self, xy: Array) -> Array:
        """Pixels of the original -> pixels of `pixels`, (..., 2)."""
        return pixels_in(self.window, xy)

    def to_original(self, xy: Array) -> Array:
        """Pixels of `pixels` -> pixels of the original, (..., 2)."""
        return pixels_of(self.window, xy)

    def bytes8(self) -> Picture8:
        """(h, w, 3) uint8 RGB, what a detector or a page wants."""
        if self.pixels.dtype == np.uint8:
            return self.pixels.astype(np.uint8, copy=False)
        return ((self.pixels.astype(np.uint32) + 128) // 257).astype(np.uint8)


def pixels_in(window: Window, xy: Array) -> Array:
    """Pixels of the original -> pixels of a part of it, (..., 2)."""
    x0, y0, scale = window
    return (np.asarray(xy, float) - (x0, y0) + 0.5) * scale - 0.5


def pixels_of(window: Window, xy: Array) -> Array:
    """Pixels of a part -> pixels of the original, (..., 2)."""
    x0, y0, scale = window
    return (np.asarray(xy, float) + 0.5) / scale - 0.5 + (x0, y0)


def cut(
    photo: Photo,
    box: tuple[float, float, float, float] | Array,
    max_side: int = 1024,
) -> Photo:
    """The part of a photo inside a box, made smaller if it is larger than needed.

    Parameters
    ----------
    photo : Photo
        Whole or already cut.
    box : (x0, y0, x1, y1)
        In pixels of the original; clipped to what `photo` holds.
    max_side : int
        Longest side of the result in pixels; it is never enlarged.
    """
    h, w = photo.pixels.shape[:2]
    corners = photo.to_window(np.reshape(np.asarray(box, float), (2, 2)))
    low = np.clip(np.floor(corners[0]), 0, (w - 1, h - 1)).astype(int)
    high = np.clip(np.ceil(corners[1]) + 1, low + 1, (w, h)).astype(int)
    x0, y0, scale = photo.window
    window = (x0 + low[0] / scale, y0 + low[1] / scale, scale)
    part: np.ndarray = photo.pixels[low[1] : high[1], low[0] : high[0]]
    found = reduced(replace(photo, pixels=part, window=window), max_side)
    # A view would keep the whole picture in memory.
    return replace(found, pixels=found.pixels.copy())


def reduced(photo: Photo, max_side: int) -> Photo:
    """The photo with at most so many pixels on its longer side; never enlarged."""
    part: np.ndarray = photo.pixels
    # Not so small that a strip at the picture's edge vanishes.
    factor = max(max_side / max(part.shape[:2]), 1 / min(part.shape[:2]))
    if factor >= 1:
        return photo
    # With dsize empty, cv2 uses exactly this factor on both axes; with a size it would
    # round the factor to the size, per axis.
    part = cv2.resize(part, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    part = part[:max_side, :max_side]
    x0, y0, scale = photo.window
    return replace(photo, pixels=part, window=(x0, y0, float(scale * factor)))
