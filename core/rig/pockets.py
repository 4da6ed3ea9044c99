"""What closes a mesh behind its openings: the rim of the lids and the mouth bag.

Both begin at a loop of vertices of the skin and go inwards ring by ring.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._types import Array, Indices
from .eyes import Eyeball

#: Rings of the mouth bag: depth, half height (mm at an eye distance of 62 mm) and width
#: as a share of the lips'; then the share of the lips' movement that it follows.
BAG = (
    (3.0, 0.6, 0.97, 1.0),
    (8.0, 5.0, 0.90, 0.9),
    (18.0, 8.0, 0.80, 0.7),
    (30.0, 7.0, 0.65, 0.5),
    (36.0, 0.0, 0.55, 0.4),
)
#: Rings of the rim behind the lids: distance from the eyeball's centre in radii.
RIM = (1.004, 0.93)


@dataclass(frozen=True)
class Pocket:
    """Vertices and quads that continue a loop inwards.

    Attributes
    ----------
    points : (p, 3) array
        New vertices.
    quads : (q, 4) int array
        Numbers below ``len(loop)`` are places of the loop, the others new vertices.
    """

    points: Array
    quads: Indices


def lid_rim(loop: Array, ball: Eyeball) -> Pocket:
    """The edge of the lids, from their margin to behind the front of the eyeball.

    Parameters
    ----------
    loop : (k, 3) array
        The lid margin, clockwise as seen from the front: the quads of the skin run
        along it the same way.
    ball : Eyeball
    """
    return _rings(len(loop), [ball.onto(loop, share) for share in RIM])


def mouth_bag(upper: Array, lower: Array, unit: float) -> Pocket:
    """A closed bag behind the lips.

    Parameters
    ----------
    upper, lower : (k, 3) arrays
        The two lips, from the subject's right corner to the left; corners equal.
    unit : float
        Eye distance over 62 mm.

    Returns
    -------
    Pocket
        For the loop of `bag_loop`. The last ring is a line: its lower vertices are
        its upper ones.
    """
    k = len(upper)
    loop = np.concatenate([upper, lower[-2:0:-1]])
    share = np.concatenate([np.linspace(0, 1, k), np.linspace(0, 1, k)[-2:0:-1]])
    swell = np.sin(np.pi * share)
    sign = np.concatenate([np.ones(k), -np.ones(k - 2)])
    middle = loop.mean(axis=0)
    rings = []
    for depth, height, width, _ in BAG:
        ring = loop - (0.0, 0.0, depth * unit)
        ring[:, 1] += sign * swell * height * unit
        ring[:, 0] = middle[0] + width * (loop[:, 0] - middle[0])
        rings.append(ring)
    pocket = _rings(len(loop), rings)
    # The last ring as a line: every lower vertex is the upper one of its column.
    size, last = len(loop), len(loop) * len(rings)
    same = np.arange(size * (len(rings) + 1))
    lower_places = np.arange(k, size)
    same[last + lower_places] = last + (size - lower_places)
    quads = same[pocket.quads]
    return Pocket(pocket.points[: last - size + k], quads)


def bag_movement(upper: Array, lower: Array) -> Array:
    """Movement of the bag's vertices with the lips, (p, 3).

    Parameters
    ----------
    upper, lower : (k, 3) arrays
        Movements of the lips.
    """
    k = len(upper)
    loop = np.concatenate([upper, lower[-2:0:-1]])
    mean = (upper + lower) / 2
    both = np.concatenate([mean, mean[-2:0:-1]])
    rings = []
    for index, (_, _, _, share) in enumerate(BAG):
        apart = 1 - index / (len(BAG) - 1)
        rings.append(share * (both + apart * (loop - both)))
    return np.concatenate([*rings[:-1], rings[-1][:k]])


def _rings(size: int, rings: list[Array]) -> Pocket:
    """Quads between a loop of ``size`` places and rings of as many."""
    at = np.arange(size)
    following = np.roll(at, -1)
    quads = [
        np.stack([following + a, at + a, at + b, following + b], axis=1)
        for a, b in ((k * size, (k + 1) * size) for k in range(len(rings)))
    ]
    return Pocket(np.concatenate(rings), np.concatenate(quads))
