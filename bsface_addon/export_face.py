"""Files of a face object, through the core's writers."""

from __future__ import annotations

from pathlib import Path

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


def write_image(path, image):
    """Write a map as a PNG whose top row is the forehead."""
    import numpy as np

    from ..core.drawing.pictures import encode_png
    from ..core.files import write_bytes

    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    # Row 0 of the map is v = 0, the forehead, in Blender at the picture's bottom.
    rgb = pixels.reshape(height, width, 4)[..., :3]
    picture = np.round(np.clip(rgb, 0, 1) * 255).astype(np.uint8)
    return write_bytes(Path(path), encode_png(picture))
