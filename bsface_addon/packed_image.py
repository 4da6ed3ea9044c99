"""Pictures in the .blend file, from the content of picture files."""

from __future__ import annotations

import bpy


def packed_image(name: str, data: bytes) -> bpy.types.Image:
    """Keep a picture; Blender reads it when it is first drawn."""
    image = bpy.data.images.new(name, 1, 1)
    image.pack(data=data, data_len=len(data))
    image.source = "FILE"
    return image
