"""Photos: from a folder or arrays to turned RGB pixels with a place.

A photo is read once, in a size that is enough for its face, turned as its EXIF
tag says, and soon cut down to the face (`cut`), so that forty pictures of
twelve megapixels stay small in memory. Pixel coordinates always mean the turned
original: x right, y down, pixel centres at integers.

The header is judged before anything is decoded (`image_header`): that is what
keeps a decompression bomb out.
"""

from __future__ import annotations

import os
import re
import stat
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from ..errors import PhotoFailure, ReconstructionError
from .decode import (
    MAX_PIXELS,
    MIN_SIDE,
    decode,
    file_bytes,
    judge_header,
    why_not,
)
from .header import read_header
from .png import plain_png

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
# listed so that each gets its sentence instead of being passed over silently.
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

# Above this many pixels the picture is decoded at half, a quarter or an eighth
# of its size: a face that fills a sixth of 16 megapixels still has 650 pixels.
FULL_SIZE_PIXELS = 16_000_000


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
    window : (float, float, float)
        ``x0, y0, scale`` of `pixels` in the original:
        ``original_xy = (x0, y0) + (pixel_xy + 0.5) / scale - 0.5``.
    """

    name: str
    path: Path | None
    size: tuple[int, int]
    pixels: np.ndarray
    window: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def linear(self) -> np.ndarray:
        """(h, w, 3) float32 linear intensity in [0, 1], the sRGB curve undone."""
        return _srgb_table(self.pixels.dtype.str)[self.pixels]

    def to_window(self, xy: np.ndarray) -> np.ndarray:
        """Pixels of the original -> pixels of `pixels`, (..., 2)."""
        x0, y0, scale = self.window
        return (np.asarray(xy, float) - (x0, y0) + 0.5) * scale - 0.5

    def to_original(self, xy: np.ndarray) -> np.ndarray:
        """Pixels of `pixels` -> pixels of the original, (..., 2)."""
        x0, y0, scale = self.window
        return (np.asarray(xy, float) + 0.5) / scale - 0.5 + (x0, y0)

    def bytes8(self) -> np.ndarray:
        """(h, w, 3) uint8 RGB, what a detector or a page wants."""
        if self.pixels.dtype == np.uint8:
            return self.pixels
        return ((self.pixels.astype(np.uint32) + 128) // 257).astype(np.uint8)


@lru_cache(maxsize=2)
def _srgb_table(dtype: str) -> np.ndarray:
    top = np.iinfo(np.dtype(dtype)).max
    c = np.arange(top + 1) / top
    low = c / 12.92
    high = ((c + 0.055) / 1.055) ** 2.4
    return np.where(c <= 0.04045, low, high).astype(np.float32)


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


def read_photo(
    source: str | os.PathLike | np.ndarray, name: str | None = None
) -> Photo | PhotoFailure:
    """One picture, turned upright by its EXIF tag, as three RGB channels.

    Alpha is dropped, grey is repeated, CMYK and palettes are converted, of an
    animation the first frame is taken. Pictures above 16 megapixels are decoded
    at a half, a quarter or an eighth.

    Parameters
    ----------
    source : path or (H, W), (H, W, 3) or (H, W, 4) array
        An array is RGB, sRGB-encoded: uint8, uint16, or floats in [0, 1].
    name : str, optional
        The name in reports; by default the file's own.

    Returns
    -------
    Photo or PhotoFailure
        A failure has the code ``"unreadable"`` or ``"too_large"``.
    """
    if isinstance(source, np.ndarray):
        return _from_array(source, name or "picture")
    path = Path(source)
    name = name or path.name
    data = file_bytes(path, name)
    if isinstance(data, PhotoFailure):
        return data
    header = read_header(data)
    failure = judge_header(header, name)
    if failure is not None:
        return failure
    assert header is not None
    reduction = 1
    while reduction < 8 and header.pixels / reduction**2 > FULL_SIZE_PIXELS:
        reduction *= 2
    whole = plain_png(data) if header.format == "PNG" else data
    pixels = None if whole is None else decode(whole, reduction)
    if pixels is None:
        return PhotoFailure(
            name,
            "unreadable",
            f"{name} is damaged or cut short; copy or export it again.",
        )
    if pixels.dtype not in (np.uint8, np.uint16):
        return PhotoFailure(
            name,
            "unreadable",
            f"{name} stores {pixels.dtype} samples; save it with 8 or 16 bits.",
        )
    width, height = header.width, header.height
    # Decoding turned the picture as EXIF says; the header speaks of the unturned.
    h, w = pixels.shape[:2]
    if (w, h) != _reduced(width, height, reduction) and (h, w) == _reduced(
        width, height, reduction
    ):
        width, height = height, width
    return Photo(name, path, (width, height), pixels, (0.0, 0.0, 1.0 / reduction))


def cut(
    photo: Photo,
    box: tuple[float, float, float, float] | np.ndarray,
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
    part = photo.pixels[low[1] : high[1], low[0] : high[0]]
    x0, y0, scale = photo.window
    origin = (x0 + low[0] / scale, y0 + low[1] / scale)
    # Not so small that a strip at the picture's edge vanishes.
    factor = max(max_side / max(part.shape[:2]), 1 / min(part.shape[:2]))
    if factor < 1:
        # With dsize empty, cv2 uses exactly this factor on both axes; with a
        # size it would round the factor to the size, per axis.
        part = cv2.resize(
            part, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA
        )
        part = part[:max_side, :max_side]
    else:
        factor = 1.0
        part = part.copy()
    return Photo(
        photo.name, photo.path, photo.size, part, (*origin, float(scale * factor))
    )


def _is_folder(entry: os.DirEntry) -> bool:
    try:
        return entry.is_dir()
    except OSError:
        return False


def _reduced(width: int, height: int, reduction: int) -> tuple[int, int]:
    return -(-width // reduction), -(-height // reduction)


def _from_array(array: np.ndarray, name: str) -> Photo | PhotoFailure:
    def bad(what: str) -> PhotoFailure:
        return PhotoFailure(
            name,
            "unreadable",
            f"{name} {what}; give an (H, W, 3) array of uint8, uint16 or of "
            "floats in [0, 1].",
        )

    if array.ndim == 2:
        array = array[..., None]
    if array.ndim != 3 or array.shape[2] not in (1, 3, 4):
        return bad(f"has the shape {array.shape}")
    if min(array.shape[:2]) < MIN_SIDE:
        return bad(f"has only {array.shape[1]} x {array.shape[0]} pixels")
    if array.shape[0] * array.shape[1] > MAX_PIXELS:
        return PhotoFailure(
            name,
            "too_large",
            f"{name} has {array.shape[1]} x {array.shape[0]} pixels, more than "
            f"{MAX_PIXELS // 10**6} megapixels; make it smaller.",
        )
    if np.issubdtype(array.dtype, np.floating):
        if not np.isfinite(array).all():
            return bad("holds values that are not finite")
        if array.min() < 0 or array.max() > 1:
            return bad("holds floats outside [0, 1]")
        array = np.round(array * 65535).astype(np.uint16)
    if array.dtype not in (np.uint8, np.uint16):
        return bad(f"holds {array.dtype} values")
    array = array[..., :3] if array.shape[2] >= 3 else np.repeat(array, 3, 2)
    h, w = array.shape[:2]
    return Photo(name, None, (w, h), np.ascontiguousarray(array))
