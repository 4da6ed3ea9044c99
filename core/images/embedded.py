"""The colour space that a picture file names: an ICC profile or a code of ITU-T H.273.

JPEG carries a profile in APP2 segments, PNG in ``iCCP``, WebP in ``ICCP``, TIFF in tag
34675, and HEIF, AVIF and JPEG 2000 in a box ``colr``. Codes stand in ``colr`` too and
in PNG's ``cICP``. Cameras that write Adobe RGB by the DCF rules embed no profile, they
say ``R03`` in EXIF.
"""

from __future__ import annotations

import contextlib
import struct
import zlib

import numpy as np

from .._types import Array, Picture8
from .boxes import inside
from .exif import (
    exif_data,
    exif_directory,
    jpeg_segments,
    png_chunks,
    webp_chunks,
)
from .hdr import hlg_light, pq_light
from .icc import SRGB_CURVE, Curve, ProfileError, RgbProfile, read_profile
from .tiff import directory

_MOST_BYTES = 20_000_000
_TIFF_ICC, _EXIF_INTEROPERABILITY = 34675, 40965
# Primaries of H.273 table 2 -> linear RGB to linear sRGB; all have the white of D65.
_SRGB = np.eye(3)
_CHROMATICITIES = {
    9: ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046)),  # BT.2020
    12: ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060)),  # Display P3
}
_BT709 = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06))
_ADOBE = ((0.64, 0.33), (0.21, 0.71), (0.15, 0.06))
_D65 = (0.3127, 0.3290)
# Transfer characteristics of H.273 table 3 that are read as sRGB's curve: its own,
# "unspecified", and those of standard video, which screens show alike.
_LIKE_SRGB = frozenset((1, 2, 6, 13, 14, 15))
HDR = {16: "PQ", 18: "HLG"}


def embedded_profile(data: Picture8, kind: str) -> RgbProfile | None:
    """The colour space of a picture file; None if it names none or sRGB.

    Parameters
    ----------
    data : (n,) uint8 array
        The file. Any content is allowed.
    kind : str
        ``ImageHeader.format``.

    Raises
    ------
    ProfileError
        It names one that cannot be used.
    """
    view = data.data
    finder = _FINDERS.get(kind)
    if finder is None:
        return None
    try:
        found = finder(view)
    except (struct.error, IndexError, zlib.error, OverflowError):
        return None
    if found is None or isinstance(found, RgbProfile):
        return found
    return read_profile(found)


def coded_profile(primaries: int, transfer: int) -> RgbProfile | None:
    """The colour space of two codes of H.273; None for sRGB.

    Raises
    ------
    ProfileError
        The curve is unknown.
    """
    if transfer in HDR:
        stored = np.linspace(0, 1, 65536)
        light = pq_light if HDR[transfer] == "PQ" else hlg_light
        curve = Curve(light(stored), np.empty(0))
    elif transfer == 8:
        curve = Curve(np.empty(0), np.array([1.0, 1, 0, 0, 0, 0, 0]))
    elif transfer in _LIKE_SRGB:
        curve = SRGB_CURVE
    else:
        raise ProfileError(f"its brightness curve (code {transfer}) is unknown")
    if primaries not in _CHROMATICITIES:
        return None if curve is SRGB_CURVE else RgbProfile((curve,) * 3, _SRGB)
    return RgbProfile((curve,) * 3, _to_srgb(_CHROMATICITIES[primaries]))


def _to_xyz(primaries: tuple[tuple[float, float], ...]) -> Array:
    """Linear RGB of these primaries and white D65 to XYZ (SMPTE RP 177)."""
    columns = np.array([[x / y, 1, (1 - x - y) / y] for x, y in primaries]).T
    x, y = _D65
    white = np.array([x / y, 1, (1 - x - y) / y])
    return columns * np.linalg.solve(columns, white)


def _to_srgb(primaries: tuple[tuple[float, float], ...]) -> Array:
    return np.linalg.solve(_to_xyz(_BT709), _to_xyz(primaries))


def _jpeg(view: memoryview) -> bytes | RgbProfile | None:
    parts = {
        body[12]: bytes(body[14:])
        for marker, body in jpeg_segments(view)
        if marker == 0xE2 and bytes(body[:12]) == b"ICC_PROFILE\0"
    }
    if parts:
        return b"".join(parts[number] for number in sorted(parts))
    if _says_adobe(view):  # its curve is a power of 563/256 (Adobe RGB (1998), 4.3.1.2)
        curve = Curve(np.empty(0), np.array([563 / 256, 1, 0, 0, 0, 0, 0]))
        return RgbProfile((curve,) * 3, _to_srgb(_ADOBE))
    return None


def _says_adobe(view: memoryview) -> bool:
    """Whether EXIF's interoperability index is ``R03``: Adobe RGB by DCF 2.0."""
    with contextlib.suppress(struct.error, IndexError, KeyError):
        exif = exif_data(view, "JPEG")
        if exif is not None:
            more = exif_directory(exif)
            index = directory(exif, more[_EXIF_INTEROPERABILITY].number())
            return bytes(index[1].data[:3]) == b"R03"
    return False


def _png(view: memoryview) -> bytes | RgbProfile | None:
    profile = None
    for name, body in png_chunks(view):
        if name == b"IDAT":
            break
        if name == b"cICP" and len(body) == 4:  # stands above iCCP (PNG 3, 4.3)
            return coded_profile(body[0], body[1])
        if name == b"iCCP":
            end = bytes(body[:80]).index(b"\0") if 0 in body[:80] else 80
            packed = zlib.decompressobj()
            profile = packed.decompress(body[end + 2 :], _MOST_BYTES)
    return profile


def _webp(view: memoryview) -> bytes | None:
    profiles = (body for name, body in webp_chunks(view) if name == b"ICCP")
    found = next(profiles, None)
    return None if found is None else bytes(found)


def _tiff(view: memoryview) -> bytes | None:
    field = directory(view).get(_TIFF_ICC)
    return None if field is None else bytes(field.data)


def _boxed(*path: bytes):
    def find(view: memoryview) -> bytes | RgbProfile | None:
        code = None
        for body in inside(view, *path):
            kind = bytes(body[:4])
            if kind in (b"prof", b"rICC"):
                return bytes(body[4:])
            if kind == b"nclx" and code is None:
                code = struct.unpack(">HH", body[4:8])
            elif body[:1] == b"\2":  # JPEG 2000: method, precedence, approximation
                return bytes(body[3:])
        return None if code is None else coded_profile(*code)

    return find


_FINDERS = {
    "JPEG": _jpeg,
    "PNG": _png,
    "WebP": _webp,
    "TIFF": _tiff,
    "HEIC": _boxed(b"meta", b"iprp", b"ipco", b"colr"),
    "AVIF": _boxed(b"meta", b"iprp", b"ipco", b"colr"),
    "JPEG 2000": _boxed(b"jp2h", b"colr"),
}
