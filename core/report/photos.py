"""Thumbnails for the report: photos with their landmarks, detected and reprojected."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from ..drawing.pictures import encode_jpeg
from ..images.photo import Photo, cut
from ..photometry.skin import SkinMask, overlay
from ..result import Reconstruction
from ..surface.template import Template

Picture = npt.NDArray[np.uint8]

SIDE = 300
SKIN_SIDE = 160
_DETECTED = (64, 224, 120)
_PROJECTED = (255, 70, 160)
_LINES_OF_68 = (
    range(0, 17),
    range(17, 22),
    range(22, 27),
    range(27, 31),
    range(31, 36),
    (*range(36, 42), 36),
    (*range(42, 48), 42),
    (*range(48, 60), 48),
    (*range(60, 68), 60),
)


def thumbnail(reconstruction: Reconstruction, index: int, side: int = SIDE) -> Picture:
    """A used photo with detected (green) and reprojected (magenta) landmarks.

    Parameters
    ----------
    reconstruction : Reconstruction
    index : int
        Of the used photo.
    side : int
        Longer side in pixels.

    Returns
    -------
    (h, w, 3) uint8 array
    """
    photo = reconstruction.photos[index]
    marks = reconstruction.landmarks[index]
    camera = reconstruction.cameras[index]
    template = reconstruction.template
    picture = np.ascontiguousarray(photo.bytes8())
    scale = side / max(picture.shape[:2])
    size = (round(picture.shape[1] * scale), round(picture.shape[0] * scale))
    kind = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    picture = np.asarray(cv2.resize(picture, size, interpolation=kind), np.uint8)

    indices = template.schemes.get(marks.scheme)
    known = np.asarray(marks.weight) > 0
    detected = photo.to_window(marks.points) * scale
    if indices is not None and len(indices) == len(marks.points):
        uv = np.asarray(template.landmark_uv)[indices]
        drawn = camera.project(reconstruction.surface.evaluate(uv[:, 0], uv[:, 1]))
        projected = photo.to_window(drawn) * scale
        # A handful of well-known points says more than 468 dots.
        chosen = _chosen(template, marks.scheme)
        if chosen is not None:
            _polylines(picture, projected[chosen], _PROJECTED)
            for a, b in zip(detected[chosen], projected[chosen], strict=True):
                _line(picture, a, b, _DETECTED)
            _dots(picture, detected[chosen][known[chosen]], _DETECTED)
            return picture
        _dots(picture, projected[known], _PROJECTED)
    _dots(picture, detected[known], _DETECTED)
    return picture


def _chosen(template: Template, scheme: str) -> npt.NDArray[np.int64] | None:
    """Positions of the 68 iBUG points within a scheme's points, or None."""
    if scheme == "68":
        return np.arange(68)
    if scheme == "468":
        return template.schemes["68"]
    return None


def _polylines(picture: Picture, points: npt.NDArray, colour: Sequence[int]) -> None:
    for line in _LINES_OF_68:
        at = np.round(points[list(line)] * 16).astype(np.int32)
        cv2.polylines(picture, [at], False, colour, 1, cv2.LINE_AA, shift=4)


def _line(
    picture: Picture, a: npt.NDArray, b: npt.NDArray, colour: Sequence[int]
) -> None:
    first, second = (tuple(int(round(c * 16)) for c in p) for p in (a, b))
    cv2.line(picture, first, second, colour, 1, cv2.LINE_AA, shift=4)


def _dots(picture: Picture, points: npt.NDArray, colour: Sequence[int]) -> None:
    radius = max(12, round(26 * max(picture.shape[:2]) / SIDE))
    for x, y in np.round(points * 16).astype(int).tolist():
        cv2.circle(picture, (x, y), radius, colour, -1, cv2.LINE_AA, shift=4)


def thumbnails(reconstruction: Reconstruction) -> dict[str, bytes]:
    """JPEG bytes of all used photos by name; none of a face that was loaded."""
    if not reconstruction.has_pixels:
        return {}
    return {
        photo.name: encode_jpeg(thumbnail(reconstruction, index), 82)
        for index, photo in enumerate(reconstruction.photos)
    }


def skin_pictures(
    photos: Sequence[Photo], masks: Sequence[SkinMask], side: int = SKIN_SIDE
) -> dict[str, bytes]:
    """JPEG bytes of all used photos by name, tinted where they are not skin."""
    found = {}
    for photo, mask in zip(photos, masks, strict=True):
        small = cut(photo, (0, 0, *photo.size), side)
        found[photo.name] = encode_jpeg(overlay(small, mask), 80)
    return found


def contact_sheet(reconstruction: Reconstruction, columns: int, width: int) -> Picture:
    """All used photos in rows of equal squares, on white."""
    cell = width // columns
    count = len(reconstruction.photos)
    rows = -(-count // columns)
    sheet = np.full((rows * cell, width, 3), 255, np.uint8)
    for index in range(count):
        picture = thumbnail(reconstruction, index, cell - 6)
        height, wide = picture.shape[:2]
        top = index // columns * cell + (cell - height) // 2
        left = index % columns * cell + (cell - wide) // 2
        sheet[top : top + height, left : left + wide] = picture
    return sheet
