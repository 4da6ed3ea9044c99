"""Proposals of faces: what the numbers of the face detector (BlazeFace) mean.

Boxes and eyes about anchors become upright crops, one for each place.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from .crops import CROP_MARGIN, Crop

DETECTOR_SIDE = 128
MIN_DETECTOR_SCORE = 0.5
OVERLAP = 0.3


class Cropped(Protocol):
    """What is seen in a crop of the picture."""

    @property
    def crop(self) -> Crop:
        """Where."""
        ...


CroppedT = TypeVar("CroppedT", bound=Cropped)


@dataclass(frozen=True, eq=False)
class Proposal:
    """What the detector takes for a face: its crop and the detector's score."""

    crop: Crop
    score: float


def anchor_centres() -> np.ndarray:
    """(896, 2) anchor centres of BlazeFace short range, in [0, 1]."""
    parts = []
    for cells, repeat in ((16, 2), (8, 6)):
        at = (np.arange(cells) + 0.5) / cells
        grid = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
        parts.append(np.repeat(grid, repeat, axis=0))
    return np.concatenate(parts)


def decode(
    raw: np.ndarray, score: np.ndarray, anchors: np.ndarray, window: Crop
) -> list[Proposal]:
    """What the detector takes for faces in a window, from its answer there.

    Parameters
    ----------
    raw : (896, 16) array
        Of each anchor: centre and size of a box and six points, pixels of the
        network's picture; centre and points are counted from the anchor.
    score : (896,) array
        Probability of a face at each anchor.
    anchors : (896, 2) array
        See `anchor_centres`.
    window : Crop
        What the network saw.
    """
    keep = np.flatnonzero(score >= MIN_DETECTOR_SCORE)
    raw, score = raw[keep], score[keep]
    anchor = anchors[keep] * DETECTOR_SIDE
    centre, half = raw[:, :2] + anchor, raw[:, 2:4] / 2
    boxes = np.concatenate([centre - half, centre + half], axis=1)
    keypoints = raw[:, 4:].reshape(-1, 6, 2) + anchor[:, None]
    proposals = []
    for group in _groups(boxes, score):
        # Weighted suppression: overlapping answers are averaged.
        weight = score[group] / score[group].sum()
        box = (weight @ boxes[group]).reshape(2, 2)
        eyes = np.einsum("k,kpc->pc", weight, keypoints[group])[:2]
        (middle, right, left) = window.to_image(
            np.stack([box.mean(axis=0), *eyes]), DETECTOR_SIDE
        )
        side = float((box[1] - box[0]).max()) * window.side / DETECTOR_SIDE
        crop = Crop(middle, side * CROP_MARGIN, direction(left - right))
        proposals.append(Proposal(crop, float(score[group].max())))
    return proposals


def _groups(boxes: np.ndarray, score: np.ndarray) -> Iterator[np.ndarray]:
    left = np.argsort(-score, kind="stable")
    while left.size:
        union, _ = _overlap(boxes[left[0]], boxes[left])
        same = union > OVERLAP
        same[0] = True
        yield left[same]
        left = left[~same]


def _overlap(box: np.ndarray, boxes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Intersection over union, and over the smaller box."""
    low = np.maximum(box[:2], boxes[:, :2])
    high = np.minimum(box[2:], boxes[:, 2:])
    common = np.prod(np.clip(high - low, 0, None), axis=1)
    area = np.prod(box[2:] - box[:2])
    areas = np.prod(boxes[:, 2:] - boxes[:, :2], axis=1)
    tiny = 1e-12
    return (
        common / np.maximum(area + areas - common, tiny),
        common / np.maximum(np.minimum(area, areas), tiny),
    )


def unlike(faces: Sequence[CroppedT]) -> list[CroppedT]:
    """Of faces at the same place the first: a tile may show a part of a face."""
    kept: list[CroppedT] = []
    for face in faces:
        if kept:
            boxes = np.stack([other.crop.box() for other in kept])
            union, smaller = _overlap(face.crop.box(), boxes)
            if (union > OVERLAP).any() or (smaller > 0.7).any():
                continue
        kept.append(face)
    return kept


def direction(vector: np.ndarray) -> float:
    """Angle of a vector (2,) from the x axis towards the y axis, radians."""
    return float(np.arctan2(vector[1], vector[0]))
