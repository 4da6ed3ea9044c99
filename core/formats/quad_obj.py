"""Quads as Wavefront OBJ with one material for each part, millimetres.

Reference: Wavefront Technologies, Advanced Visualizer manual, appendix B1.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ..drawing.pictures import encode_png
from ..files import write_bytes, write_text
from ..rig.eyes import iris_picture
from ..rig.mesh import PARTS, QuadMesh
from .mtl import Source, material, plain_stem, write_pictures

#: Colours of parts without a picture.
COLOURS = {"skin": "0.80 0.67 0.60", "mouth": "0.44 0.18 0.18"}


def write_quads_obj(
    path: str | os.PathLike,
    mesh: QuadMesh,
    name: str = "face",
    *,
    texture: Source | None = None,
    normals: Source | None = None,
    displacement: Source | None = None,
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
    normals, displacement : path or bytes, optional
        The same for a tangent-space normal map and a displacement, see
        :func:`.mesh.write_mesh_obj`.

    Raises
    ------
    ReconstructionError
        When the picture cannot be read or a file cannot be written.
    """
    path = Path(path)
    plain = plain_stem(path)
    skin = write_pictures(
        path, texture=texture, normals=normals, displacement=displacement
    )
    pictures = {"skin": skin}
    used = [part for k, part in enumerate(PARTS) if (mesh.part == k).any()]
    if "eyes" in used:
        drawn = encode_png(iris_picture())
        iris = write_bytes(path.with_name(f"{plain}_eyes.png"), drawn)
        pictures["eyes"] = {"map_Kd": iris.name}
    materials = []
    for part in used:
        own = pictures.get(part, {})
        colour = "1 1 1" if "map_Kd" in own else COLOURS[part]
        materials.append(material(part, colour, own))
    library = write_text(path.with_name(f"{plain}.mtl"), "".join(materials))
    lines = ["# quads, millimetres", f"mtllib {library.name}"]
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
