"""The photo list of the panel: rows in, rows out, and what a run said of each."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING

import bpy

from ..core.errors import ReconstructionError
from ..core.images.sources import photo_names
from . import messages
from .packed_image import packed_image
from .stored_facts import landmark_text

if TYPE_CHECKING:
    from .properties import BSFACE_PG_photo, BSFACE_PG_scene

# So many folders and the name are looked for where a project was moved.
DEEPEST = 4


def add(state, paths):
    """Add photos that are not in the list yet; how many were added."""
    present = {absolute(row) for row in state.photos}
    before = len(state.photos)
    for path in paths:
        path = Path(path)
        if path in present:
            continue
        present.add(path)
        row = state.photos.add()
        row.path = str(path)
    rename(state)
    return len(state.photos) - before


def find(state: BSFACE_PG_scene, name: str) -> BSFACE_PG_photo:
    """The row of a photo.

    Raises
    ------
    ReconstructionError
        There is none.
    """
    for row in state.photos:
        if row.name == name:
            return row
    raise ReconstructionError(messages.NO_SUCH_PHOTO.format(name=name))


def activate(state: BSFACE_PG_scene, name: str) -> None:
    """Make a photo's row the active one, without going to its camera."""
    names = [row.name for row in state.photos]
    if name in names:
        _set_active(state, names.index(name))


def _set_active(state: BSFACE_PG_scene, index: int) -> None:
    state.follow = False
    state.active_photo = index
    state.follow = True


def remove(state: BSFACE_PG_scene, index: int) -> None:
    """Take a row off; the active one stays in the list."""
    state.photos.remove(index)
    _set_active(state, min(state.active_photo, max(len(state.photos) - 1, 0)))
    rename(state)


def clear(state: BSFACE_PG_scene) -> None:
    """Empty the list."""
    state.photos.clear()
    _set_active(state, 0)


def replace(state, paths):
    """Make the list that of a run over other photos."""
    state.photos.clear()
    add(state, paths)


def rename(state):
    """Give each row the name that the core will give its photo."""
    names = photo_names(absolute(row).name for row in state.photos)
    for row, name in zip(state.photos, names, strict=True):
        row.name = name


def set_path(state, row, path):
    """Give a row another file; what was known of the old one goes."""
    row.path, row.original, row.quarters = str(path), "", 0
    keep_mask(row, b"")
    forget(row)
    rename(state)


def forget(row):
    """Nothing is known of the row's photo."""
    row.status, row.reason, row.landmarks = "waiting", "", ""
    row.yaw, row.faces = 0.0, 0


def absolute(row):
    """The row's file, whether stored relative to the .blend or not."""
    return moved_along(Path(bpy.path.abspath(row.path)))


def moved_along(path: Path) -> Path:
    """A file, or where it is now if it was moved together with the .blend.

    Looked for are its name and the folders before it, at the .blend and beside the
    folder of the .blend.
    """
    if not bpy.data.filepath or not path.name or os.path.isfile(path):
        return path
    home, parts = Path(bpy.data.filepath).parent, path.parts[1:]
    for base, least in ((home, 1), (home.parent, 2)):
        for count in range(min(len(parts), DEEPEST), least - 1, -1):
            now = base.joinpath(*parts[-count:])
            if os.path.isfile(now):
                return now
    return path


def original(row):
    """The file that the row's photo is, or was before it was turned."""
    if not row.original:
        return absolute(row)
    return moved_along(Path(bpy.path.abspath(row.original)))


def files(row):
    """The row's file, and the one that it was turned from."""
    return dict.fromkeys((absolute(row), original(row)))


def paths(state):
    """Files of all rows, in the list's order."""
    return tuple(absolute(row) for row in state.photos)


def ignored(state):
    """Names of the rows that do not make the neutral face: unticked or expressive."""
    return tuple(row.name for row in state.photos if not row.use or row.expression)


def take_reports(state, reports):
    """Write status, reason and pose of a run's report into the rows."""
    rows = {row.name: row for row in state.photos}
    for report in reports:
        row = rows.get(report.name)
        if row is None:
            continue
        row.status, row.reason = report.status, report.reason
        row.yaw = report.yaw if report.yaw == report.yaw else 0.0  # NaN: not used


def landmarks(row):
    """The row's core Landmarks, or None; a damaged text holds none."""
    import numpy as np

    from ..core.landmarks.landmarks import Landmarks

    if not row.landmarks:
        return None
    try:
        stored = json.loads(row.landmarks)
        stored["points"] = np.array(stored["points"], float)
        stored["weight"] = np.array(stored["weight"], float)
        return Landmarks(photo=row.name, **stored)
    except (KeyError, TypeError, ValueError, RecursionError):
        return None


def keep_landmarks(row, found):
    """Store core Landmarks with the row."""
    row.landmarks, row.faces = landmark_text(found), found.faces


def known_landmarks(state):
    """Photo name -> core Landmarks of all rows that have some."""
    found = {row.name: landmarks(row) for row in state.photos}
    return {name: known for name, known in found.items() if known is not None}


def keep_mask(row: BSFACE_PG_photo, painted: bytes) -> None:
    """Store the mask that a person painted, the content of a mask file; empty: none."""
    old = row.mask
    row.mask = packed_image(f"{row.name} mask", painted) if painted else None
    if old is not None and old.users == 0:
        bpy.data.images.remove(old)


def mask(row: BSFACE_PG_photo) -> bytes:
    """The mask that a person painted, as the content of a mask file; empty: none."""
    packed = None if row.mask is None else row.mask.packed_file
    return b"" if packed is None else packed.data


def known_masks(state: BSFACE_PG_scene) -> dict[str, bytes]:
    """Photo name -> painted mask of all rows that have one."""
    return {row.name: mask(row) for row in state.photos if row.mask is not None}


def take_landmarks(state, found, texts):
    """Store the landmarks of a detection or a run in the rows.

    Parameters
    ----------
    found : sequence of Landmarks
    texts : mapping of photo name to str
        See `stored_facts.landmark_text`.
    """
    rows = {row.name: row for row in state.photos}
    for item in found:
        if item.photo in rows:
            row = rows[item.photo]
            row.landmarks, row.faces = texts[item.photo], item.faces


def take_found(state, found):
    """Mark the rows in which a face was found."""
    names = {item.photo for item in found}
    for row in state.photos:
        if row.name in names:
            row.status, row.reason = "found", ""


def take_failures(state, failures):
    """Write the failures of a detection into the rows."""
    rows = {row.name: row for row in state.photos}
    for failure in failures:
        if failure.name in rows:
            rows[failure.name].status = failure.code
            rows[failure.name].reason = failure.reason


def counts(state):
    """How many rows there are, are ticked, have failed, and shape the face."""
    rows = [row for row in state.photos if row.use]
    return {
        "all": len(state.photos),
        "use": len(rows),
        "failed": sum(row.status not in messages.FINE for row in rows),
        "used": sum(row.status == "used" for row in rows),
    }
