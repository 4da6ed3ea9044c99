"""Files of a face object, through the core's writers."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from ..core.drawing.pictures import encode_png
from ..core.files import write_bytes
from . import face_file


def with_ending(path, kind):
    """The path with the ending of a format in place of another format's."""
    from ..core.formats import ending

    found = ending(path)
    stem = path[: -len(found)] if found else path
    return f"{stem}{kind}"


def write(path, face, trimmed=True, tolerance=0.05):
    """Write a face in the format of the path's ending; see core ``export``."""
    from ..core.formats import export

    saved = face_file.saved(face)
    return export(path, saved, trimmed=trimmed, tolerance=tolerance, name=face.name)


def write_map(path: Path, png: bytes) -> Path:
    """Write the packed file of a map as a PNG whose top row is the forehead."""
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    # Row 0 of a map is v = 0, the forehead, in Blender at the picture's bottom.
    return write_bytes(path, encode_png(picture[::-1, :, ::-1]))
