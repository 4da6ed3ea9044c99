"""Small pictures for the rows of the photo list."""

from __future__ import annotations

import bpy.utils.previews

_collection = None


def icon(path):
    """Icon id of a photo; Blender reads the file when the row is first drawn."""
    if _collection is None:
        return 0
    key = str(path)
    if key not in _collection:
        _collection.load(key, key, "IMAGE")
    return _collection[key].icon_id


def register():
    global _collection
    _collection = bpy.utils.previews.new()


def unregister():
    global _collection
    if _collection is not None:
        bpy.utils.previews.remove(_collection)
        _collection = None
