"""The photos that shaped a face, and the face that photos belong to."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import bpy

from ..core.errors import ReconstructionError
from . import messages, photo_list, scene
from .stored_facts import PHOTOS


def files(face: bpy.types.Object) -> tuple[Path, ...]:
    """Files of the photos that shaped a face, as far as they are still there.

    Raises
    ------
    ReconstructionError
        None is.
    """
    found = tuple(path for path in _named(face) if os.path.isfile(path))
    if not found:
        folder = next((str(path.parent) for path in _named(face)), "their folder")
        text = messages.NO_SUCH_FILES.format(name=face.name, folder=folder)
        raise ReconstructionError(text)
    return found


def all_files(face: bpy.types.Object) -> tuple[Path, ...]:
    """Photos that nothing may be written over: of the face, and of all lists."""
    rows = [row for one in bpy.data.scenes for row in one.bsface.photos]
    listed = [path for row in rows for path in photo_list.files(row)]
    return tuple(dict.fromkeys([*_named(face), *listed]))


def owner(
    context: bpy.types.Context, face: bpy.types.Object, photos: Iterable[Path]
) -> bpy.types.Object:
    """The face that photos have shaped: another one than ``face`` where none of them
    is of ``face``, and some are of the other one."""
    wanted = set(photos)
    for one in (face, *scene.faces(context)):
        if not wanted.isdisjoint(_named(one)):
            return one
    return face


def _named(face: bpy.types.Object) -> tuple[Path, ...]:
    rows = [row for row in scene.stored(face, PHOTOS, []) if isinstance(row, dict)]
    names = [row["path"] for row in rows if isinstance(row.get("path"), str)]
    return tuple(photo_list.moved_along(Path(name)) for name in names if name)
