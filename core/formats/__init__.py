"""File formats, one a module, and the table that finds the writer by the ending."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..errors import ReconstructionError
from ..result import Reconstruction
from .face_file import load_face, save_face
from .iges import write_iges
from .mesh import write_mesh_obj, write_mesh_ply
from .obj import write_freeform_obj
from .rhino import write_3dm
from .step import write_step

#: Ending -> (what it is, writer(path, surface, outline_uv, name, ...)). The longest
#: ending that fits counts.
WRITERS: dict[str, tuple[str, Callable[..., Path]]] = {
    ".step": ("STEP, trimmed B-spline surface", write_step),
    ".stp": ("STEP, trimmed B-spline surface", write_step),
    ".igs": ("IGES 128 / 144, trimmed B-spline surface", write_iges),
    ".iges": ("IGES 128 / 144, trimmed B-spline surface", write_iges),
    ".3dm": ("Rhino, B-spline surface and outline curve", write_3dm),
    ".nurbs.obj": ("OBJ, free-form B-spline surface", write_freeform_obj),
    ".obj": ("OBJ, triangle mesh", write_mesh_obj),
    ".ply": ("PLY, triangle mesh", write_mesh_ply),
}

#: Endings whose writers take ``tolerance`` in millimetres.
MESH_ENDINGS = (".obj", ".ply")


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
    trimmed: bool = True,
    tolerance: float = 0.05,
    name: str | None = None,
) -> Path:
    """Write a face in the format of the file's ending.

    Parameters
    ----------
    path : path-like
        One of ``.npz`` and the endings of `WRITERS`.
    face : Reconstruction
        From `reconstruct` or `load`.
    trimmed : bool
        Trim to the face's outline where the format can.
    tolerance : float
        Of mesh formats, mm.
    name : str, optional
        Name of the object in the file; by default the file's own.

    Returns
    -------
    Path

    Raises
    ------
    ReconstructionError
        Unknown ending, missing optional package, or the file cannot be written.
    """
    found = ending(path)
    if not found:
        raise ReconstructionError(
            f"{path}: unknown ending; choose one of {', '.join(['.npz', *WRITERS])}."
        )
    if found == ".npz":
        return save_face(path, face)
    options: dict[str, Any] = {}
    if found in MESH_ENDINGS:
        if not tolerance > 0:
            raise ReconstructionError(
                f"{path}: the tolerance must be a positive length in millimetres, "
                f"not {tolerance:g}."
            )
        options["tolerance"] = tolerance
    return WRITERS[found][1](
        path,
        face.surface,
        face.template.outline_uv if trimmed else None,
        name=name or Path(path).name[: -len(found)] or "face",
        **options,
    )


__all__ = [
    "MESH_ENDINGS",
    "WRITERS",
    "ending",
    "export",
    "load_face",
    "save_face",
    "write_3dm",
    "write_freeform_obj",
    "write_iges",
    "write_mesh_obj",
    "write_mesh_ply",
    "write_step",
]
