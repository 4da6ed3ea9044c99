"""The colours of a video: what its file says of them, and its frames as sRGB.

OpenCV gives eight bits per channel and does not say which colours they mean. With
FFmpeg 8 (OpenCV 4.13 and later) frames are what a screen of standard range shows:
primaries of BT.709, a power of 2.4, white at 203 cd/m2. Before, YCbCr becomes RGB by
the matrix of BT.601 in every video, and the rest is left as it is stored. A clip of one
frame tells which of the two it is.
"""

from __future__ import annotations

import base64
import contextlib
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from .._types import Array, Picture, Picture8
from ..files import temporary_folder
from .boxes import boxes, inside
from .capture import opened
from .colour import to_picture
from .convert import to_srgb
from .ebml import below, elements
from .embedded import HDR, coded_profile
from .hdr import hlg_scene
from .icc import Curve, RgbProfile

Convert = Callable[[Picture8], Picture]

UNSPECIFIED = 2  # in all three tables of H.273
# Matroska: Segment, Tracks, TrackEntry, Video, Colour; and what is read of it.
_COLOUR = (0x18538067, 0x1654AE6B, 0xAE, 0xE0, 0x55B0)
_PRIMARIES, _TRANSFER, _MATRIX = 0x55BB, 0x55BA, 0x55B1
# Matrix coefficients (H.273, table 4): weights of red and blue in luma.
_LUMA = {1: (0.2126, 0.0722), 9: (0.2627, 0.0593)}
_BT601 = (0.299, 0.114)
_POWER = Curve(np.empty(0), np.array([2.4, 1, 0, 0, 0, 0, 0]))
_SCREEN = RgbProfile((_POWER,) * 3, np.eye(3))
# Rows are converted in pieces of so many pixels, which keeps the floats small.
_PIECE = 1_000_000


@dataclass(frozen=True)
class VideoColour:
    """Codes of ITU-T H.273.

    Parameters
    ----------
    primaries, transfer, matrix : int
        Tables 2, 3 and 4 there; 2 means that nothing is said.
    """

    primaries: int = UNSPECIFIED
    transfer: int = UNSPECIFIED
    matrix: int = UNSPECIFIED


def read_colour(path: Path) -> VideoColour:
    """What a video file says of its colours: MP4 and MOV, Matroska and WebM.

    What stands inside the stream only, and not in the file about it, is not found.
    """
    with contextlib.suppress(OSError, ValueError, struct.error, IndexError):
        # Mapped, not read: the pictures lie between what is looked at.
        data = np.memmap(path, np.uint8, "r").data
        matroska = data[:4] == b"\x1a\x45\xdf\xa3"
        return _of_matroska(data) if matroska else _of_boxes(data)
    return VideoColour()


