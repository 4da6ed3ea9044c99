"""Triangle meshes of a face as OBJ and PLY files, millimetres.

Texture coordinates are (u, 1 - v): row 0 of a picture, its top, is v = 0 of the core.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..files import write_bytes, write_text
from ..surface.bspline import BSplineSurface
from .mtl import Source, material, plain_stem, write_pictures
from .tessellation import tessellate


def write_mesh_obj(
    path: str | os.PathLike,
    surface: BSplineSurface,
    outline_uv: npt.ArrayLike | None = None,
    name: str = "face",
    *,
    tolerance: float = 0.25,
    texture: Source | None = None,
    normals: Source | None = None,
    displacement: Source | None = None,
) -> Path:
    """Write a triangle mesh as Wavefront OBJ with texture coordinates and normals.

    Parameters
    ----------
    path : path-like
    surface : BSplineSurface
    outline_uv : (k, 2) array, optional
    name : str
        Name of the object.
    tolerance : float
        Largest distance between surface and mesh, mm.
    texture : path, optional
        A PNG or JPEG picture over (u, v). It is copied beside the OBJ under its name,
        and a material file ``.mtl`` refers to it.
    normals, displacement : path, optional
        The same for a tangent-space normal map (``norm``, and ``map_Bump`` for
        Blender) and a displacement (``disp``); their names end in ``_normal`` and
        ``_displacement``.

    Raises
    ------
    ReconstructionError
        When the picture cannot be read or a file cannot be written.
    ValueError
        See :func:`.tessellation.tessellate`.
    """
    path = Path(path)
    mesh = tessellate(surface, outline_uv, tolerance)
    lines = [f"# B-spline face within {tolerance:g} mm, millimetres"]
    pictures = write_pictures(
        path, texture=texture, normals=normals, displacement=displacement
    )
    if pictures:
        colour = "1 1 1" if texture is not None else "0.60 0.40 0.31"
        library = path.with_name(f"{plain_stem(path)}.mtl")
        write_text(library, material("skin", colour, pictures))
        lines.append(f"mtllib {library.name}")
    lines.append(f"o {'_'.join(name.split())}")
    lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"vt {u!r} {1.0 - v!r}" for u, v in mesh.uv.tolist()]
    lines += [f"vn {x:.6f} {y:.6f} {z:.6f}" for x, y, z in mesh.normals.tolist()]
    if pictures:
        lines.append("usemtl skin")
    for a, b, c in (mesh.triangles + 1).tolist():
        lines.append(f"f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}")
    return write_text(path, "\n".join([*lines, ""]))


def write_mesh_ply(
    path: str | os.PathLike,
    surface: BSplineSurface,
    outline_uv: npt.ArrayLike | None = None,
    name: str = "face",
    tolerance: float = 0.25,
) -> Path:
    """Write a triangle mesh as binary PLY.

    Double positions, float normals and texture coordinates ``s, t`` (Blender's and
    MeshLab's names). Parameters and errors as in :func:`write_mesh_obj`.
    """
    mesh = tessellate(surface, outline_uv, tolerance)
    record = np.dtype(
        [(axis, "<f8") for axis in "xyz"]
        + [(f"n{axis}", "<f4") for axis in "xyz"]
        + [("s", "<f4"), ("t", "<f4")]
    )
    vertex = np.zeros(len(mesh.vertices), record)
    for index, axis in enumerate("xyz"):
        vertex[axis] = mesh.vertices[:, index]
        vertex[f"n{axis}"] = mesh.normals[:, index]
    vertex["s"], vertex["t"] = mesh.uv[:, 0], 1.0 - mesh.uv[:, 1]
    face = np.zeros(len(mesh.triangles), [("count", "u1"), ("index", "<i4", 3)])
    face["count"], face["index"] = 3, mesh.triangles
    kinds = {"<f8": "double", "<f4": "float"}
    properties = "".join(
        f"property {kinds[record[field].str]} {field}\n" for field in record.names or ()
    )
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"comment {' '.join(name.split())}, B-spline face within {tolerance:g} mm, "
        f"millimetres\nelement vertex {len(vertex)}\n{properties}"
        f"element face {len(face)}\nproperty list uchar int vertex_indices\n"
        "end_header\n"
    )
    content = header.encode("ascii", "replace") + vertex.tobytes() + face.tobytes()
    return write_bytes(path, content)
