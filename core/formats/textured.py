"""The texture of a face for the formats that take one, and the files it ends in."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from ..files import temporary_folder
from ..result import Reconstruction
from ..texture.bake import bake_texture, write_texture
from ..texture.detail import write_displacement, write_normals
from . import TEXTURE_ENDINGS, ending
from .options import ExportOptions


@contextlib.contextmanager
def textured(
    face: Reconstruction, outputs: Sequence[str | os.PathLike]
) -> Iterator[ExportOptions]:
    """Options of an export; with texture, normal map and displacement where needed.

    Parameters
    ----------
    face : Reconstruction
        A face without the pixels of its photos has no texture.
    outputs : sequence of path-like
        Whose endings say whether any takes a texture.

    Yields
    ------
    ExportOptions
        Its pictures are temporary files, which go with the context.
    """
    wanted = any(ending(name) in TEXTURE_ENDINGS for name in outputs)
    if not wanted or not face.has_pixels:
        yield ExportOptions()
        return
    with temporary_folder() as folder:
        names = ("texture.png", "normal.png", "displacement.png")
        skin, normals, displacement = (folder / name for name in names)
        texture = bake_texture(face)
        write_texture(skin, texture.mean)
        if texture.detail is None:
            yield ExportOptions(texture=skin)
            return
        write_normals(normals, texture.detail)
        write_displacement(displacement, texture.detail)
        yield ExportOptions(texture=skin, normals=normals, displacement=displacement)


def exported_files(path: str | os.PathLike) -> tuple[Path, ...]:
    """The file of an export, and those beside it that it refers to.

    Parameters
    ----------
    path : path-like
        What `export` returned; an OBJ file may have a material and pictures.
    """
    path = Path(path)
    if ending(path) != ".obj":
        return (path,)
    with path.open(encoding="utf-8") as lines:
        # The library is named before the first vertex.
        head = [line.split() for _, line in zip(range(3), lines, strict=False)]
    found = [path]
    for library in (words[1] for words in head if words[0] == "mtllib"):
        found.append(path.with_name(library))
        text = found[-1].read_text("utf-8")
        named = [words for words in map(str.split, text.splitlines()) if len(words) > 1]
        pictures = [w[-1] for w in named if w[0].startswith(("map_", "norm", "disp"))]
        found += [path.with_name(name) for name in dict.fromkeys(pictures)]
    return tuple(found)
