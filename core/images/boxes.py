"""Boxes: the parts of HEIF, AVIF, JPEG 2000, MP4 and QuickTime files.

ISO/IEC 14496-12, 4.2; Apple, QuickTime File Format.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

# More boxes on one level are not looked at: no camera writes so many.
_MOST = 4096


def boxes(view: memoryview) -> Iterator[tuple[bytes, memoryview]]:
    """Type and content of each box, one after the other; stops where they end.

    Parameters
    ----------
    view : memoryview of bytes
        A file, or the content of a box that holds boxes. Any content is allowed; a
        box that claims more than is there is cut off.
    """
    at = 0
    for _ in range(_MOST):
        if at + 8 > len(view):
            return
        size, kind = struct.unpack(">I4s", view[at : at + 8])
        head = 8
        if size == 1 and at + 16 <= len(view):
            (size,) = struct.unpack(">Q", view[at + 8 : at + 16])
            head = 16
        elif size == 0:
            size = len(view) - at
        if size < head:
            return
        yield kind, view[at + head : at + size]
        at += size


def inside(view: memoryview, *path: bytes) -> Iterator[memoryview]:
    """Content of all boxes at a path such as ``b"meta", b"iprp", b"ipco"``."""
    for kind, content in boxes(view):
        if kind != path[0]:
            continue
        # Version and flags, which QuickTime's own files do not have there.
        if kind == b"meta" and bytes(content[4:8]) != b"hdlr":
            content = content[4:]
        if len(path) == 1:
            yield content
        else:
            yield from inside(content, *path[1:])
