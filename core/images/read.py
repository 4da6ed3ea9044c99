"""A picture file or an array to a `Photo`, or to the sentence that says why not.

The header is judged before anything is decoded (`header`): that is what keeps a
decompression bomb out.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from .._types import Array32, Picture8
from ..errors import PhotoFailure
from .codecs import MissingPackage, decode_optional
from .convert import to_srgb
from .decode import (
    LIMITS,
    MIN_SIDE,
    RAW_ENDINGS,
    Limits,
    damaged,
    decode,
    decode_alpha,
    file_bytes,
    judge_header,
)
from .embedded import embedded_profile
from .focal_length import focal_length_px
from .header import OPTIONAL, ImageHeader, read_header
from .icc import ProfileError
from .photo import Photo
from .png import plain_png


def read_photo(
    source: str | os.PathLike | np.ndarray,
    name: str | None = None,
    limits: Limits = LIMITS,
) -> Photo | PhotoFailure:
    """One picture, turned upright by its EXIF tag, as three RGB channels.

    Alpha is dropped, grey is repeated, CMYK and palettes are converted, of an
    animation the first frame is taken. Pictures above 16 megapixels are decoded
    at a half, a quarter or an eighth.

    Parameters
    ----------
    source : path or (H, W), (H, W, 3) or (H, W, 4) array
        An array is RGB, sRGB-encoded: uint8, uint16, or floats in [0, 1].
    name : str, optional
        The name in reports; by default the file's own.
    limits : Limits, optional

    Returns
    -------
    Photo or PhotoFailure
        A failure has the code ``"unreadable"`` or ``"too_large"``.
    """
    if isinstance(source, np.ndarray):
        return _from_array(source, name or "picture", limits)
    path = Path(source)
    name = name or path.name
    data = file_bytes(path, name, limits)
    if isinstance(data, PhotoFailure):
        return data
    header = read_header(data)
    raw = path.suffix.lower() in RAW_ENDINGS
    if raw and (header is None or header.format == "TIFF"):
        return PhotoFailure(
            name,
            "unreadable",
            f"{name} is a raw photo, which cannot be read here; develop it and export "
            "it as JPEG, PNG or TIFF.",
        )
    failure = judge_header(header, name, limits)
    if failure is not None:
        return failure
    assert header is not None
    reduction = limits.reduction(header.pixels)
    try:
        pixels = _pixels(data, header.format, reduction)
    except MissingPackage:
        return PhotoFailure(
            name,
            "unreadable",
            f"{name} is a picture of the format {header.format}, which needs optional "
            "packages; run `pip install 'bsface[heic]'`, or export it as JPEG or PNG.",
        )
    if pixels is None:
        return damaged(name)
    note = ""
    try:
        profile = embedded_profile(data, header.format)
    except ProfileError as error:
        note = f"read as sRGB: {error}"
    else:
        pixels = pixels if profile is None else to_srgb(pixels, profile)
    size = _original_size(header, pixels.shape, reduction)
    return Photo(
        name,
        path,
        size,
        pixels,
        (0.0, 0.0, 1.0 / reduction),
        note,
        focal_px=focal_length_px(data, header.format, size),
    )


def read_opacity(path: Path) -> Array32 | None:
    """(h, w) alpha channel of a picture that `read_photo` reads; None without one.

    0 is transparent, 1 is not. It is not turned, and that of HEIC, AVIF and JPEG 2000
    is not looked for.
    """
    data = file_bytes(path, path.name)
    header = None if isinstance(data, PhotoFailure) else read_header(data)
    if isinstance(data, PhotoFailure) or header is None or header.format in OPTIONAL:
        return None
    return decode_alpha(data if header.format != "PNG" else plain_png(data))


def _pixels(data: Picture8, kind: str, reduction: int) -> np.ndarray | None:
    if kind in OPTIONAL:
        return decode_optional(data, kind, reduction)
    whole = plain_png(data) if kind == "PNG" else data
    return None if whole is None else decode(whole, reduction)


def _original_size(
    header: ImageHeader, shape: tuple[int, ...], reduction: int
) -> tuple[int, int]:
    """Width and height of the turned original; the header's are of the unturned.

    A HEIF picture may also be cut by its own box, of which the header says nothing.
    """
    shown = (shape[1], shape[0])
    for size in ((header.width, header.height), (header.height, header.width)):
        if shown == _reduced(*size, reduction):
            return size
    return shown[0] * reduction, shown[1] * reduction


def _reduced(width: int, height: int, reduction: int) -> tuple[int, int]:
    return -(-width // reduction), -(-height // reduction)


def _from_array(array: np.ndarray, name: str, limits: Limits) -> Photo | PhotoFailure:
    def bad(what: str) -> PhotoFailure:
        return PhotoFailure(
            name,
            "unreadable",
            f"{name} {what}; give an (H, W, 3) array of uint8, uint16 or of "
            "floats in [0, 1].",
        )

    array = np.asarray(array)  # a matrix cannot have three axes
    if array.ndim == 2:
        array = array[..., None]
    if array.ndim != 3 or array.shape[2] not in (1, 3, 4):
        return bad(f"has the shape {array.shape}")
    if min(array.shape[:2]) < MIN_SIDE:
        return bad(f"has only {array.shape[1]} x {array.shape[0]} pixels")
    if array.shape[0] * array.shape[1] > limits.pixels:
        return PhotoFailure(
            name,
            "too_large",
            f"{name} has {array.shape[1]} x {array.shape[0]} pixels, more than "
            f"{limits.pixels // 10**6} megapixels; make it smaller.",
        )
    if np.issubdtype(array.dtype, np.floating):
        if not np.isfinite(array).all():
            return bad("holds values that are not finite")
        if array.min() < 0 or array.max() > 1:
            return bad("holds floats outside [0, 1]")
        array = np.round(array * 65535).astype(np.uint16)
    array = array.astype(array.dtype.newbyteorder("="), copy=False)
    if array.dtype not in (np.uint8, np.uint16):
        return bad(f"holds {array.dtype} values")
    array = array[..., :3] if array.shape[2] >= 3 else np.repeat(array, 3, 2)
    h, w = array.shape[:2]
    return Photo(name, None, (w, h), np.ascontiguousarray(array))
