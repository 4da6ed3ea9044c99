"""Pictures in the .blend file, from the content of picture files."""

from __future__ import annotations

import bpy
import numpy as np

from ..core._types import Array32


def packed_image(name: str, data: bytes) -> bpy.types.Image:
    """Keep a picture; Blender reads it when it is first drawn."""
    image = bpy.data.images.new(name, 1, 1)
    image.pack(data=data, data_len=len(data))
    image.source = "FILE"
    return image


def pixels_of(image: bpy.types.Image) -> Array32:
    """What a picture shows, with what was painted on it, ``(h, w, 4)`` from the top."""
    width, height = image.size
    pixels = np.empty(4 * width * height, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(height, width, 4)[::-1]
