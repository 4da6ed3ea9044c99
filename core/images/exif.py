"""Where a picture file keeps its EXIF data, which are a TIFF file of their own.

JPEG has them in an APP1 segment, PNG in ``eXIf``, WebP in ``EXIF``, HEIF and AVIF in an
item of that type (ISO/IEC 23008-12, annex A), and a TIFF file is their first directory.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

from .boxes import boxes, inside
from .tiff import Field, directory

_MARK = b"Exif\0\0"
_EXIF_DIRECTORY = 34665
# Further parts of a file are not looked at: no camera writes so many.
_MOST = 100_000


def exif_fields(view: memoryview, kind: str) -> dict[int, Field]:
    """The tags of a picture's EXIF directory; none where it has no such data.

    Parameters
    ----------
    view : memoryview of bytes
        The file. Any content is allowed.
    kind : str
        ``ImageHeader.format``.
    """
    try:
        data = exif_data(view, kind)
        return {} if data is None else exif_directory(data)
    except (struct.error, IndexError, OverflowError):
        return {}


def exif_directory(data: memoryview) -> dict[int, Field]:
    """The EXIF directory of `exif_data`, empty where they have none.

    Raises
    ------
    struct.error
        It is not all there.
    """
    pointer = directory(data).get(_EXIF_DIRECTORY)
    return {} if pointer is None else directory(data, pointer.number())


def exif_data(view: memoryview, kind: str) -> memoryview | None:
    """EXIF data from their byte order on; None where the file has none.

    Raises
    ------
    struct.error, IndexError
        The file is cut short.
    """
    finder = _FINDERS.get(kind)
    return None if finder is None else finder(view)


def jpeg_segments(view: memoryview) -> Iterator[tuple[int, memoryview]]:
    """Marker and content of the segments of a JPEG before its pixels."""
    at = 2
    for _ in range(_MOST):
        if at + 4 > len(view) or view[at] != 0xFF:
            return
        marker = view[at + 1]
        if marker in (0xD9, 0xDA):
            return
        if marker == 0xFF:
            at += 1
            continue
        (size,) = struct.unpack(">H", view[at + 2 : at + 4])
        yield marker, view[at + 4 : at + 2 + size]
        at += 2 + size


def png_chunks(view: memoryview) -> Iterator[tuple[bytes, memoryview]]:
    """Name and content of the chunks of a PNG."""
    at = 8
    for _ in range(_MOST):
        if at + 12 > len(view):
            return
        (size,) = struct.unpack(">I", view[at : at + 4])
        yield bytes(view[at + 4 : at + 8]), view[at + 8 : at + 8 + size]
        at += 12 + size


def webp_chunks(view: memoryview) -> Iterator[tuple[bytes, memoryview]]:
    """Name and content of the chunks of a WebP."""
    at = 12
    for _ in range(_MOST):
        if at + 8 > len(view):
            return
        name, size = struct.unpack("<4sI", view[at : at + 8])
        yield name, view[at + 8 : at + 8 + size]
        at += 8 + size + size % 2


def _jpeg(view: memoryview) -> memoryview | None:
    for marker, body in jpeg_segments(view):
        if marker == 0xE1 and bytes(body[:6]) == _MARK:
            return body[6:]
    return None


def _png(view: memoryview) -> memoryview | None:
    return next((body for name, body in png_chunks(view) if name == b"eXIf"), None)


def _webp(view: memoryview) -> memoryview | None:
    for name, body in webp_chunks(view):
        if name == b"EXIF":  # some programs write JPEG's mark before it
            return body[6:] if bytes(body[:6]) == _MARK else body
    return None


def _heif(view: memoryview) -> memoryview | None:
    number = _exif_item(view)
    if number is None:
        return None
    data = _item(view, number)
    if data is None:
        return None
    (skipped,) = struct.unpack(">I", data[:4])  # exif_tiff_header_offset
    return data[4 + skipped :]


def _exif_item(view: memoryview) -> int | None:
    """Number of the item of type ``Exif``."""
    for content in inside(view, b"meta", b"iinf"):
        for kind, body in boxes(content[6 if content[0] == 0 else 8 :]):
            # version 2 has numbers of two bytes, version 3 of four
            code = {2: ">H2x4s", 3: ">I2x4s"}.get(body[0] if kind == b"infe" else 0)
            if code is None:
                continue
            number, item = struct.unpack_from(code, body, 4)
            if item == b"Exif":
                return number
    return None


@dataclass
class _Numbers:
    """Reads the numbers of a box one after the other, from the byte ``at`` on."""

    content: memoryview
    at: int

    def take(self, size: int) -> int:
        """The next number, of ``size`` bytes."""
        self.at += size
        if self.at > len(self.content):
            raise IndexError("iloc is cut short")
        return int.from_bytes(self.content[self.at - size : self.at], "big")


def _item(view: memoryview, wanted: int) -> memoryview | None:
    """First extent of an item, where the box ``iloc`` says that it stands."""
    for content in inside(view, b"meta", b"iloc"):
        version, sizes = content[0], struct.unpack(">BB", content[4:6])
        wide = [size for pair in sizes for size in (pair >> 4, pair & 15)]
        offset_size, length_size, base_size, index_size = wide
        take = _Numbers(content, 6).take
        indexed = index_size if version in (1, 2) else 0
        for _ in range(take(4 if version == 2 else 2)):
            number = take(4 if version == 2 else 2)
            in_file = version == 0 or take(2) & 15 == 0
            take(2)  # data reference
            base, extents = take(base_size), take(2)
            if number == wanted and in_file and extents:
                take(indexed)
                start, length = base + take(offset_size), take(length_size)
                return view[start : start + length]
            take(extents * (indexed + offset_size + length_size))
    return None


_FINDERS = {
    "JPEG": _jpeg,
    "PNG": _png,
    "WebP": _webp,
    "TIFF": lambda view: view,
    "HEIC": _heif,
    "AVIF": _heif,
}
