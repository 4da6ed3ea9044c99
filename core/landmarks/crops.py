"""Square windows on a picture: where they lie, and their pixels.

A crop is centre, side and turn. Its own coordinates run from 0 to its size in
pixels, edge to edge; the picture's pixels have their centres at integers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ..images.remap import read_between

# Side of the mesh's crop over the side of the landmarks' box.
CROP_MARGIN = 1.5


@dataclass(frozen=True, eq=False)
class Crop:
    """A square of the picture: centre (2,) and side in pixels, turn in radians."""

    centre: np.ndarray
    side: float
    turn: float

    def axes(self) -> np.ndarray:
        """(2, 2): columns are the crop's x and y axis in the picture."""
        c, s = np.cos(self.turn), np.sin(self.turn)
        return np.array([[c, -s], [s, c]])

    def moved(self, right: float, down: float, scale: float) -> Crop:
        shift = self.axes() @ (right * self.side, down * self.side)
        return Crop(self.centre + shift, self.side * scale, self.turn)

    def box(self) -> np.ndarray:
        half = self.side / CROP_MARGIN / 2
        return np.concatenate([self.centre - half, self.centre + half])

    def to_image(self, xy: np.ndarray, size: int) -> np.ndarray:
        """Network coordinates, [0, size] from edge to edge -> picture pixels."""
        return self.centre + (xy / size - 0.5) * self.side @ self.axes().T


def pyramid(image: np.ndarray, smallest: int = 128) -> list[np.ndarray]:
    """The picture and its halvings, each the mean of 2 x 2 of the last."""
    levels = [np.ascontiguousarray(image)]
    while max(levels[-1].shape[:2]) > smallest:
        last = levels[-1]
        h, w = last.shape[:2]
        if h % 2 or w % 2:
            # An odd edge is repeated so that each level is exactly half.
            last = cv2.copyMakeBorder(last, 0, h % 2, 0, w % 2, cv2.BORDER_REPLICATE)
        size = (last.shape[1] // 2, last.shape[0] // 2)
        levels.append(cv2.resize(last, size, interpolation=cv2.INTER_AREA))
    return levels


def sample(levels: list[np.ndarray], crop: Crop, size: int) -> np.ndarray:
    """The crop as (size, size, 3) uint8; black outside the picture."""
    step = crop.side / size
    level = int(np.clip(np.floor(np.log2(max(step, 1e-9))), 0, len(levels) - 1))
    axes = crop.axes() * step
    # Crop pixel i lies at i + 0.5 from the crop's edge; the same half pixel
    # stands between a level's pixels and the original's.
    corner = crop.centre + axes @ np.full(2, 0.5 - size / 2)
    corner = (corner + 0.5) / 2**level - 0.5
    right, down = (axes / 2**level).T
    steps = np.arange(size)[:, None]
    xy = (corner + steps * down)[:, None] + steps * right
    # Only the part that is read becomes floating point: what the corners span.
    h, w = levels[level].shape[:2]
    corners = xy[[0, 0, -1, -1], [0, -1, 0, -1]]
    low = np.clip(np.floor(corners.min(0)).astype(int) - 1, 0, (w - 1, h - 1))
    high = np.clip(np.ceil(corners.max(0)).astype(int) + 2, low + 1, (w, h))
    part = levels[level][low[1] : high[1], low[0] : high[0]].astype(np.float32)
    found = read_between(part, xy - low)
    return np.rint(found).astype(np.uint8)


def windows_of(w: int, h: int, levels: Sequence[float]) -> list[Crop]:
    """Square windows: level 1 is the whole picture, 2 its overlapping halves..."""
    windows = []
    for level in levels:
        side = max(w, h) / level
        # On the fine levels faces are small in the window, else they would have
        # been found before: less overlap is enough.
        step = 0.5 if level < 8 else 0.65
        for y in _centres(h, side, step):
            for x in _centres(w, side, step):
                windows.append(Crop(np.array([x, y]), side, 0.0))
    return windows


def _centres(length: int, side: float, step: float) -> Iterator[float]:
    """Centres along one edge, at most `step` sides apart."""
    if side >= length:
        yield (length - 1) / 2
        return
    count = int(np.ceil((length - side) / (step * side))) + 1
    for k in range(count):
        yield side / 2 - 0.5 + k * (length - side) / (count - 1)
