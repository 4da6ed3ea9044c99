"""Materials of Wavefront OBJ files, with their pictures beside the file.

Reference: Wavefront Technologies, MTL material format 4.2; ``norm`` is of the format's
extension for physically based rendering (Exocortex).
"""

from __future__ import annotations

import contextlib
import itertools
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ..errors import ReconstructionError
from ..files import write_bytes
from ..images.decode import decode
from ..images.png import plain_png
from ..npz_arrays import open_file

Source = str | os.PathLike | bytes
#: First bytes of the pictures that a material may refer to, and their endings.
SIGNATURES = {b"\x89PNG\r\n\x1a\n": ".png", b"\xff\xd8\xff": ".jpg"}
#: What the names of texture, normal map and displacement end in.
ENDS = ("", "_normal", "_displacement")


def plain_stem(path: Path) -> str:
    """The name of the file without its ending and without spaces.

    Spaces in a file name end the statement in many readers.
    """
    return "_".join(path.stem.split())


def write_pictures(
    path: Path,
    *,
    texture: Source | None = None,
    normals: Source | None = None,
    displacement: Source | None = None,
) -> dict[str, str]:
    """Write the pictures of a skin beside its OBJ file.

    Parameters
    ----------
    path : Path
        The OBJ file.
    texture, normals, displacement : path or bytes, optional
        PNG or JPEG pictures; the names of the last two end in ``_normal`` and
        ``_displacement``.

    Returns
    -------
    dict
        Statement of the material -> name of the file.

    Raises
    ------
    ReconstructionError
        When a picture cannot be read or a file cannot be written.
    """
    wanted = {"map_Kd": texture, "norm": normals, "disp": displacement}
    found = {}
    for end, (statement, source) in zip(ENDS, wanted.items(), strict=True):
        if source is not None:
            content, ending = read_texture(source)
            picture = path.with_name(plain_stem(path) + end + ending)
            found[statement] = write_bytes(picture, content).name
    return found


def lost_picture(
    path: Path, pictures: Sequence[Source | None], *, remade: bool
) -> Path | None:
    """The first of the pictures that would be written over with another content.

    Parameters
    ----------
    path : Path
        The OBJ file.
    pictures : sequence of path, bytes or None
        Texture, normal map and displacement; content in memory cannot be lost.
    remade : bool
        Whether they are changed on the way; otherwise each may stay where it is.
    """
    named = zip(ENDS, pictures, strict=True)
    given = {e: p for e, p in named if p is not None and not isinstance(p, bytes)}
    for end, ending in itertools.product(given, SIGNATURES.values()):
        target = path.with_name(plain_stem(path) + end + ending)
        for other, source in given.items():
            if (remade or other != end) and _same_file(target, source):
                return target
    return None


def _same_file(one: Path, other: str | os.PathLike) -> bool:
    with contextlib.suppress(OSError):  # one of them is not there
        return os.path.samefile(one, other)
    return False


def material(name: str, colour: str, pictures: Mapping[str, str]) -> str:
    """The statements of a material.

    Parameters
    ----------
    name, colour : str
    pictures : mapping
        As of `write_pictures`.
    """
    lines = [f"newmtl {name}", f"Kd {colour}", "Ks 0 0 0", "illum 1"]
    for statement, picture in pictures.items():
        lines.append(f"{statement} {picture}")
        if statement == "norm":
            # What Blender writes and reads in its place.
            lines.append(f"map_Bump -bm 1 {picture}")
    return "\n".join([*lines, ""])


def read_texture(path: str | os.PathLike | bytes) -> tuple[bytes, str]:
    """Content of a PNG or JPEG picture and its ending, ".png" or ".jpg".

    Parameters
    ----------
    path : path-like or bytes
        A file, or its content.

    Raises
    ------
    ReconstructionError
        When it cannot be read or is something else.
    """
    try:
        if isinstance(path, bytes):
            content = path
        else:
            with open_file(path) as file:
                content = file.read()
    except OSError as error:
        raise ReconstructionError(
            f"{path}: the texture cannot be read ({error.strerror}); "
            "give a PNG or JPEG picture."
        ) from None
    for signature, ending in SIGNATURES.items():
        if content.startswith(signature):
            # A damaged one would only fail where the mesh is opened.
            data = np.frombuffer(content, np.uint8)
            whole = plain_png(data) if ending == ".png" else data
            if whole is None or decode(whole, reduction=1) is None:
                raise ReconstructionError(
                    f"{path}: the texture is damaged or cut short; export it again."
                )
            return content, ending
    raise ReconstructionError(
        f"{path}: the texture is no PNG or JPEG picture; convert it."
    )
