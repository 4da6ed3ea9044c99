"""Photos: from a folder or arrays to turned RGB pixels with a place.

A photo is read once, in a size that is enough for its face, turned as its EXIF
tag says, and soon cut down to the face (`cut`), so that forty pictures of
twelve megapixels stay small in memory. Pixel coordinates always mean the turned
original: x right, y down, pixel centres at integers.

The header is judged before anything is decoded (`image_header`): that is what
keeps a decompression bomb out.
"""

from __future__ import annotations

import contextlib
import os
import re
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from ..errors import PhotoFailure, ReconstructionError
from .image_header import READABLE, ImageHeader, read_header

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
        ".jp2",
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

MAX_PIXELS = 200_000_000
MAX_DECODED_BYTES = 600_000_000
MAX_FILE_BYTES = 600_000_000
MIN_SIDE = 32
# Above this many pixels the picture is decoded at half, a quarter or an eighth
# of its size: a face that fills a sixth of 16 megapixels still has 650 pixels.
FULL_SIZE_PIXELS = 16_000_000

_REDUCED = {
    1: cv2.IMREAD_COLOR,
    2: cv2.IMREAD_REDUCED_COLOR_2,
    4: cv2.IMREAD_REDUCED_COLOR_4,
    8: cv2.IMREAD_REDUCED_COLOR_8,
}


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
            f"{folder}: cannot open this folder ({_why(error)}); "
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
            f"{folder}: the folder cannot be read ({_why(error)}); "
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
    data = _file_bytes(path, name)
    if isinstance(data, PhotoFailure):
        return data
    header = read_header(data)
    failure = _judge_header(header, name)
    if failure is not None:
        return failure
    assert header is not None
    reduction = 1
    while reduction < 8 and header.pixels / reduction**2 > FULL_SIZE_PIXELS:
        reduction *= 2
    # libpng would complain on stderr about a missing end.
    cut_short = header.format == "PNG" and data.tobytes().rfind(b"IEND") < 0
    pixels = None if cut_short else _decode(data, reduction)
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


def _why(error: OSError) -> str:
    text = error.strerror or str(error)
    return text[:1].lower() + text[1:]


def _file_bytes(path: Path, name: str) -> np.ndarray | PhotoFailure:
    try:
        info = path.stat()
        if not stat.S_ISREG(info.st_mode):
            # A named pipe would block for ever when opened.
            return PhotoFailure(
                name, "unreadable", f"{name} is not a regular file; remove it."
            )
        if info.st_size == 0:
            return PhotoFailure(
                name,
                "unreadable",
                f"{name} is empty (zero bytes); copy it again.",
            )
        if info.st_size > MAX_FILE_BYTES:
            return PhotoFailure(
                name,
                "too_large",
                f"{name} has {info.st_size / 1e6:.0f} MB, more than "
                f"{MAX_FILE_BYTES / 1e6:.0f}; save it smaller.",
            )
        return np.fromfile(path, np.uint8)
    except (OSError, ValueError) as error:
        why = _why(error) if isinstance(error, OSError) else str(error)
        return PhotoFailure(
            name,
            "unreadable",
            f"{name} cannot be opened ({why}); check the file and its permissions.",
        )


def _judge_header(header: ImageHeader | None, name: str) -> PhotoFailure | None:
    if header is None:
        return PhotoFailure(
            name,
            "unreadable",
            f"{name} is not a picture, whatever its name says; remove it.",
        )
    if header.format not in READABLE:
        return PhotoFailure(
            name,
            "unreadable",
            f"{name} is a {header.format} picture, which cannot be read here; "
            "export it as JPEG or PNG.",
        )
    if min(header.width, header.height) < MIN_SIDE:
        return PhotoFailure(
            name,
            "unreadable",
            f"{name} has only {header.width} x {header.height} pixels, too few "
            "for a face; use the original picture.",
        )
    decoded = header.pixels * max(header.bytes_per_pixel, 3)
    if header.pixels > MAX_PIXELS or decoded > MAX_DECODED_BYTES:
        return PhotoFailure(
            name,
            "too_large",
            f"{name} has {header.width} x {header.height} pixels, more than can "
            f"be read ({MAX_PIXELS // 10**6} megapixels of 8 bits); save it smaller.",
        )
    return None


def _reduced(width: int, height: int, reduction: int) -> tuple[int, int]:
    return -(-width // reduction), -(-height // reduction)


def _decode(data: np.ndarray, reduction: int) -> np.ndarray | None:
    # COLOR applies the EXIF turn and gives three channels; ANYDEPTH keeps 16 bits.
    flags = _REDUCED[reduction] | cv2.IMREAD_ANYDEPTH
    try:
        with _quiet():
            pixels = cv2.imdecode(data, flags)
    except (cv2.error, MemoryError):
        return None
    if pixels is None or pixels.ndim != 3 or pixels.size == 0:
        return None
    return cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """OpenCV warns on stderr about each damaged file; we say it in the report."""
    logging = getattr(getattr(cv2, "utils", None), "logging", None)
    if logging is None:
        yield
        return
    level = logging.getLogLevel()
    logging.setLogLevel(logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        logging.setLogLevel(level)


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
