"""A PNG file reduced to its one picture, and the mark of the PNG files that we write.

OpenCV 4.11 ends the process on some damaged animations. Of an animation the first
frame is wanted, which is the ordinary picture that the file holds besides; what belongs
to the other frames is left out here, and so is everything that says nothing about
pixels.
"""

from __future__ import annotations

import struct
import zlib

import numpy as np

from .._types import Picture8

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
# Header, palette, transparency, pixels, end; and the turn of the camera.
_KEPT = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND", b"eXIf")
# The PNG specification's keyword for the program that made a picture. It stands right
# after the header, so that the first bytes tell whose picture it is.
_MARK = b"tEXtSoftware\0bsface"
_AFTER_HEADER = len(_SIGNATURE) + 25


def plain_png(data: Picture8) -> Picture8 | None:
    """The same picture without its other chunks; None if damaged or cut short.

    Parameters
    ----------
    data : (n,) uint8 array
        A file that begins as a PNG does.
    """
    view = memoryview(data.tobytes())
    parts = [_SIGNATURE]
    at, name = len(_SIGNATURE), b""
    while name != b"IEND":
        if at + 12 > len(view):
            return None
        size = int.from_bytes(view[at : at + 4], "big")
        name, end = bytes(view[at + 4 : at + 8]), at + 12 + size
        if end > len(view):
            return None
        if name in _KEPT:
            sum_ = int.from_bytes(view[end - 4 : end], "big")
            if zlib.crc32(view[at + 4 : end - 4]) != sum_:
                return None
            parts.append(bytes(view[at:end]))
        at = end
    return np.frombuffer(b"".join(parts), np.uint8)


def marked(png: bytes) -> bytes:
    """A PNG file with the note that bsface wrote it."""
    chunk = (
        struct.pack(">I", len(_MARK) - 4) + _MARK + struct.pack(">I", zlib.crc32(_MARK))
    )
    return png[:_AFTER_HEADER] + chunk + png[_AFTER_HEADER:]


def is_marked(head: bytes) -> bool:
    """Whether the first 64 bytes of a file are those of a `marked` PNG."""
    return head.startswith(_SIGNATURE) and head[_AFTER_HEADER + 4 :].startswith(_MARK)
