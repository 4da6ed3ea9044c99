"""Mask files: what of a photo is skin, painted by hand or by another program.

``001.mask.png`` beside ``001.jpg`` is a grey picture of the photo as it is shown: white
is skin of the face, black is not, and what is half grey stays as it is measured.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from .._types import Array32
from ..errors import PhotoFailure
from .photo import Photo
from .read import read_photo

#: How the name of a mask goes on after the photo's, without its ending.
ENDING = ".mask.png"
#: Longest side of a mask in memory, pixels.
MAX_SIDE = 1024
#: Largest difference of the aspect ratios of mask and photo.
TOLERANCE = 0.02
#: Grey levels, of 0 to 1, about the half within which nothing is said.
SILENT = 0.02


def is_mask(name: str) -> bool:
    """Whether a file is a mask by its name."""
    return name.lower().endswith(ENDING)


def masked(name: str) -> str:
    """The name of a mask's photo without its ending."""
    return name[: -len(ENDING)]


def mask_file_beside(photo: str | os.PathLike) -> Path | None:
    """The mask file of a photo, or None."""
    path = Path(photo).with_suffix(ENDING)
    return path if path.is_file() else None


def with_mask(photo: Photo) -> Photo | PhotoFailure:
    """The photo with the mask that lies beside it, or itself if there is none.

    Returns
    -------
    Photo or PhotoFailure
        A failure, ``"unreadable"``, if the mask is no picture of the photo's shape.
    """
    path = None if photo.path is None else mask_file_beside(photo.path)
    if path is None:
        return photo
    mask = read_mask(path, photo)
    if isinstance(mask, PhotoFailure):
        return mask
    return replace(photo, mask=mask)


def read_mask(path: Path, photo: Photo) -> Array32 | PhotoFailure:
    """A mask file as ``(h, w)`` float32: 1 = skin, 0 = not, 0.5 = nothing is said."""
    found = read_photo(path)
    if isinstance(found, PhotoFailure):
        return replace(found, name=photo.name)
    (w, h), (width, height) = found.size, photo.size
    if abs(np.log(w * height / (h * width))) > TOLERANCE:
        return PhotoFailure(
            photo.name,
            "unreadable",
            f"{path.name} has {w} x {h} pixels and {photo.name} {width} x {height}; "
            "save the mask in the shape of the photo as it is shown.",
        )
    grey = found.bytes8().astype(np.float32).mean(axis=2) / 255
    factor = MAX_SIDE / max(grey.shape)
    if factor < 1:
        small = cv2.resize(
            grey, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA
        )
        grey = np.asarray(small, np.float32)
    return np.where(np.abs(grey - 0.5) < SILENT, np.float32(0.5), grey)
