"""Focal length of a video, from what the phone wrote about its camera track.

iPhones state it as that of 35 mm film, ``com.apple.quicktime.camera.focal_length
.35mm_equivalent``, among the metadata of the video track or of the whole file: a list
of names (``keys``) and one of values (``ilst``) that count them from 1 (Apple,
QuickTime File Format, metadata atoms; AVFoundation, AVMetadataKey).
"""

from __future__ import annotations

import contextlib
import math
import re
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from .boxes import boxes, inside

_KEY = b"com.apple.quicktime.camera.focal_length.35mm_equivalent"
_PLACES = ((b"moov", b"trak", b"meta"), (b"moov", b"meta"))
# Types of a value: text such as "26" or "26.00mm", and numbers by their length.
_TEXT, _NUMBERS = 1, {21: "bhiq", 22: "BHIQ", 23: "f", 24: "d"}
# Further names are not looked at: no phone writes so many.
_MOST = 1000


def film_focal_mm(path: Path) -> float:
    """Focal length as that of 35 mm film; 0 if the file does not state it.

    Parameters
    ----------
    path : pathlib.Path
        A video file. Any content is allowed.
    """
    with contextlib.suppress(OSError, ValueError, struct.error):
        # Mapped, not read: the pictures lie between what is looked at.
        data = np.memmap(path, np.uint8, "r").data
        for place in _PLACES:
            for metadata in inside(data, *place):
                for value in _values(metadata):
                    return value
    return 0.0


def _values(metadata: memoryview) -> Iterator[float]:
    numbers = {
        struct.pack(">I", number)
        for names in inside(metadata, b"keys")
        for number, name in enumerate(_names(names), start=1)
        if name == _KEY
    }
    for items in inside(metadata, b"ilst"):
        for kind, item in boxes(items):
            for value in inside(item, b"data") if kind in numbers else ():
                found = _number(value)
                if found > 0:
                    yield found


def _names(keys: memoryview) -> Iterator[bytes]:
    at = 8  # version and flags, number of names
    for _ in range(_MOST):
        if at + 8 > len(keys):
            return
        (size,) = struct.unpack(">I", keys[at : at + 4])
        yield bytes(keys[at + 8 : at + min(size, 256)])
        at += max(size, 8)


def _number(atom: memoryview) -> float:
    """The value of a ``data`` atom; 0 if it is no number above 0."""
    (kind,) = struct.unpack(">I", atom[:4])
    value = bytes(atom[8:64])  # after the type and the locale
    number = 0.0
    if kind == _TEXT:
        found = re.match(rb"\s*(\d{1,6}(?:\.\d{1,6})?)\s*(?:mm)?\s*$", value)
        number = float(found[1]) if found else 0.0
    else:
        for code in _NUMBERS.get(kind, ""):
            if struct.calcsize(code) == len(value):
                number = float(struct.unpack(">" + code, value)[0])
    return number if math.isfinite(number) and number > 0 else 0.0
