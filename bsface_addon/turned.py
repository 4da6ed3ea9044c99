"""Turned copies of photos: the user's files are never written.

The copies are PNG files (no loss) in the extension's own folder.
"""

from __future__ import annotations

import hashlib
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np

from .. import __package__ as base_package
from ..core._types import Array
from ..core.drawing.pictures import encode_png
from ..core.errors import PhotoFailure, ReconstructionError
from ..core.files import write_bytes
from ..core.images.mask_file import ENDING, encode_mask, with_mask
from ..core.images.photo import Photo
from ..core.images.read import read_photo
from ..core.landmarks.landmarks import (
    LandmarkFileError,
    Landmarks,
    NotLandmarksError,
    landmark_file_beside,
    read_landmarks,
    write_landmarks,
)
from . import skin_pictures


@dataclass(frozen=True)
class PhotoToTurn:
    """A photo and how it shall stand.

    Attributes
    ----------
    name : str
    original : Path
    before, quarters : int
        Quarter turns of the original clockwise, 0 to 3: as it stands, and as it shall.
    folder : Path
        Where the copy goes.
    landmarks : Landmarks or None
        Those that a person gave, in the photo as it stands.
    mask : bytes
        What a person painted over it, the content of a mask file; empty for nothing.
    """

    name: str
    original: Path
    before: int
    quarters: int
    folder: Path
    landmarks: Landmarks | None = None
    mask: bytes = b""


@dataclass(frozen=True)
class TurnedPhoto:
    """A photo as it shall stand, and what a person gave for it."""

    path: Path
    landmarks: Landmarks | None
    mask: bytes


def turn(wanted: PhotoToTurn) -> TurnedPhoto:
    """Make the turned copy; the original itself where it stands upright again.

    Landmark and mask files beside the original are turned beside the copy.
    """
    photo = read_photo(wanted.original, wanted.name)
    if isinstance(photo, PhotoFailure):
        raise ReconstructionError(photo.reason)
    original, quarters = wanted.original, wanted.quarters
    pixels = photo.bytes8()
    path = original
    if quarters:
        key = hashlib.sha1(str(original).encode()).hexdigest()[:8]
        path = wanted.folder / f"{original.stem}-{key}-{90 * quarters}.png"
        upright = np.ascontiguousarray(np.rot90(pixels, -quarters))
        write_bytes(path, encode_png(upright))
        _turn_files(photo, path, quarters)
    landmarks = wanted.landmarks
    if landmarks is not None:
        landmarks = _turned(photo, landmarks, wanted.before, quarters)
    mask = wanted.mask and skin_pictures.turned(wanted.mask, quarters - wanted.before)
    return TurnedPhoto(path, landmarks, mask)


def _turn_files(photo: Photo, copy: Path, quarters: int) -> None:
    """Put turned copies of the files beside a photo beside its turned copy."""
    places = copy.with_suffix(ENDING), copy.with_suffix(".json")
    for path in places:  # of an earlier turn
        path.unlink(missing_ok=True)
    masked = with_mask(photo)
    if isinstance(masked, PhotoFailure):
        raise ReconstructionError(masked.reason)
    if masked.mask is not None:
        write_bytes(places[0], encode_mask(np.rot90(masked.mask, -quarters)))
    path = landmark_file_beside(photo.path)
    if path is None:
        return
    try:
        found = read_landmarks(path, photo.name, photo.size)
        write_landmarks(places[1], _turned(photo, found, 0, quarters))
    except NotLandmarksError:
        return  # the core passes over such files too
    except LandmarkFileError as error:
        raise ReconstructionError(str(error)) from None


def _turned(photo: Photo, known: Landmarks, before: int, quarters: int) -> Landmarks:
    """Landmarks of a photo that stood in one way, as it shall stand."""
    height, width = photo.pixels.shape[:2]
    points = known.points
    if before:
        size = (height, width) if before % 2 else (width, height)
        points = turned_points(points, size, -before)
    else:
        points = photo.to_window(points)  # a copy of a large photo has fewer pixels
    if quarters:
        points = turned_points(points, (width, height), quarters)
    else:
        points = photo.to_original(points)
    return replace(known, points=points)


def turned_points(points: Array, size: tuple[int, int], quarters: int) -> Array:
    """Where points of a picture are after quarter turns clockwise.

    Parameters
    ----------
    points : (f, 2) array
        Pixels; their centres are integers.
    size : (int, int)
        Width and height of the picture before.
    quarters : int
    """
    width, height = size
    for _ in range(quarters % 4):
        points = np.stack([height - 1 - points[:, 1], points[:, 0]], axis=1)
        width, height = height, width
    return points


def folder() -> Path:
    """Where the copies go; a temporary folder when not run as an extension."""
    try:
        return Path(
            bpy.utils.extension_path_user(base_package, path="turned", create=True)
        )
    except ValueError:
        return Path(bpy.app.tempdir or tempfile.gettempdir()) / "bsface-turned"
