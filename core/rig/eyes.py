"""Eyeballs behind the lids: how large, where, and how they turn.

An eyeball of an adult has a diameter of 24 mm and hardly varies, so the radius is 12 mm
at an eye distance of 62 mm and grows with it. The centre lies behind the middle of the
lid opening, as far forward as the lids allow at every stage of a blink.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from .._types import Array, Indices, Picture8

RADIUS_MM, EYE_DISTANCE_MM = 12.0, 62.0
IRIS_DIAMETER_MM, PUPIL_DIAMETER_MM = 11.7, 4.0
#: Between lid and eyeball, mm: skin has a thickness.
CLEARANCE_MM = 0.2


@dataclass(frozen=True)
class Eyeball:
    """A sphere.

    Attributes
    ----------
    centre : (3,) array
    radius : float
        mm.
    """

    centre: Array
    radius: float

    def onto(self, points: Array, share: float = 1.0) -> Array:
        """Points moved along their rays onto a sphere ``share`` times as large."""
        ray = points - self.centre
        length = np.linalg.norm(ray, axis=-1, keepdims=True)
        return self.centre + share * self.radius * ray / np.maximum(length, 1e-12)


def fit_eyeball(lids: Array, blink: Array, eye_distance: float) -> Eyeball:
    """The eyeball behind a lid opening.

    Parameters
    ----------
    lids : (k, 3) array
        The lid margin, mm.
    blink : (k, 3) array
        Its movement to the closed eye.
    eye_distance : float
        mm.
    """
    radius = RADIUS_MM * eye_distance / EYE_DISTANCE_MM
    low, high = lids.min(axis=0), lids.max(axis=0)
    middle = (low + high) / 2
    reach = radius + CLEARANCE_MM
    back = np.inf
    for weight in np.linspace(0, 1, 5):
        at = lids + weight * blink
        aside2 = ((at[:, :2] - middle[:2]) ** 2).sum(axis=1)
        near = aside2 < reach**2
        # A point in front of the sphere: z >= z of the centre + the height there.
        height = np.sqrt(reach**2 - aside2[near])
        back = min(back, float((at[near, 2] - height).min(initial=np.inf)))
    if not np.isfinite(back):
        back = float(middle[2]) - radius
    return Eyeball(np.array([middle[0], middle[1], back]), radius)


def sphere(ball: Eyeball, cells: int) -> tuple[Array, Indices, Array]:
    """An eyeball of quads: a cube's faces on the sphere.

    Parameters
    ----------
    ball : Eyeball
    cells : int
        Quads along the edge of a face of the cube.

    Returns
    -------
    points : (p, 3) array
    quads : (q, 4) int array
        Counter-clockwise seen from outside.
    uv : (p, 2) array
        Seen from the front, v downwards; the back repeats the white of the rim.
    """
    # Equal angles: the cells of a cube's face differ by less.
    t = np.tan(np.linspace(-np.pi / 4, np.pi / 4, cells + 1))
    a, b = np.meshgrid(t, t, indexing="ij")
    flat = np.stack([a, b, np.ones_like(a)], axis=-1).reshape(-1, 3)
    number = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    face = np.stack(
        [number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1
    ).reshape(-1, 4)
    turns = [Rotation.from_euler("y", k * np.pi / 2) for k in range(4)]
    turns += [Rotation.from_euler("x", s * np.pi / 2) for s in (1, -1)]
    points = np.concatenate([turn.apply(flat) for turn in turns])
    quads = np.concatenate([face + k * len(flat) for k in range(6)])
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    # Vertices on the cube's edges are there twice or three times.
    _, first, index = np.unique(
        np.round(points, 9) + 0.0, axis=0, return_index=True, return_inverse=True
    )
    points, quads = points[first], index.reshape(-1)[quads]
    aside = points[:, :2] * (1, -1)
    behind = points[:, 2] < 0
    length = np.maximum(np.linalg.norm(aside, axis=1, keepdims=True), 1e-12)
    aside = np.where(behind[:, None], aside / length, aside)
    return ball.centre + ball.radius * points, quads, 0.5 + 0.49 * aside


def turned(ball: Eyeball, points: Array, degrees: tuple[float, float]) -> Array:
    """Movement of points with an eye that turns (to +x, up) by these angles."""
    turn = Rotation.from_euler("yx", [degrees[0], -degrees[1]], degrees=True)
    return turn.apply(points - ball.centre) + ball.centre - points


def iris_picture(radius: float = RADIUS_MM, size: int = 256) -> Picture8:
    """A drawn eye for the (u, v) of `sphere`: white, iris and pupil, (size, size, 3).

    Free of any rights: made by these few lines.
    """
    at = (np.arange(size) + 0.5) / size - 0.5
    x, y = np.meshgrid(at, at)
    r = np.hypot(x, y) / 0.49 * radius
    angle = np.arctan2(y, x)
    iris, pupil = IRIS_DIAMETER_MM / 2, PUPIL_DIAMETER_MM / 2
    fibre = 0.5 + 0.25 * np.sin(61 * angle) + 0.25 * np.sin(37 * angle + 2)
    share = np.clip((r - pupil) / (iris - pupil), 0, 1)[..., None]
    colour = (1 - share) * (122, 88, 52) + share * (74, 62, 48)
    colour = colour * (0.8 + 0.35 * fibre[..., None])
    colour = colour * np.clip((iris - r) / 0.8, 0.35, 1)[..., None]
    white = np.array([236, 230, 226]) - 14.0 * np.clip(r / radius, 0, 1)[..., None] ** 2

    def step(edge: float, soft: float) -> Array:
        return np.clip((r - edge) / soft + 0.5, 0, 1)[..., None]

    picture = colour * (1 - step(iris, 0.5)) + white * step(iris, 0.5)
    picture = (12, 10, 10) * (1 - step(pupil, 0.3)) + picture * step(pupil, 0.3)
    return np.round(np.clip(picture, 0, 255)).astype(np.uint8)
