"""Formats that OpenCV does not read: HEIC, AVIF and JPEG 2000, by optional packages.

``pip install 'bsface[heic]'`` brings them; Blender's extension has them inside. Only
the one plug-in of Pillow that fits the file is used, so that no other format gets in
under a false name.
"""

from __future__ import annotations

import importlib
import io
from types import ModuleType

import cv2
import numpy as np

from .._types import Picture8

# What decoders raise on damaged files: Pillow, libheif, libavif, OpenJPEG.
_DAMAGED = (
    OSError,
    EOFError,
    ValueError,
    SyntaxError,
    RuntimeError,
    AssertionError,
    IndexError,
    KeyError,
    TypeError,
    OverflowError,
)


class MissingPackage(Exception):
    """The package for a format is not installed."""


def decode_optional(data: Picture8, kind: str, reduction: int) -> np.ndarray | None:
    """(h, w, 3) RGB as it is seen, at 1 / `reduction` of its size; None if damaged.

    HEIC of 10 and 12 bits keeps them, in 16. Pillow gives 8 bits of AVIF and of
    coloured JPEG 2000.

    Parameters
    ----------
    data : (n,) uint8 array
    kind : str
        One of `header.OPTIONAL`.
    reduction : 1, 2, 4 or 8

    Raises
    ------
    MissingPackage
    MemoryError
        There is not enough memory for the pixels.
    """
    package, decoder = _DECODERS[kind]
    module = _imported(package)
    try:
        pixels = decoder(module, io.BytesIO(data.data))
    except _DAMAGED:
        return None
    if pixels.dtype not in (np.uint8, np.uint16):
        return None
    if pixels.ndim == 2 or pixels.shape[2] < 3:
        grey = pixels if pixels.ndim == 2 else pixels[..., 0]
        pixels = np.repeat(grey[..., None], 3, axis=2)
    pixels = np.ascontiguousarray(pixels[..., :3])
    if reduction > 1:
        h, w = pixels.shape[:2]
        size = (-(-w // reduction), -(-h // reduction))
        pixels = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
    return pixels


def _imported(name: str) -> ModuleType:
    try:
        module = importlib.import_module(name)
    except ImportError:
        raise MissingPackage(name) from None
    if not getattr(module, "SUPPORTED", True):  # a Pillow built without AVIF
        raise MissingPackage(name)
    return module


def _heic(pi_heif: ModuleType, file: io.BytesIO) -> np.ndarray:
    # libheif turns the picture itself; what EXIF says of turns is done with.
    found = pi_heif.open_heif(file, convert_hdr_to_8bit=False)
    # A copy: the pixels belong to `found` and end with it. Rows may be padded.
    return np.array(found)[:, : found.size[0]]


def _avif(plugin: ModuleType, file: io.BytesIO) -> np.ndarray:
    # libavif does not turn; Pillow hands the turn on as EXIF.
    turned = importlib.import_module("PIL.ImageOps").exif_transpose
    with plugin.AvifImageFile(file) as picture:
        return np.asarray(turned(picture).convert("RGB"))


def _jpeg2000(plugin: ModuleType, file: io.BytesIO) -> np.ndarray:
    with plugin.Jpeg2KImageFile(file) as picture:
        if picture.mode == "I;16":
            return np.asarray(picture).astype(np.uint16)
        return np.asarray(picture.convert("RGB"))


_DECODERS = {
    "HEIC": ("pi_heif", _heic),
    "AVIF": ("PIL.AvifImagePlugin", _avif),
    "JPEG 2000": ("PIL.Jpeg2KImagePlugin", _jpeg2000),
}
