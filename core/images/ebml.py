"""Elements: the parts of Matroska and WebM files (RFC 8794)."""

from __future__ import annotations

from collections.abc import Iterator

# More elements on one level are not looked at: what is sought stands at the start.
_MOST = 4096


def elements(view: memoryview) -> Iterator[tuple[int, memoryview]]:
    """Identifier and content of each element, one after the other.

    Parameters
    ----------
    view : memoryview of bytes
        A file, or the content of an element that holds elements. Any content is
        allowed; an element that claims more than is there, or whose size is unknown,
        is cut off where `view` ends.
    """
    at = 0
    for _ in range(_MOST):
        name = _number(view, at, keep_marker=True)
        size = _number(view, at + name[1]) if name else None
        if name is None or size is None:
            return
        start = at + name[1] + size[1]
        unknown = size[0] == (1 << 7 * size[1]) - 1
        at = len(view) if unknown else start + size[0]
        yield name[0], view[start:at]


def below(view: memoryview, *path: int) -> Iterator[memoryview]:
    """Content of all elements at a path of identifiers."""
    for name, content in elements(view):
        if name == path[0]:
            if len(path) == 1:
                yield content
            else:
                yield from below(content, *path[1:])


def _number(
    view: memoryview, at: int, *, keep_marker: bool = False
) -> tuple[int, int] | None:
    """A number of variable length and its length; None where there is none."""
    if at >= len(view) or view[at] == 0:
        return None
    length = 9 - int(view[at]).bit_length()
    if at + length > len(view):
        return None
    value = int.from_bytes(view[at : at + length], "big")
    return (value if keep_marker else value - (1 << 7 * length)), length
