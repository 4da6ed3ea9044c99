"""The report as one picture, for those who only want to glance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..result import Reconstruction
from .photos import contact_sheet

Picture = npt.NDArray[np.uint8]

WIDTH = 1280
_INK, _SOFT = (30, 32, 35), (110, 115, 120)
_MARGIN = 30


def summary_sheet(
    reconstruction: Reconstruction,
    facts: Mapping[str, Any],
    pictures: Mapping[str, Picture],
) -> Picture:
    """Views, maps and all photos with their landmarks, (H, 1280, 3) uint8."""
    photos = facts["photos"]
    m, n = facts["control_points"]
    line = f"{photos['used']} of {photos['all']} photos used, {m} x {n} control points"
    error = facts["residuals"]["reprojection_pct"]
    if error is not None:
        line += f", landmark error {error:.1f} % of the eye distance"
    title = str(facts["title"]).encode("ascii", "replace").decode("ascii")
    parts = [_text(title, 1.1, _INK, 54, 2), _text(line, 0.55, _SOFT, 34)]
    for name in ("views", "textured"):
        if name in pictures:
            parts.append(_fitted([pictures[name]], 440))
    on_face = [pictures[k] for k in ("confidence", "residual") if k in pictures]
    if on_face:
        names = {
            "confidence": "deviation, 0 to 2 mm",
            "residual": "residual, 0 to 20 %",
        }
        words = [names[k] for k in names if k in pictures]
        parts += [_text("   |   ".join(words), 0.55, _SOFT, 34), _fitted(on_face, 240)]
    drawn = [pictures[k] for k in pictures if k.startswith("map_")]
    if drawn:
        words = "z and its derivatives by u, v, uu, vv, uv"
        parts += [_text(words, 0.55, _SOFT, 34), _fitted(drawn, 180)]
    if reconstruction.has_pixels:
        sheet = contact_sheet(reconstruction, 10, WIDTH - 2 * _MARGIN)
        parts += [_text("photos", 0.55, _SOFT, 34), _centred(sheet)]
    for sentence in facts["warnings"][:6]:
        words = str(sentence).encode("ascii", "replace").decode("ascii")
        parts.append(_text(words, 0.5, _INK, 26))
    rim = np.full((_MARGIN, WIDTH, 3), 255, np.uint8)
    return np.concatenate([rim, *parts, rim])


def _text(
    words: str, size: float, colour: tuple[int, ...], height: int, thickness: int = 1
) -> Picture:
    strip = np.full((height, WIDTH, 3), 255, np.uint8)
    font = cv2.FONT_HERSHEY_SIMPLEX
    while cv2.getTextSize(words, font, size, thickness)[0][0] > WIDTH - 2 * _MARGIN:
        words = words[:-5] + "..."
    at = (_MARGIN, height - 10)
    cv2.putText(strip, words, at, font, size, colour, thickness, cv2.LINE_AA)
    return strip


def _fitted(pictures: list[Picture], height: int) -> Picture:
    """Pictures side by side at one height, shrunk where they are too wide."""
    gap = 16
    scaled = [p.shape[1] * height / p.shape[0] for p in pictures]
    room = WIDTH - 2 * _MARGIN - gap * (len(pictures) - 1)
    height = round(height * min(1.0, room / sum(scaled)))
    row = []
    for picture in pictures:
        width = round(picture.shape[1] * height / picture.shape[0])
        kind = cv2.INTER_AREA if height < picture.shape[0] else cv2.INTER_LINEAR
        row.append(cv2.resize(picture, (width, height), interpolation=kind))
        row.append(np.full((height, gap, 3), 255, np.uint8))
    return _centred(np.concatenate(row[:-1], axis=1))


def _centred(picture: Picture) -> Picture:
    left = (WIDTH - picture.shape[1]) // 2
    strip = np.full((picture.shape[0] + 12, WIDTH, 3), 255, np.uint8)
    strip[: picture.shape[0], left : left + picture.shape[1]] = picture
    return strip