def _of_boxes(data: memoryview) -> VideoColour:
    for samples in inside(data, b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stsd"):
        for _, sample in boxes(samples[8:]):
            for kind, body in boxes(sample[78:]):  # after VisualSampleEntry
                if kind == b"colr" and bytes(body[:4]) in (b"nclx", b"nclc"):
                    return VideoColour(*struct.unpack(">HHH", body[4:10]))
    return VideoColour()


def _of_matroska(data: memoryview) -> VideoColour:
    for colour in below(data, *_COLOUR):
        said = {
            name: int.from_bytes(value[:8], "big") for name, value in elements(colour)
        }
        wanted = (_PRIMARIES, _TRANSFER, _MATRIX)
        return VideoColour(*(said.get(name, UNSPECIFIED) for name in wanted))
    return VideoColour()


def frame_converter(colour: VideoColour, converted: bool | None = None) -> Convert:
    """What makes sRGB of OpenCV's frames, (h, w, 3) RGB.

    Parameters
    ----------
    colour : VideoColour
    converted : bool, optional
        Whether OpenCV converts colours itself; by default it is tried out.

    Raises
    ------
    ProfileError
        The brightness curve is unknown.
    """
    profile = coded_profile(colour.primaries, colour.transfer)
    luma = _LUMA.get(colour.matrix)
    if profile is None and luma is None:
        return unchanged
    if opencv_converts() if converted is None else converted:
        if colour.transfer not in HDR:
            return unchanged
        return _hlg_of_screen if HDR[colour.transfer] == "HLG" else _of_screen
    change = None if luma is None else _ycbcr_to_rgb(*luma) @ _rgb_to_ycbcr(*_BT601)

    def convert(rgb: Picture8) -> Picture:
        stored: Picture = rgb
        if change is not None and profile is None:
            return cv2.transform(rgb, change).astype(np.uint8, copy=False)
        if change is not None:
            stored = cv2.transform(rgb.astype(np.uint16) * 257, change).astype(
                np.uint16, copy=False
            )
        return stored if profile is None else to_srgb(stored, profile)

    return convert


@lru_cache(maxsize=1)
def opencv_converts() -> bool:
    """Whether OpenCV's frames are of BT.709 already: tried with a clip of one frame.

    The clip is grey of the level 200 and says that it is HLG; as a screen of standard
    range shows it, it is nearly white.
    """
    with temporary_folder() as folder:
        path = folder / "grey.mp4"
        path.write_bytes(zlib.decompress(base64.b85decode("".join(_GREY))))
        with opened(path) as video:
            found, bgr = video.read()
    return bool(found) and float(bgr.mean()) > 224


def unchanged(rgb: Picture8) -> Picture:
    return rgb


def _of_screen(rgb: Picture8) -> Picture:
    """Light of the screen to sRGB of 16 bits."""
    return to_srgb(rgb, _SCREEN)


def _hlg_of_screen(rgb: Picture8) -> Picture:
    """Light of the screen to the light of the scene that HLG stores, and to sRGB."""
    light = _SCREEN.curves[0](np.arange(256) / 255).astype(np.float32)
    result = np.empty(rgb.shape, np.uint16)
    rows = max(_PIECE // rgb.shape[1], 1)
    for start in range(0, len(rgb), rows):
        piece = slice(start, start + rows)
        result[piece] = to_picture(hlg_scene(light[rgb[piece]]), 16)
    return result


def _rgb_to_ycbcr(red: float, blue: float) -> Array:
    """From the weights of red and blue in luma (H.273, equations 38 to 40)."""
    luma = np.array([red, 1 - red - blue, blue])
    cb = (np.array([0, 0, 1]) - luma) / (2 - 2 * blue)
    cr = (np.array([1, 0, 0]) - luma) / (2 - 2 * red)
    return np.stack([luma, cb, cr])


def _ycbcr_to_rgb(red: float, blue: float) -> Array:
    return np.linalg.inv(_rgb_to_ycbcr(red, blue))


_GREY = (
    "c-oCqJ4*vW5S~rq3j`lYArj$yfrXF6Cw2-JDFn69LM*)8?&0BXF5Iq%TBX#&!k=L$ih`9E`4?g(h>f+K"
    "arQ1Tm-xV8XJ=;jo4I-H0YKVTM@2`v0w4xjB2SCrY!(38ZI3aOLxP$LfLud&8;aZRhvzPFH!SYYZa?N9"
    "-vQz)!gYN_a^de$XrTBjZWIXURVUJjYPOf)Pm19xD9_wSeMjvF-;Dndjehg|&v%U~1B@`LB+4}7Qbjyy"
    "-Iu%w>X_O?(B|65kQ1<34vdLC%Dvi+?@$&+ZlUew%mU?1W5~I13N|V!Uj#v;X^znFE=@gVN0RD1@VF7`"
    "WJ9VvNBvDINh6pi9IgLLD|FEY<WS~*MKn`irGon|lT-%7E|p4a=$1gaZ1e<>b^Vfz7Cf24h?hFMo6}?%"
    "oET6(JAqA-NTe(@uU1Xpnp>QlS(wabGOg%CV!8`?<yG4sM#C*>x!fyQ{17^z7g;AGRWPku>O^;6Hwv3z"
    "HJ*QQ3h$1qcm4G<%Z=d2k@E*s=_zju7D!El(TU<K@XTV7N4qoOgwJO5Lb*EN0RBg2t*=<BjipWprG5ex"
    "+IM6"
)
