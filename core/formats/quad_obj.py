"""Quads as Wavefront OBJ with one material for each part, millimetres.

Reference: Wavefront Technologies, Advanced Visualizer manual, appendix B1 (OBJ) and the
MTL material format 4.2.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ..drawing.pictures import encode_png
from ..files import write_bytes, write_text
from ..rig.eyes import iris_picture
from ..rig.mesh import PARTS, QuadMesh
from .mesh import read_texture

#: Colours of parts without a picture.
COLOURS = {"skin": "0.80 0.67 0.60", "mouth": "0.44 0.18 0.18"}


def write_quads_obj(
    path: str | os.PathLike,
    mesh: QuadMesh,
    name: str = "face",
    texture: str | os.PathLike | bytes | None = None,
) -> Path:
    """Write a quad mesh as ``.obj``, with its ``.mtl`` and pictures beside it.

    Parameters
    ----------
    path : path-like
    mesh : QuadMesh
        The keys are left out: the format has none.
    name : str
        Name of the object.
    texture : path or bytes, optional
        PNG or JPEG picture of the skin over the mesh's ``uv``, row 0 at v = 0.

    Raises
    ------
    ReconstructionError
        When the picture cannot be read or a file cannot be written.
    """
    path = Path(path)
    # Spaces in a file name end the statement in many readers.
    plain = "_".join(path.stem.split())
    pictures = {}
    if texture is not None:
        content, ending = read_texture(texture)
        pictures["skin"] = write_bytes(path.with_name(plain + ending), content)
    used = [part for k, part in enumerate(PARTS) if (mesh.part == k).any()]
    if "eyes" in used:
        drawn = encode_png(iris_picture())
        pictures["eyes"] = write_bytes(path.with_name(f"{plain}_eyes.png"), drawn)
    materials = []
    for part in used:
        colour = "1 1 1" if part in pictures else COLOURS[part]
        materials.append(f"newmtl {part}\nKd {colour}\nKs 0 0 0\nillum 1\n")
        if part in pictures:
            materials.append(f"map_Kd {pictures[part].name}\n")
    material = write_text(path.with_name(f"{plain}.mtl"), "".join(materials))
    lines = ["# quads, millimetres", f"mtllib {material.name}"]
    lines.append(f"o {'_'.join(name.split())}")
    lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.points.tolist()]
    lines += [f"vt {u!r} {1.0 - v!r}" for u, v in mesh.uv.tolist()]
    for part in used:
        lines.append(f"usemtl {part}")
        quads = mesh.quads[mesh.part == PARTS.index(part)] + 1
        lines += [
            f"f {a}/{a} {b}/{b} {c}/{c} {d}/{d}" for a, b, c, d in np.asarray(quads)
        ]
    return write_text(path, "\n".join([*lines, ""]))
