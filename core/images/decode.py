"""A picture file to pixels, with everything that can be wrong about it.

Checks come in this order so that hostile files do no harm: the kind of file, its
size, what its header claims, and only then the pixels.
"""

from __future__ import annotations

import stat
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from .._types import Array32, Picture8
from ..errors import PhotoFailure, out_of_memory
from ..process_state import Undo, WhileAnyone
from .header import OPTIONAL, READABLE, ImageHeader

MIN_SIDE = 32
# Raw files begin as TIFF does, with a thumbnail that must not pass for the photo.
RAW_ENDINGS = frozenset((
    ".cr2", ".cr3", ".nef", ".arw", ".dng", ".raf", ".orf", ".rw2", ".pef", ".srw",
))  # fmt: skip


@dataclass(frozen=True)
class Limits:
    """How large a picture may be.

    Parameters
    ----------
    pixels : int
        More are refused.
    decoded_bytes : int
        As the file stores them; more are refused.
    file_bytes : int
        A larger file is refused.
    full_size_pixels : int
        A larger picture is decoded at a half, a quarter or an eighth of its size: a
        face that fills a sixth of 16 megapixels still has 650 pixels.
    held_bytes : int
        Of frames of a video that are held while frames are chosen. Those that do not
        fit are decoded again if they are chosen.
    """

    pixels: int = 200_000_000
    decoded_bytes: int = 600_000_000
    file_bytes: int = 600_000_000
    full_size_pixels: int = 16_000_000
    held_bytes: int = 750_000_000

    def reduction(self, pixels: int) -> int:
        """1, 2, 4 or 8: the part of its size at which so large a picture is read."""
        reduction = 1
        while reduction < 8 and pixels / reduction**2 > self.full_size_pixels:
            reduction *= 2
        return reduction


LIMITS = Limits()

_SILENT = 0  # OpenCV's LOG_LEVEL_SILENT, which its Python module does not name

_REDUCED = {
    1: cv2.IMREAD_COLOR,
    2: cv2.IMREAD_REDUCED_COLOR_2,
    4: cv2.IMREAD_REDUCED_COLOR_4,
    8: cv2.IMREAD_REDUCED_COLOR_8,
}


def why_not(error: OSError) -> str:
    """The system's reason, as the middle of a sentence."""
    text = error.strerror or str(error)
    return text[:1].lower() + text[1:]


def judge_file(path: Path, name: str) -> PhotoFailure | None:
    """Why a file cannot be opened, or None if it can."""
    try:
        info = path.stat()
        if stat.S_ISDIR(info.st_mode):
            return PhotoFailure(
                name, "unreadable", f"{name} is a folder; give the photos in it."
            )
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
        with path.open("rb"):
            return None
    except (OSError, ValueError) as error:
        return _cannot_be_opened(name, error)


def file_bytes(
    path: Path, name: str, limits: Limits = LIMITS
) -> Picture8 | PhotoFailure:
    """(n,) uint8 content of a regular file of a sensible size."""
    failure = judge_file(path, name)
    if failure is not None:
        return failure
    try:
        size = path.stat().st_size
        if size > limits.file_bytes:
            return PhotoFailure(
                name,
                "too_large",
                f"{name} has {size / 1e6:.0f} MB, more than "
                f"{limits.file_bytes / 1e6:.0f}; save it smaller.",
            )
        return np.fromfile(path, np.uint8)
    except OSError as error:
        return _cannot_be_opened(name, error)


def _cannot_be_opened(name: str, error: OSError | ValueError) -> PhotoFailure:
    why = why_not(error) if isinstance(error, OSError) else str(error)
    return PhotoFailure(
        name,
        "unreadable",
        f"{name} cannot be opened ({why}); check the file and its permissions.",
    )


def judge_header(
    header: ImageHeader | None, name: str, limits: Limits = LIMITS
) -> PhotoFailure | None:
    """Why a picture with this header is not decoded, or None."""
    if header is None:
        return PhotoFailure(
            name,
            "unreadable",
            f"{name} is not a picture of a format that can be read, whatever its name "
            "says; export it as JPEG or PNG, or remove it.",
        )
    if header.format not in READABLE | OPTIONAL:
        return PhotoFailure(
            name,
            "unreadable",
            f"{name} is a {header.format} picture, which cannot be read here; "
            "export it as JPEG or PNG.",
        )
    if header.format in OPTIONAL and header.pixels == 0:
        return damaged(name)
    if header.samples:
        return PhotoFailure(
            name,
            "unreadable",
            f"{name} stores {header.samples}; export it as an ordinary picture of 8 or "
            "16 bits.",
        )
    if min(header.width, header.height) < MIN_SIDE:
        return PhotoFailure(
            name,
            "unreadable",
            f"{name} has only {header.width} x {header.height} pixels and needs "
            f"{MIN_SIDE} on each side; use a larger picture.",
        )
    decoded = header.pixels * max(header.bytes_per_pixel, 3)
    if header.pixels > limits.pixels or decoded > limits.decoded_bytes:
        return PhotoFailure(
            name,
            "too_large",
            f"{name} has {header.width} x {header.height} pixels, more than can be "
            f"read ({limits.pixels // 10**6} megapixels of 8 bits); save it smaller.",
        )
    return None


def damaged(name: str) -> PhotoFailure:
    """The failure of a file that begins well."""
    why = f"{name} is damaged or cut short; copy or export it again."
    return PhotoFailure(name, "unreadable", why)


def decode(data: Picture8, reduction: int) -> np.ndarray | None:
    """(h, w, 3) RGB, EXIF-turned, at 1 / `reduction` of its size; None if damaged.

    Parameters
    ----------
    data : (n,) uint8 array
    reduction : 1, 2, 4 or 8

    Raises
    ------
    MemoryError
        There is not enough memory for the pixels.
    """
    # COLOR applies the EXIF turn and gives three channels; ANYDEPTH keeps 16 bits.
    flags = _REDUCED[reduction] | cv2.IMREAD_ANYDEPTH
    try:
        with quiet():
            pixels = cv2.imdecode(data, flags)
    except cv2.error as error:
        if out_of_memory(error):
            raise MemoryError from None
        return None
    if pixels is None or pixels.ndim != 3 or pixels.size == 0:
        return None
    if pixels.dtype not in (np.uint8, np.uint16):
        return None
    return cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB)


def decode_alpha(data: Picture8 | None) -> Array32 | None:
    """(h, w) alpha channel from 0 to 1, not turned; None without one."""
    if data is None:
        return None
    try:
        with quiet():
            pixels = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        if out_of_memory(error):
            raise MemoryError from None
        return None
    if pixels is None or pixels.ndim != 3 or pixels.shape[2] != 4:
        return None
    if pixels.dtype not in (np.uint8, np.uint16):
        return None
    return pixels[..., 3].astype(np.float32) / np.iinfo(pixels.dtype).max


def _silence() -> Undo:
    # OpenCV 4.13 moved the two functions.
    moved = getattr(cv2.utils, "logging", None)
    log = cv2 if hasattr(cv2, "getLogLevel") or moved is None else moved
    level = log.getLogLevel()
    log.setLogLevel(_SILENT)
    return lambda: log.setLogLevel(level)


#: OpenCV warns on stderr about each damaged file; we say it in the report.
quiet = WhileAnyone(_silence)
