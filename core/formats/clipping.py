"""A triangle mesh of the (u, v) plane clipped at the face's outline.

Vertices next to the outline are moved onto it, so that the border is smooth and no
sliver is left.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .._types import Array


def clip_mesh(
    uv: Array, triangles: npt.NDArray[np.int64], outline: Array
) -> tuple[Array, npt.NDArray[np.int64]]:
    """The part of a (u, v) mesh inside a polygon.

    Parameters
    ----------
    uv : (p, 2) array
        Vertices.
    triangles : (t, 3) int array
    outline : (k, 2) array
        The polygon, closed by itself, in the same (u, v).

    Returns
    -------
    uv : (q, 2) array
        The vertices in use; some were moved onto the outline, some are new on it.
    triangles : (s, 3) int array
        Of the same orientation.
    """
    distance, nearest = signed_distance(outline, uv)
    # Vertices nearer to the outline than a third of their shortest edge move onto it.
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]]])
    edges = np.concatenate([edges, triangles[:, [2, 0]]])
    length = np.linalg.norm(uv[edges[:, 0]] - uv[edges[:, 1]], axis=1)
    shortest = np.full(len(uv), np.inf)
    np.minimum.at(shortest, edges[:, 0], length)
    np.minimum.at(shortest, edges[:, 1], length)
    on_it = np.abs(distance) < shortest / 3
    uv = np.where(on_it[:, None], nearest, uv)
    side = np.where(on_it, 0, np.sign(distance)).astype(int)

    corner = side[triangles]
    whole = (corner >= 0).all(axis=1) & (corner > 0).any(axis=1)
    kept = [triangles[whole]]
    mixed = triangles[(corner > 0).any(axis=1) & (corner < 0).any(axis=1)]
    if len(mixed):
        pairs = np.sort(
            np.concatenate([mixed[:, [0, 1]], mixed[:, [1, 2]], mixed[:, [2, 0]]]), 1
        )
        pairs = np.unique(pairs[side[pairs[:, 0]] * side[pairs[:, 1]] < 0], axis=0)
        crossing = _crossings(outline, uv[pairs[:, 0]], uv[pairs[:, 1]], side[pairs])
        number = {
            (int(a), int(b)): len(uv) + index for index, (a, b) in enumerate(pairs)
        }
        uv = np.concatenate([uv, crossing])
        kept.append(_cut(mixed, side, number))
    triangles = np.concatenate(kept)
    used, index = np.unique(triangles, return_inverse=True)
    return uv[used], index.reshape(triangles.shape)


def _cut(
    mixed: npt.NDArray[np.int64],
    side: npt.NDArray[np.int64],
    number: dict[tuple[int, int], int],
) -> npt.NDArray[np.int64]:
    """Inner parts of the triangles that the outline crosses."""
    result: list[tuple[int, int, int]] = []
    for triangle in mixed.tolist():
        polygon = []
        for a, b in zip(triangle, triangle[1:] + triangle[:1], strict=True):
            if side[a] >= 0:
                polygon.append(a)
            if side[a] * side[b] < 0:
                polygon.append(number[min(a, b), max(a, b)])
        result += [
            (polygon[0], polygon[i], polygon[i + 1]) for i in range(1, len(polygon) - 1)
        ]
    return np.array(result, np.int64).reshape(-1, 3)


def _crossings(outline: Array, a: Array, b: Array, side: npt.NDArray) -> Array:
    """Points of the segments a-b on the outline, by bisection."""
    inner = np.where(side[:, :1] > 0, a, b)
    outer = np.where(side[:, :1] > 0, b, a)
    for _ in range(24):
        middle = (inner + outer) / 2
        is_inside = signed_distance(outline, middle)[0] >= 0
        inner = np.where(is_inside[:, None], middle, inner)
        outer = np.where(is_inside[:, None], outer, middle)
    return signed_distance(outline, inner)[1]


def signed_distance(outline: Array, points: Array) -> tuple[Array, Array]:
    """Distance to a closed polygon, positive inside, and the nearest point on it.

    Parameters
    ----------
    outline : (k, 2) array
    points : (p, 2) array

    Returns
    -------
    distance : (p,) array
    nearest : (p, 2) array
    """
    best = np.full(len(points), np.inf)
    nearest = np.zeros_like(points)
    odd = np.zeros(len(points), bool)
    for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        along = b - a
        t = np.clip((points - a) @ along / max(along @ along, 1e-300), 0, 1)
        foot = a + t[:, None] * along
        squared = ((points - foot) ** 2).sum(axis=1)
        closer = squared < best
        best = np.where(closer, squared, best)
        nearest[closer] = foot[closer]
        crosses = (a[1] > points[:, 1]) != (b[1] > points[:, 1])
        rise = b[1] - a[1] or 1.0
        odd ^= crosses & (points[:, 0] < a[0] + (points[:, 1] - a[1]) * along[0] / rise)
    sign = np.where(odd, 1.0, -1.0)
    return np.asarray(sign * np.sqrt(best), float), nearest
