"""glTF 2.0, binary (``.glb``): the quad mesh with its textures and ARKit keys, metres.

y is up and the face looks along +z, as glTF wants it, so nothing is turned and every
node is unscaled. Quads leave as two triangles each. Keys are morph targets with sparse
positions and normals; their names stand in ``extras.targetNames``, where Blender,
three.js and others look for them. Reference: Khronos Group, glTF 2.0 Specification,
sections 3.6 (buffers, sparse accessors), 3.7.2 (morph targets) and 4.4 (container).
"""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .._types import Array, Indices
from ..drawing.pictures import encode_png
from ..files import write_bytes
from ..rig.eyes import iris_picture
from ..rig.mesh import PARTS, QuadMesh
from .mtl import read_texture

METRES = 1e-3
_FLOAT, _UINT, _USHORT = 5126, 5125, 5123
_VERTICES, _INDICES = 34962, 34963
#: Vertices that a key moves by less, in metres, stay out of it.
_STILL = 1e-5
#: Normals that a key turns by less, in radians, stay as they are.
_FLAT = 5e-3


def write_glb(
    path: str | os.PathLike,
    mesh: QuadMesh,
    name: str = "face",
    texture: str | os.PathLike | bytes | None = None,
    normals: str | os.PathLike | bytes | None = None,
) -> Path:
    """Write a quad mesh as ``.glb``.

    Parameters
    ----------
    path : path-like
    mesh : QuadMesh
    name : str
        Name of node and mesh.
    texture : path or bytes, optional
        PNG or JPEG picture of the skin over the mesh's ``uv``, row 0 at v = 0; embedded
        as it is.
    normals : path or bytes, optional
        The same for a tangent-space normal map, green up.

    Raises
    ------
    ReconstructionError
        When the picture cannot be read or the file cannot be written.
    """
    return write_bytes(path, glb_bytes(mesh, name, texture, normals))


@dataclass
class _File:
    """The JSON of the file and its one buffer."""

    json: dict[str, Any]
    binary: bytearray

    def append(self, kind: str, value: dict[str, Any]) -> int:
        listed = self.json.setdefault(kind, [])
        listed.append(value)
        return len(listed) - 1

    def view(self, data: bytes, target: int | None = None) -> int:
        self.binary.extend(b"\0" * (-len(self.binary) % 4))
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data)}
        if target is not None:
            view["target"] = target
        self.binary.extend(data)
        return self.append("bufferViews", view)

    def vectors(self, values: Array, limits: bool = False) -> int:
        """An accessor of 2 or 3 floats a vertex."""
        data = np.ascontiguousarray(values, "<f4")
        accessor = {
            "bufferView": self.view(data.tobytes(), _VERTICES),
            "componentType": _FLOAT,
            "count": len(data),
            "type": f"VEC{data.shape[1]}",
        }
        if limits:
            accessor["min"] = [float(x) for x in data.min(axis=0)]
            accessor["max"] = [float(x) for x in data.max(axis=0)]
        return self.append("accessors", accessor)

    def sparse(self, values: Array, used: Indices, limits: bool = False) -> int:
        """An accessor that is zero but for the vertices ``used``."""
        data = np.ascontiguousarray(values[used], "<f4")
        accessor: dict[str, Any] = {
            "componentType": _FLOAT,
            "count": len(values),
            "type": "VEC3",
        }
        if limits:
            # What is left out is zero and counts too.
            rest = np.zeros((int(len(used) < len(values)), 3), "<f4")
            all_of_it = np.concatenate([data, rest])
            accessor["min"] = [float(x) for x in all_of_it.min(axis=0)]
            accessor["max"] = [float(x) for x in all_of_it.max(axis=0)]
        if len(used):
            kind = "<u2" if len(values) < 65536 else "<u4"
            accessor["sparse"] = {
                "count": len(used),
                "indices": {
                    "bufferView": self.view(used.astype(kind).tobytes()),
                    "componentType": _USHORT if kind == "<u2" else _UINT,
                },
                "values": {"bufferView": self.view(data.tobytes())},
            }
        return self.append("accessors", accessor)

    def indices(self, values: Indices) -> int:
        data = np.ascontiguousarray(values.ravel(), "<u4")
        view = self.view(data.tobytes(), _INDICES)
        return self.append(
            "accessors",
            {
                "bufferView": view,
                "componentType": _UINT,
                "count": len(data),
                "type": "SCALAR",
            },
        )

    def picture(self, data: bytes, kind: str) -> int:
        image = self.append("images", {"bufferView": self.view(data), "mimeType": kind})
        if "samplers" not in self.json:
            self.append("samplers", {"magFilter": 9729, "minFilter": 9987})
        return self.append("textures", {"sampler": 0, "source": image})

    def bytes(self) -> bytes:
        self.binary.extend(b"\0" * (-len(self.binary) % 4))
        self.json["buffers"] = [{"byteLength": len(self.binary)}]
        text = json.dumps(self.json, separators=(",", ":")).encode("utf-8")
        text += b" " * (-len(text) % 4)
        total = 12 + 8 + len(text) + 8 + len(self.binary)
        return b"".join(
            [
                struct.pack("<4sII", b"glTF", 2, total),
                struct.pack("<I4s", len(text), b"JSON"),
                text,
                struct.pack("<I4s", len(self.binary), b"BIN\0"),
                bytes(self.binary),
            ]
        )


