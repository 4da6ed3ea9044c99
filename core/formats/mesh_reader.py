"""Vertices of meshes that other programs wrote: OBJ, STL (both forms) and PLY.

Enough to measure them; see `bsface.surface.deviation`.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .._types import Array
from ..errors import ReconstructionError

_PLY_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4",
    "uint": "u4", "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1",
    "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4",
    "float64": "f8",
}  # fmt: skip


def read_mesh_vertices(path: str | os.PathLike) -> Array:
    """Distinct vertices of a mesh file, (p, 3), in the numbers of the file.

    Raises
    ------
    ReconstructionError
        When the file cannot be read, or is none of OBJ, STL and PLY.
    """
    path = Path(path)
    readers = {".obj": _obj, ".stl": _stl, ".ply": _ply}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise ReconstructionError(
            f"{path}: only .obj, .stl and .ply meshes can be measured; convert it."
        )
    try:
        points = reader(path.read_bytes())
    except OSError as error:
        raise ReconstructionError(
            f"{path}: cannot be read ({error.strerror}); give a mesh file."
        ) from None
    except (ValueError, IndexError, KeyError, TypeError):
        points = np.zeros((0, 3))
    if not len(points) or not np.isfinite(points).all():
        raise ReconstructionError(
            f"{path}: no vertices can be read from it; write the mesh again."
        )
    return np.unique(points, axis=0)


#: What a line begins after: its end may be LF, CR LF or CR; and three numbers.
_START, _THREE = rb"(?<![^\r\n])[ \t]*", rb"[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+)"


def _obj(data: bytes) -> Array:
    rows = re.findall(_START + rb"v" + _THREE, data)
    return np.array(rows, float).reshape(-1, 3)


def _stl(data: bytes) -> Array:
    count = int.from_bytes(data[80:84], "little")
    # Of a text these four letters are more than any file holds; some programs write
    # more behind the triangles.
    if count > 0 and 84 + 50 * count <= len(data):
        record = np.dtype([("n", "<f4", 3), ("v", "<f4", (3, 3)), ("extra", "<u2")])
        triangles = np.frombuffer(data, record, count, 84)
        return _floats(triangles["v"].reshape(-1, 3))
    rows = re.findall(_START + rb"vertex" + _THREE, data, re.IGNORECASE)
    return np.array(rows, float).reshape(-1, 3)


class _Element(NamedTuple):
    """Part of a PLY file: ``count`` rows of properties, each with its types.

    One type is a number; two are a list, with the type of its length first.
    """

    name: str
    count: int
    properties: list[tuple[str, list[str]]]


def _ply(data: bytes) -> Array:
    ends = (b"\r\n", b"\n", b"\r")
    end = next((e for e in ends if data.startswith(b"ply" + e)), b"\n")
    header, _, body = data.partition(b"end_header" + end)
    form, elements = "", list[_Element]()
    for line in header.decode("latin-1").split(end.decode()):
        word, *rest = line.split() or [""]
        if word == "format":
            form = rest[0]
        elif word == "element":
            elements.append(_Element(rest[0], int(rest[1]), []))
        elif word == "property":
            *kinds, name = rest
            types = [_PLY_TYPES[k] for k in kinds if k != "list"]
            elements[-1].properties.append((name, types))
    place = [element.name for element in elements].index("vertex")
    before, vertex = elements[:place], elements[place]
    if form == "ascii":
        first = sum(element.count for element in before)
        lines = body.splitlines()[first : first + vertex.count]
        if len(lines) < vertex.count:
            raise ValueError("there are fewer vertices than announced")
        rows = np.array([line.split() for line in lines], float)
        names = [name for name, _ in vertex.properties]
        return rows[:, [names.index(axis) for axis in "xyz"]]
    order = ">" if form == "binary_big_endian" else "<"
    start = 0
    for element in before:
        start = _behind(element, body, start, order)
    fields = [(name, order + kind) for name, (kind,) in vertex.properties]
    found = np.frombuffer(body, fields, vertex.count, start)
    return np.stack([_floats(found[axis]) for axis in "xyz"], axis=1)


def _floats(numbers: np.ndarray) -> Array:
    """As float64; those that are not finite are judged later, without a warning."""
    with np.errstate(invalid="ignore"):
        return numbers.astype(float)


def _behind(element: _Element, body: bytes, start: int, order: str) -> int:
    """Where an element of a binary file that begins at ``start`` ends."""
    kinds = [[np.dtype(order + t) for t in types] for _, types in element.properties]
    if all(len(types) == 1 for types in kinds):
        return start + element.count * sum(types[0].itemsize for types in kinds)
    for _ in range(element.count):
        for first, *items in kinds:
            length = int(np.frombuffer(body, first, 1, start)[0]) if items else 0
            if length < 0:
                raise ValueError("a list has less than no items")
            start += first.itemsize + sum(length * item.itemsize for item in items)
    return start
