"""Directories of a TIFF file, which EXIF data are too (TIFF 6.0, section 2)."""

from __future__ import annotations

import struct
from dataclasses import dataclass

_CODES = {1: "B", 2: "s", 3: "H", 4: "I", 5: "II", 7: "B", 13: "I", 16: "Q", 18: "Q"}
_MOST_ENTRIES = 1000


@dataclass(frozen=True)
class Field:
    """Value of a tag.

    Parameters
    ----------
    code : str
        Letter of `struct` for one value, with its byte order.
    data : memoryview
        All values.
    """

    code: str
    data: memoryview

    def number(self) -> int:
        """The first value.

        Raises
        ------
        struct.error
            It is a text, or not all there.
        """
        value = struct.unpack_from(self.code, self.data)[0]
        if not isinstance(value, int):
            raise struct.error("a text in the place of a number")
        return value

    def quotient(self) -> float:
        """The first value; of two numbers, the first over the second (nan over 0).

        Raises
        ------
        struct.error
            It is a text, or not all there.
        """
        first = self.number()
        _, *over = struct.unpack_from(self.code, self.data)
        if not over:
            return float(first)
        return first / over[0] if over[0] else float("nan")


def directory(view: memoryview, at: int | None = None) -> dict[int, Field]:
    """Tags of a directory and their values.

    Parameters
    ----------
    view : memoryview of bytes
        The file from its byte order on. BigTIFF is understood.
    at : int, optional
        Where the directory stands; by default the first one.

    Raises
    ------
    struct.error
        The directory is not all there.
    """
    order = "<" if bytes(view[:2]) == b"II" else ">"
    big = struct.unpack(order + "H", view[2:4])[0] == 43
    word, wide = ("Q", 8) if big else ("I", 4)
    start = at
    if start is None:
        (start,) = struct.unpack(order + word, view[wide : 2 * wide])
    count_code = order + ("Q" if big else "H")
    head = struct.calcsize(count_code)
    (count,) = struct.unpack(count_code, view[start : start + head])
    found = {}
    for i in range(min(count, _MOST_ENTRIES)):
        entry = start + head + i * (4 + 2 * wide)
        tag, kind, values = struct.unpack(
            order + "HH" + word, view[entry : entry + 4 + wide]
        )
        code = _CODES.get(kind)
        if code is None:
            continue
        size = struct.calcsize(code) * values
        place = entry + 4 + wide
        if size > wide:
            (place,) = struct.unpack(order + word, view[place : place + wide])
        found[tag] = Field(order + code, view[place : place + size])
    return found
