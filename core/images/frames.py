"""Which frames of a video are worth a closer look: sharp ones that differ.

The choice sees small grey pictures only. Frames that look alike are one group, of which
the sharpest stands for all; if there are more groups than wanted, those are taken that
lie farthest from each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from .._types import Array, Picture8

# Sharpness is measured at this length of the longer side: there, a blur that matters
# for landmarks shows, and the noise of the sensor is averaged away.
_SIDE = 960
_THUMBNAIL = 32
# Mean difference in levels of 8 bits. Codec and sensor leave less than 0.5 between two
# frames of a still scene.
ALIKE = 1.0


@dataclass(frozen=True, eq=False)
class Frame:
    """What is remembered of a frame.

    Parameters
    ----------
    number : int
        Counted from 0 as the frames are decoded.
    seconds : float
        When it is shown.
    sharpness : float
        Energy of the Laplacian relative to the variance, as in `quality`.
    thumbnail : (32, 32) uint8 array
        Grey.
    """

    number: int
    seconds: float
    sharpness: float
    thumbnail: Picture8


def time_code(seconds: float) -> str:
    """``00:12.433``, from an hour on ``1:02:12.433``."""
    milliseconds = round(max(seconds, 0.0) * 1000)
    minutes, milliseconds = divmod(milliseconds, 60_000)
    hours, minutes = divmod(minutes, 60)
    head = f"{hours}:" if hours else ""
    return f"{head}{minutes:02d}:{milliseconds / 1000:06.3f}"


def look(bgr: Picture8, number: int, seconds: float) -> Frame:
    """Measure a decoded frame, (h, w, 3) in OpenCV's order of colours."""
    grey = cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY)
    factor = _SIDE / max(grey.shape)
    if factor < 1:
        grey = cv2.resize(
            grey, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA
        )
    detail = cv2.Laplacian(grey, cv2.CV_32F)
    sharpness = float(detail.var() / max(float(grey.var()), 1.0))
    return Frame(number, seconds, sharpness, _small(grey))


def thumbnail(rgb: Picture8) -> Picture8:
    """(32, 32) grey of a picture (h, w, 3): two that differ by less than `ALIKE` in the
    mean look the same."""
    return _small(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY))


def _small(grey: np.ndarray) -> Picture8:
    side = (_THUMBNAIL, _THUMBNAIL)
    return cv2.resize(grey, side, interpolation=cv2.INTER_AREA).astype(np.uint8)


class FrameGroups:
    """Frames that look alike as one group each, of which the sharpest is the best.

    Parameters
    ----------
    frames : sequence of Frame
        In the order of the video, as are those that are added.

    Attributes
    ----------
    best : list of Frame
    """

    def __init__(self, frames: Sequence[Frame] = ()) -> None:
        self.best: list[Frame] = []
        self._anchors = np.empty((0, _THUMBNAIL**2), np.float32)
        for frame in frames:
            self.add(frame)

    def add(self, frame: Frame) -> Frame | None:
        """The frame that is no longer the best of its group, or never was."""
        flat = frame.thumbnail.ravel().astype(np.float32)
        away = np.abs(self._anchors[: len(self.best)] - flat).mean(axis=1)
        nearest = int(away.argmin()) if len(self.best) else -1
        if nearest >= 0 and away[nearest] < ALIKE:
            before = self.best[nearest]
            if frame.sharpness > before.sharpness:
                self.best[nearest] = frame
                return before
            return frame
        # The first of a group decides what belongs to it: a slow turn would otherwise
        # be one group.
        if len(self.best) == len(self._anchors):
            self._anchors = np.resize(
                self._anchors, (2 * len(self.best) + 8, flat.size)
            )
        self._anchors[len(self.best)] = flat
        self.best.append(frame)
        return None


def choose_frames(frames: Sequence[Frame], limit: int) -> tuple[Frame, ...]:
    """At most `limit` frames, no two alike, in the order of the video.

    Parameters
    ----------
    frames : sequence of Frame
        In the order of the video.
    limit : int
    """
    return differing_looks(FrameGroups(frames).best, limit)


def differing_looks(frames: Sequence[Frame], limit: int) -> tuple[Frame, ...]:
    """At most `limit` of the frames, in the order of the video."""
    chosen = list(frames)
    if len(chosen) > limit:
        looks = np.stack([f.thumbnail.ravel() for f in chosen]).astype(np.float64)
        weight = up_to_median(np.array([f.sharpness for f in chosen]))
        chosen = [chosen[i] for i in far_apart(looks, weight, limit)]
    return tuple(sorted(chosen, key=lambda f: f.number))


def up_to_median(values: Array) -> Array:
    """Numbers that are not negative, relative to their median; 1 above it."""
    return np.minimum(values / max(float(np.median(values)), 1e-12), 1.0)


def far_apart(features: Array, weight: Array, count: int) -> list[int]:
    """Indices of rows that lie far from each other, heavy ones before light ones.

    The heaviest comes first, then again and again the one whose distance from all
    chosen times its weight is largest (farthest-point sampling, Gonzalez 1985).

    Parameters
    ----------
    features : (n, k) array
    weight : (n,) array, not negative
    count : int
    """
    chosen = [int(weight.argmax())]
    nearest = np.full(len(features), np.inf)
    while len(chosen) < min(count, len(features)):
        away = np.linalg.norm(features - features[chosen[-1]], axis=1)
        nearest = np.minimum(nearest, away)
        score = nearest * weight
        score[chosen] = -1.0
        chosen.append(int(score.argmax()))
    return chosen[:count]
