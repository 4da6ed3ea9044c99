"""File formats, one a module, and the table that finds the writer by the ending."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from .._types import Array
from ..errors import ReconstructionError, one_line
from ..kinds import expect, expect_paths
from ..result import Reconstruction
from ..rig.head import full_head
from ..rig.mesh import QuadMesh, quad_mesh
from ..texture.head import FLAT, STILL, head_texture
from .exchange import ExchangeCurve
from .face_file import load_face, save_face
from .glb import write_glb
from .iges import write_iges
from .mesh import write_mesh_obj, write_mesh_ply
from .mtl import Source
from .obj import write_freeform_obj
from .options import ExportOptions, Stamp
from .printing import write_3mf, write_stl
from .quad_obj import write_quads_obj
from .rhino import write_3dm
from .solid import solid
from .step import write_step

Writer = Callable[[Path, Reconstruction, ExportOptions], Path]


def _outline(face: Reconstruction, options: ExportOptions) -> Array | None:
    return face.template.outline_uv if options.trimmed else None


def _name(path: Path, options: ExportOptions) -> str:
    # Folders and files may have names that are no text, of which names are made.
    return one_line(options.name or path.name[: -len(ending(path))] or "face")


def _cad(path: Path, face: Reconstruction, options: ExportOptions) -> Path:
    write = write_step if ending(path) in (".step", ".stp") else write_iges
    return write(
        path,
        face.surface,
        _outline(face, options),
        _name(path, options),
        stamp=Stamp(one_line(options.author), options.date),
        curves=options.curves,
    )


def _3dm(path: Path, face: Reconstruction, options: ExportOptions) -> Path:
    outline, name = _outline(face, options), _name(path, options)
    return write_3dm(path, face.surface, outline, name, curves=options.curves)


def _freeform_obj(path: Path, face: Reconstruction, options: ExportOptions) -> Path:
    outline, name = _outline(face, options), _name(path, options)
    return write_freeform_obj(path, face.surface, outline, name)


class TexturedQuads(NamedTuple):
    """A quad mesh with the pictures of its skin.

    Attributes
    ----------
    mesh : QuadMesh
    texture, normals, displacement : path or bytes, or None
        PNG or JPEG pictures over the mesh's ``uv``.
    """

    mesh: QuadMesh
    texture: Source | None
    normals: Source | None
    displacement: Source | None


def textured_quads(face: Reconstruction, options: ExportOptions) -> TexturedQuads:
    """The face or the whole head as quads, with the pictures that the options name."""
    pictures = options.texture, options.normals, options.displacement
    if not options.head:
        mesh = quad_mesh(
            face,
            options.density,
            eyes=options.openings,
            mouth=options.openings,
            keys=options.keys,
        )
        return TexturedQuads(mesh, *pictures)
    mesh = full_head(face, options.density, keys=options.keys)
    laid = (
        None if picture is None else head_texture(picture, face.template, plain)
        for picture, plain in zip(pictures, (None, FLAT, STILL), strict=True)
    )
    return TexturedQuads(mesh, *laid)


def _obj(path: Path, face: Reconstruction, options: ExportOptions) -> Path:
    if options.head:
        # OBJ has no keys.
        made = textured_quads(face, replace(options, keys=False))
        return write_quads_obj(
            path,
            made.mesh,
            _name(path, options),
            texture=made.texture,
            normals=made.normals,
            displacement=made.displacement,
        )
    return write_mesh_obj(
        path,
        face.surface,
        _outline(face, options),
        _name(path, options),
        tolerance=options.tolerance,
        texture=options.texture,
        normals=options.normals,
        displacement=options.displacement,
    )


def _ply(path: Path, face: Reconstruction, options: ExportOptions) -> Path:
    outline, name = _outline(face, options), _name(path, options)
    return write_mesh_ply(path, face.surface, outline, name, options.tolerance)


def _glb(path: Path, face: Reconstruction, options: ExportOptions) -> Path:
    # glTF has no displacement.
    made = textured_quads(face, replace(options, displacement=None))
    return write_glb(path, made.mesh, _name(path, options), made.texture, made.normals)


def _solid(path: Path, face: Reconstruction, options: ExportOptions) -> Path:
    outline = _outline(face, options)
    points, triangles = solid(
        face.surface, outline, options.thickness, options.tolerance
    )
    write = write_stl if ending(path) == ".stl" else write_3mf
    return write(path, points, triangles, _name(path, options))


#: Ending -> (what it is, writer). The longest ending that fits counts.
WRITERS: dict[str, tuple[str, Writer]] = {
    ".step": ("STEP, trimmed B-spline surface", _cad),
    ".stp": ("STEP, trimmed B-spline surface", _cad),
    ".igs": ("IGES 128 / 144, trimmed B-spline surface", _cad),
    ".iges": ("IGES 128 / 144, trimmed B-spline surface", _cad),
    ".3dm": ("Rhino, B-spline surface and outline curve", _3dm),
    ".nurbs.obj": ("OBJ, free-form B-spline surface", _freeform_obj),
    ".obj": ("OBJ, triangle mesh", _obj),
    ".ply": ("PLY, triangle mesh", _ply),
    ".glb": ("glTF, quads with eyes, mouth and the 52 ARKit keys", _glb),
    ".stl": ("STL, closed solid", _solid),
    ".3mf": ("3MF, closed solid", _solid),
}

#: Endings whose writers take ``tolerance`` in millimetres.
MESH_ENDINGS = (".obj", ".ply", ".stl", ".3mf")
#: Endings whose writers can take the whole head.
HEAD_ENDINGS = (".glb", ".obj")
#: Formats that are solids, and those that name an author and a date.
SOLID_ENDINGS, STAMPED_ENDINGS = (".stl", ".3mf"), (".step", ".stp", ".iges", ".igs")
#: Endings whose writers take a texture and a normal map, and a displacement.
TEXTURE_ENDINGS, DISPLACEMENT_ENDINGS = (".glb", ".obj"), (".obj",)


def ending(path: str | os.PathLike) -> str:
    """The longest known ending of a file name, in lower case, or "".

    ``.npz`` counts too: the project's own file.
    """
    name = Path(path).name.lower()
    known = [e for e in (*WRITERS, ".npz") if name.endswith(e)]
    return max(known, key=len, default="")


def export(
    path: str | os.PathLike,
    face: Reconstruction,
    *,
    options: ExportOptions | None = None,
    trimmed: bool | None = None,
    tolerance: float | None = None,
    name: str | None = None,
) -> Path:
    """Write a face in the format of the file's ending.

    Parameters
    ----------
    path : path-like
        One of ``.npz`` and the endings of `WRITERS`.
    face : Reconstruction
        From `reconstruct` or `load`.
    options : ExportOptions, optional
        What else may be chosen.
    trimmed, tolerance, name : optional
        The same fields of ``options``, for short.

    Returns
    -------
    Path

    Raises
    ------
    ReconstructionError
        Unknown ending, unusable option, missing optional package, or the file cannot be
        written.
    """
    expect_paths(path=path)
    expect(Reconstruction, "a Reconstruction", face=face)
    expect(ExportOptions | None, "ExportOptions", options=options)
    found = ending(path)
    if not found:
        raise ReconstructionError(
            f"{path}: unknown ending; choose one of {', '.join(['.npz', *WRITERS])}."
        )
    options = options or ExportOptions()
    if trimmed is not None:
        options = replace(options, trimmed=trimmed)
    if tolerance is not None:
        options = replace(options, tolerance=tolerance)
    if name is not None:
        options = replace(options, name=name)
    options.check(path)
    if found == ".npz":
        return save_face(path, face)
    try:
        return WRITERS[found][1](Path(path), face, options)
    except ValueError as error:
        raise ReconstructionError(f"{path}: {str(error).rstrip('.')}.") from error


__all__ = [
    "DISPLACEMENT_ENDINGS",
    "HEAD_ENDINGS",
    "MESH_ENDINGS",
    "SOLID_ENDINGS",
    "STAMPED_ENDINGS",
    "TEXTURE_ENDINGS",
    "WRITERS",
    "ExchangeCurve",
    "ExportOptions",
    "Stamp",
    "ending",
    "export",
    "load_face",
    "save_face",
    "solid",
    "write_3dm",
    "write_3mf",
    "write_freeform_obj",
    "write_glb",
    "write_iges",
    "write_mesh_obj",
    "write_mesh_ply",
    "write_quads_obj",
    "write_step",
    "write_stl",
]