def glb_bytes(
    mesh: QuadMesh,
    name: str = "face",
    texture: str | os.PathLike | bytes | None = None,
    normals: str | os.PathLike | bytes | None = None,
) -> bytes:
    """The bytes of the file; parameters as in :func:`write_glb`."""
    file = _File(
        {
            "asset": {"version": "2.0", "generator": "bsface"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0, "name": name}],
        },
        bytearray(),
    )
    skin = {"baseColorTexture": texture, "normalTexture": normals}
    pieces = [_Piece(mesh, k) for k in range(len(PARTS)) if (mesh.part == k).any()]
    primitives = []
    for piece in pieces:
        material = file.append("materials", _material(file, piece.part, skin))
        primitives.append(
            {
                "attributes": {
                    "POSITION": file.vectors(piece.points, limits=True),
                    "NORMAL": file.vectors(piece.normals),
                    "TEXCOORD_0": file.vectors(piece.uv),
                },
                "indices": file.indices(piece.triangles),
                "material": material,
            }
        )
        targets = [piece.target(file, key) for key in mesh.keys.values()]
        if targets:
            primitives[-1]["targets"] = targets
    made: dict[str, Any] = {"name": name, "primitives": primitives}
    if mesh.keys:
        made["weights"] = [0.0] * len(mesh.keys)
        made["extras"] = {"targetNames": list(mesh.keys)}
    file.json["meshes"] = [made]
    return file.bytes()


class _Piece:
    """The triangles of one material with vertices of their own."""

    def __init__(self, mesh: QuadMesh, part: int):
        quads = mesh.quads[mesh.part == part]
        self.part = part
        self.used, index = np.unique(quads, return_inverse=True)
        self.quads = index.reshape(quads.shape)
        self.triangles = np.concatenate([self.quads[:, :3], self.quads[:, [0, 2, 3]]])
        self.points = mesh.points[self.used] * METRES
        self.uv = mesh.uv[self.used]
        self.normals = self._normals(self.points)

    def _normals(self, points: Array) -> Array:
        a, b, c, d = (points[self.quads[:, k]] for k in range(4))
        area = np.cross(c - a, d - b)
        total = np.zeros_like(points)
        for k in range(4):
            np.add.at(total, self.quads[:, k], area)
        length = np.linalg.norm(total, axis=1, keepdims=True)
        flat = length[:, 0] < 1e-20
        total[flat] = (0.0, 0.0, 1.0)
        return total / np.where(flat[:, None], 1.0, length)

    def target(self, file: _File, key: Array) -> dict[str, int]:
        moved = key[self.used] * METRES
        if not moved.any():
            return {
                "POSITION": file.sparse(moved, np.zeros(0, np.int64), limits=True),
                "NORMAL": file.sparse(moved, np.zeros(0, np.int64)),
            }
        turned = self._normals(self.points + moved) - self.normals
        used = np.flatnonzero(np.abs(moved).max(axis=1) > _STILL)
        bent = np.flatnonzero(np.abs(turned).max(axis=1) > _FLAT)
        return {
            "POSITION": file.sparse(moved, used, limits=True),
            "NORMAL": file.sparse(turned, bent),
        }


def _material(
    file: _File, part: int, skin: Mapping[str, str | os.PathLike | bytes | None]
) -> dict[str, Any]:
    """The material of a part; ``skin`` has the skin's pictures by their use."""
    name = PARTS[part]
    surface: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": 0.55}
    # The sheet has no back of its own: seen from behind it shall not vanish.
    made = {"name": name, "pbrMetallicRoughness": surface, "doubleSided": True}
    if name == "skin":
        if skin["baseColorTexture"] is None:
            surface["baseColorFactor"] = [0.60, 0.40, 0.31, 1.0]
        for use, path in skin.items():
            if path is not None:
                content, ending = read_texture(path)
                kind = {".png": "image/png", ".jpg": "image/jpeg"}[ending]
                target = surface if use == "baseColorTexture" else made
                target[use] = {"index": file.picture(content, kind)}
    elif name == "eyes":
        picture = encode_png(iris_picture())
        surface["baseColorTexture"] = {"index": file.picture(picture, "image/png")}
        surface["roughnessFactor"] = 0.1
    else:
        surface["baseColorFactor"] = [0.16, 0.03, 0.03, 1.0]
    return made
