"""A PNG file reduced to its one picture, checked before a decoder sees it.

OpenCV 4.11 ends the process on some damaged animations. Of an animation the first
frame is wanted, which is the ordinary picture that the file holds besides; what belongs
to the other frames is left out here, and so is everything that says nothing about
pixels.
"""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import NDArray

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
# Header, palette, transparency, pixels, end; and the turn of the camera.
_KEPT = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND", b"eXIf")


def plain_png(data: NDArray[np.uint8]) -> NDArray[np.uint8] | None:
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
