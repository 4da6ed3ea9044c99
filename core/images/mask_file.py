"""Mask files: what of a photo is skin, painted by hand or by another program.

``001.mask.png`` beside ``001.jpg`` is a grey picture of the photo as it is shown: white
is skin of the face, black is not, and what is half grey stays as it is measured. So
does what is transparent: there nothing was painted.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from .._types import Array, Array32
from ..errors import PhotoFailure
from ..files import file_beside
from .photo import Photo
from .read import read_opacity, read_photo

#: How the name of a mask goes on after the photo's, without its ending.
ENDING = ".mask.png"
#: Longest side of a mask in memory, pixels.
MAX_SIDE = 1024
#: Largest difference of the aspect ratios of mask and photo.
TOLERANCE = 0.02
#: Levels between the channels of a pixel from which on it has a colour, and the part of
#: such pixels from which on a picture is no mask. JPEG leaves a few levels.
COLOURED, COLOURED_PART = 64, 0.01
#: Grey levels, of 0 to 1, about the half within which nothing is said, and about black.
SILENT = 0.02


def is_mask(name: str) -> bool:
    """Whether a file is a mask by its name."""
    return name.lower().endswith(ENDING)


def masked(name: str) -> str:
    """The name of a mask's photo without its ending."""
    return name[: -len(ENDING)]


def mask_file_beside(photo: str | os.PathLike) -> Path | None:
    """The mask file of a photo, or None; its ending may be in capitals."""
    return file_beside(photo, ENDING)


def with_mask(photo: Photo, given: Array32 | None = None) -> Photo | PhotoFailure:
    """The photo with its mask, or itself if there is none.

    Parameters
    ----------
    photo : Photo
    given : (h, w) float32 array, optional
        The mask, see `read_mask`; by default that of the file beside the photo.

    Returns
    -------
    Photo or PhotoFailure
        A failure, ``"unreadable"``, if the mask is no picture of the photo's shape.
    """
    if given is not None:
        failure = _of_same_shape(given, photo, f"The mask of {photo.name}")
        return replace(photo, mask=given) if failure is None else failure
    path = None if photo.path is None else mask_file_beside(photo.path)
    if path is None:
        return photo
    mask = read_mask(path, photo)
    if isinstance(mask, PhotoFailure):
        return mask
    return replace(photo, mask=mask)


def read_mask(path: Path, photo: Photo) -> Array32 | PhotoFailure:
    """A mask file as ``(h, w)`` float32: 1 = skin, 0 = not, 0.5 = nothing is said."""

    def unusable(what: str) -> PhotoFailure:
        return PhotoFailure(photo.name, "unreadable", f"{path.name} is {what}")

    found = read_photo(path)
    if isinstance(found, PhotoFailure):
        return replace(found, name=photo.name)
    pixels = found.bytes8()
    opacity = read_opacity(path)
    if opacity is None:
        opacity = np.ones(pixels.shape[:2], np.float32)
    elif opacity.shape != found.size[::-1]:
        return unusable("transparent in parts and turned by a tag; save it upright.")
    else:
        size = (pixels.shape[1], pixels.shape[0])
        reduced = cv2.resize(opacity, size, interpolation=cv2.INTER_AREA)
        opacity = np.asarray(reduced, np.float32)
    coloured = np.ptp(pixels, axis=2) * opacity > COLOURED
    if coloured.mean() > COLOURED_PART:
        return unusable("coloured; a mask is grey: white is skin, black is not.")
    grey = pixels.astype(np.float32).mean(axis=2) / 255
    grey = opacity * grey + (1 - opacity) * np.float32(0.5)
    failure = _of_same_shape(grey, photo, path.name)
    if failure is not None:
        return failure
    factor = MAX_SIDE / max(grey.shape)
    if factor < 1:
        small = cv2.resize(
            grey, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA
        )
        grey = np.asarray(small, np.float32)
    return _silenced(grey)


def judge_mask(photo: Photo, points: Array) -> PhotoFailure | None:
    """A failure, ``"unreadable"``, if the mask takes the whole face away, or None.

    Parameters
    ----------
    photo : Photo
    points : (f, 2) array
        Landmarks of the face, pixels of the original.
    """
    if photo.mask is None:
        return None
    size = np.array(photo.size)
    inside = points[((points >= 0) & (points < size)).all(axis=1)]
    height, width = photo.mask.shape
    x, y = (inside * (width, height) / size).astype(int).T
    if (photo.mask[y, x] > SILENT).any():
        return None
    return PhotoFailure(
        photo.name,
        "unreadable",
        f"The mask of {photo.name} is black all over the face; paint its skin white, "
        "or remove the mask.",
    )


def given_masks(masks: object) -> dict[str, Array32]:
    """The masks that a caller gave, checked, by the names of their photos.

    Raises
    ------
    TypeError, ValueError
        They are no mapping of names to (h, w) arrays of numbers from 0 to 1.
    """
    if not isinstance(masks, Mapping):
        raise TypeError(
            f"masks must map photo names to (h, w) arrays, not {type(masks).__name__}."
        )
    for name, mask in masks.items():
        numbers = isinstance(mask, np.ndarray) and mask.dtype.kind in "bfiu"
        fits = numbers and mask.ndim == 2 and mask.size > 0
        if not fits or not ((mask >= 0) & (mask <= 1)).all():
            raise ValueError(
                f"The mask of {name!r} must be an (h, w) array of numbers from 0 (not "
                "skin) to 1 (skin)."
            )
    return {name: mask.astype(np.float32, copy=False) for name, mask in masks.items()}


def encode_mask(mask: Array32) -> bytes:
    """The content of a mask file; 0.5 becomes the grey that says nothing."""
    grey = np.round(np.clip(mask, 0, 1) * 255).astype(np.uint8)
    return cv2.imencode(".png", grey)[1].tobytes()


def decode_mask(data: bytes) -> Array32:
    """The mask that `encode_mask` made bytes of."""
    grey = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    return _silenced(grey.astype(np.float32) / 255)


def _silenced(grey: Array32) -> Array32:
    return np.where(np.abs(grey - 0.5) < SILENT, np.float32(0.5), grey)


def _of_same_shape(mask: Array32, photo: Photo, name: str) -> PhotoFailure | None:
    (h, w), (width, height) = mask.shape, photo.size
    if abs(np.log(w * height / (h * width))) <= TOLERANCE:
        return None
    return PhotoFailure(
        photo.name,
        "unreadable",
        f"{name} has {w} x {h} pixels and {photo.name} {width} x {height}; "
        "save the mask in the shape of the photo as it is shown.",
    )
