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
    upper, lower : (k, 3), (l, 3) arrays
        The two lips, from the subject's right corner to the left; corners equal, k + l
        even.
    unit : float
        Eye distance over 62 mm.

    Returns
    -------
    Pocket
        For the loop of the upper lip and back along the lower one. The last ring is
        folded to a line: two of its places each are one vertex.
    """
    k = len(upper)
    loop = np.concatenate([upper, lower[-2:0:-1]])
    back = np.linspace(0, 1, len(lower))[-2:0:-1]
    share = np.concatenate([np.linspace(0, 1, k), back])
    swell = np.sin(np.pi * share)
    sign = np.concatenate([np.ones(k), -np.ones(len(lower) - 2)])
    middle = loop.mean(axis=0)
    rings = []
    for depth, height, width, _ in BAG:
        ring = loop - (0.0, 0.0, depth * unit)
        ring[:, 1] += sign * swell * height * unit
        ring[:, 0] = middle[0] + width * (loop[:, 0] - middle[0])
        rings.append(ring)
    size, last = len(loop), len(loop) * len(rings)
    kept, owner = _fold(k, len(lower))
    pocket = _rings(size, rings)
    same = np.arange(size * (len(rings) + 1))
    same[last:] = last + owner
    points = np.concatenate([*rings[:-1], rings[-1][kept]])
    return Pocket(points, same[pocket.quads])


def _fold(upper: int, lower: int) -> tuple[Indices, Indices]:
    """Which places of a loop along both lips stay when it is folded to a line.

    The fold halves the loop, so it may begin beside the corner of the mouth.

    Returns
    -------
    kept : (k,) int array
        Places that have a vertex.
    owner : (size,) int array
        Number of the vertex of each place.
    """
    size = upper + lower - 2
    first = (upper - lower) // 2 // 2
    partner = (2 * first - np.arange(size)) % size
    kept = (first + np.arange(size // 2 + 1)) % size
    number = np.empty(size, np.int64)
    number[kept] = np.arange(len(kept))
    number[partner[kept]] = np.arange(len(kept))
    return kept, number


def bag_movement(upper: Array, lower: Array) -> Array:
    """Movement of the bag's vertices with the lips, (p, 3).

    Parameters
    ----------
    upper, lower : (k, 3), (l, 3) arrays
        Movements of the lips.
    """
    loop = np.concatenate([upper, lower[-2:0:-1]])
    mean_upper = (upper + _as_many(lower, len(upper))) / 2
    mean_lower = (_as_many(upper, len(lower)) + lower) / 2
    both = np.concatenate([mean_upper, mean_lower[-2:0:-1]])
    rings = []
    for index, (_, _, _, share) in enumerate(BAG):
        apart = 1 - index / (len(BAG) - 1)
        rings.append(share * (both + apart * (loop - both)))
    kept, _ = _fold(len(upper), len(lower))
    return np.concatenate([*rings[:-1], rings[-1][kept]])


def _as_many(values: Array, count: int) -> Array:
    """A row of vectors at another number of evenly spaced places."""
    if len(values) == count:
        return values
    at = np.linspace(0, len(values) - 1, count)
    return np.stack([np.interp(at, np.arange(len(values)), x) for x in values.T], 1)


def _rings(size: int, rings: list[Array]) -> Pocket:
    """Quads between a loop of ``size`` places and rings of as many."""
    at = np.arange(size)
    following = np.roll(at, -1)
    quads = [
        np.stack([following + a, at + a, at + b, following + b], axis=1)
        for a, b in ((k * size, (k + 1) * size) for k in range(len(rings)))
    ]
    return Pocket(np.concatenate(rings), np.concatenate(quads))
