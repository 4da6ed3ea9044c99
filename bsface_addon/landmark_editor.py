"""Landmarks of one photo as a mesh over the picture, moved with Blender's own tools.

The photo that is being edited stands on a stage of its own (`photo_stage`): a camera
with the photo as background, and a mesh with one vertex per landmark in the picture
plane.  Pixel centres are integers, y down, as in the core.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ..core.landmarks.landmarks import Landmarks, write_landmarks
from ..core.surface.template import load_template
from . import cameras, photo_stage

if TYPE_CHECKING:
    from ..core.images.photo import Photo

PHOTO = "bsface_landmarks_of"
SCHEME = "bsface_scheme"
START = "bsface_start"
WEIGHT = "bsface_weight"
# A landmark that moved less than this, in pixels, was not moved by hand.
MOVED_PX = 0.05
# Detected landmarks weigh at most 1; one that a person placed outweighs them.
HAND_WEIGHT = 10.0
# Lines between the 68 points, so that one sees which is which.
CHAINS = (
    (range(0, 17), False),
    (range(17, 22), False),
    (range(22, 27), False),
    (range(27, 31), False),
    (range(31, 36), False),
    (range(36, 42), True),
    (range(42, 48), True),
    (range(48, 60), True),
    (range(60, 68), True),
)


def editor() -> bpy.types.Object | None:
    """The mesh that is being edited, or None."""
    return photo_stage.mesh_with(PHOTO)


def open_editor(
    context: bpy.types.Context, photo: Photo, landmarks: Landmarks
) -> bpy.types.Object:
    """Show the landmarks of a photo over it, ready to be moved.

    Parameters
    ----------
    photo : Photo
        Its name, path and size are used.
    landmarks : Landmarks
    """
    mesh = bpy.data.meshes.new(f"Landmarks {photo.name}")
    obj = bpy.data.objects.new(mesh.name, mesh)
    plane = np.zeros((len(landmarks.points), 3))
    plane[:, :2] = to_plane(landmarks.points, photo.size)
    mesh.from_pydata(plane.tolist(), _edges(landmarks.scheme), [])
    obj.show_in_front = True
    obj[PHOTO], obj[SCHEME] = photo.name, landmarks.scheme
    obj[START] = json.dumps(landmarks.points.tolist())
    obj[WEIGHT] = json.dumps(landmarks.weight.tolist())
    camera = photo_stage.open_stage(context, obj, photo.size)
    cameras.background(camera.data, photo)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="DESELECT")
    context.tool_settings.mesh_select_mode = (True, False, False)
    return obj


def edited(obj):
    """Points and weights as the user left them.

    Returns
    -------
    points : (f, 2) array
        Pixels of the turned photo.
    weight : (f,) array
        `HAND_WEIGHT` for the points that were moved.
    moved : (f,) bool array

    Raises
    ------
    ValueError
        Vertices were added or deleted.
    """
    obj.update_from_editmode()
    start, weight = np.array(json.loads(obj[START])), np.array(json.loads(obj[WEIGHT]))
    if len(obj.data.vertices) != len(start):
        raise ValueError(f"{len(obj.data.vertices)} points instead of {len(start)}")
    plane = np.empty(3 * len(start), np.float32)
    obj.data.vertices.foreach_get("co", plane)
    size = np.array(obj[cameras.SIZE_KEY])
    points = to_pixels(plane.reshape(-1, 3)[:, :2].astype(float), size)
    moved = np.linalg.norm(points - start, axis=1) > MOVED_PX
    return (
        np.where(moved[:, None], points, start),
        np.where(moved, HAND_WEIGHT, weight),
        moved,
    )


def to_plane(points, size):
    """Pixels -> coordinates in the picture plane, (f, 2)."""
    size = np.asarray(size, float)
    return (np.asarray(points) - (size - 1) / 2) * (1, -1) / size.max()


def to_pixels(plane, size):
    """The reverse of `to_plane`."""
    size = np.asarray(size, float)
    return np.asarray(plane) * (1, -1) * size.max() + (size - 1) / 2


def write(path: Path, landmarks: Landmarks) -> None:
    """Write landmarks to a file; ``.pts`` takes the 68 points out of the 468."""
    if path.suffix.lower() == ".pts" and landmarks.scheme == "468":
        landmarks = landmarks.subset("68", _indices_of_68("468"))
    write_landmarks(path, landmarks)


def _indices_of_68(scheme: str) -> Sequence[int] | None:
    """Where the 68 points stand among the landmarks of a scheme, or None."""
    if scheme == "68":
        return range(68)
    return load_template().schemes["68"] if scheme == "468" else None


def _edges(scheme: str) -> list[tuple[int, int]]:
    """The lines between the 68 points, as pairs of landmarks."""
    lines = _indices_of_68(scheme)
    if lines is None:
        return []
    found = []
    for chain, closed in CHAINS:
        ends = list(chain)
        pairs = list(zip(ends, ends[1:], strict=False))
        if closed:
            pairs.append((ends[-1], ends[0]))
        found += [(int(lines[a]), int(lines[b])) for a, b in pairs]
    return found
