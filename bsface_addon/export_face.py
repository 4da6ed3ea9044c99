"""Files of a face, through the core's writers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from ..core.drawing.pictures import encode_png
from ..core.errors import ReconstructionError
from ..core.files import temporary_folder, write_bytes
from ..core.formats import WRITERS, ending, export, textured_quads
from ..core.formats.mtl import read_texture
from ..core.formats.options import ExportOptions
from ..core.report.outputs import check_inputs, files_of
from . import fbx_file, messages
from .face_file import StoredFace


@dataclass(frozen=True)
class FileToWrite:
    """A file, and what is written into it.

    Attributes
    ----------
    path : Path
    face : StoredFace or None
        None for the picture alone.
    options : ExportOptions
    picture : bytes
        Packed file of the map on the surface; empty for none.
    blender : tuple of str
        See `fbx_file.program`; for FBX files.
    detail : bytes
        The same of the normal map.
    photos, read : tuple of Path
        Photos, and other files that are read; none of them is written over.
    """

    path: Path
    face: StoredFace | None
    options: ExportOptions
    picture: bytes = b""
    blender: tuple[str, ...] = ()
    detail: bytes = b""
    photos: tuple[Path, ...] = ()
    read: tuple[Path, ...] = ()


def with_ending(path: str, kind: str) -> str:
    """The path with the ending of a format in place of another format's."""
    found = _ending(path)
    stem = path[: -len(found)] if found else path
    return f"{stem}{kind}"


def write(wanted: FileToWrite) -> Path:
    """Write the file.

    Raises
    ------
    ReconstructionError
        It cannot be written, or is read itself.
    """
    if wanted.face is not None and not _ending(str(wanted.path)):
        kinds = ", ".join([".npz", *WRITERS, fbx_file.ENDING])
        text = messages.UNKNOWN_ENDING.format(path=wanted.path, kinds=kinds)
        raise ReconstructionError(text)
    try:
        check_inputs(files_of(wanted.path), photos=wanted.photos, read=wanted.read)
    except ValueError as error:
        raise ReconstructionError(str(error)) from None
    if wanted.face is None:
        return write_map(wanted.path, wanted.picture)
    with temporary_folder() as folder:
        options = wanted.options
        if wanted.picture:
            texture = write_map(folder / "texture.png", wanted.picture)
            options = replace(options, texture=texture)
        if wanted.detail:
            normals = write_detail(folder / "normal.png", wanted.detail)
            options = replace(options, normals=normals)
        if _ending(str(wanted.path)) == fbx_file.ENDING:
            return _write_fbx(wanted, options)
        return export(wanted.path, wanted.face.read(), options=options)


def _ending(path: str) -> str:
    return fbx_file.ENDING if path.lower().endswith(fbx_file.ENDING) else ending(path)


def _write_fbx(wanted: FileToWrite, options: ExportOptions) -> Path:
    made = textured_quads(wanted.face.read(), options)
    wanted_pictures = {
        fbx_file.TEXTURE: made.texture,
        fbx_file.NORMALS: made.normals,
    }
    pictures = {
        name: read_texture(picture)[0]
        for name, picture in wanted_pictures.items()
        if picture is not None
    }
    return fbx_file.write_fbx(
        wanted.path, made.mesh, options.name, wanted.blender, pictures
    )


def write_detail(path: Path, png: bytes) -> Path:
    """Write the packed normal map for UVs whose v runs up: rows and green turned."""
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
    values = picture[::-1, :, ::-1] / 65535
    values[..., 1] = 1 - values[..., 1]
    # Half a step is rounded up, also where 16 bits have no middle.
    return write_bytes(
        path, encode_png(np.floor(values * 255 + 0.503).astype(np.uint8))
    )


def write_map(path: Path, png: bytes) -> Path:
    """Write the packed file of a map as a PNG whose top row is the forehead."""
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    # Row 0 of a map is v = 0, the forehead, in Blender at the picture's bottom.
    return write_bytes(path, encode_png(picture[::-1, :, ::-1]))
