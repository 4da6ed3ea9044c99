"""Vertices of meshes that other programs wrote: OBJ, STL (both forms) and PLY.

Enough to measure them; see `bsface.surface.deviation`.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

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


def _obj(data: bytes) -> Array:
    rows = re.findall(rb"^v[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+)", data, re.MULTILINE)
    return np.array(rows, float).reshape(-1, 3)


def _stl(data: bytes) -> Array:
    count = int.from_bytes(data[80:84], "little")
    if len(data) == 84 + 50 * count:
        record = np.dtype([("n", "<f4", 3), ("v", "<f4", (3, 3)), ("extra", "<u2")])
        triangles = np.frombuffer(data, record, count, 84)
        return triangles["v"].reshape(-1, 3).astype(float)
    rows = re.findall(rb"^\s*vertex\s+(\S+)\s+(\S+)\s+(\S+)", data, re.MULTILINE)
    return np.array(rows, float).reshape(-1, 3)


def _ply(data: bytes) -> Array:
    header, _, body = data.partition(b"end_header\n")
    lines = [line.split() for line in header.decode("ascii").splitlines()]
    words = [line[0] if line else "" for line in lines]
    form, first = lines[words.index("format")][1], words.index("element")
    if lines[first][1] != "vertex":
        raise ValueError("the vertices do not come first")
    count = int(lines[first][2])
    fields = []
    for line in lines[first + 1 :]:
        if line[:1] != ["property"]:
            break
        fields.append((line[2], _PLY_TYPES[line[1]]))
    if form == "ascii":
        rows = np.array([r.split() for r in body.splitlines()[:count]], float)
        names = [name for name, _ in fields]
        return rows[:, [names.index(axis) for axis in "xyz"]]
    order = ">" if form == "binary_big_endian" else "<"
    vertex = np.frombuffer(body, [(n, order + k) for n, k in fields], count)
    return np.stack([vertex[axis].astype(float) for axis in "xyz"], axis=1)
