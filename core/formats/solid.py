"""A face as a closed solid: the surface, an offset behind it, and a rim between them.

The outer side is the triangle mesh of :mod:`.tessellation`, so eyes, lips and nostrils
keep their lines. Every vertex of the inner side lies ``thickness`` behind the outer one
along the normal. Where the face is rounder than the thickness, such points pass one
another; there the inner side is smoothed until no triangle of it is turned over.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import sparse

from .._types import Array, Indices
from ..surface.bspline import BSplineSurface
from .tessellation import tessellate

#: Rounds of smoothing before the thickness counts as too large.
ROUNDS = 400
#: How far smoothing may move an inner point, in thicknesses.
ALLOWED = 1.0


def solid(
    surface: BSplineSurface,
    outline_uv: npt.ArrayLike | None,
    thickness: float,
    tolerance: float,
) -> tuple[Array, Indices]:
    """A closed solid.

    Parameters
    ----------
    surface : BSplineSurface
    outline_uv : (k, 2) array or None
        None for the whole patch.
    thickness, tolerance : float
        mm.

    Returns
    -------
    points : (p, 3) array
        The outer vertices first, then as many inner ones.
    triangles : (t, 3) int array
        Counter-clockwise seen from outside of the solid; every edge has two.

    Raises
    ------
    ValueError
        When the thickness is too large for the face.
    """
    outer = tessellate(surface, outline_uv, tolerance)
    behind = outer.vertices - thickness * outer.normals
    inner = _unfolded(behind, outer.vertices, outer.triangles)
    if np.linalg.norm(inner - behind, axis=1).max() > ALLOWED * thickness:
        raise ValueError(
            f"the face is too small or too curved for {thickness:g} mm; "
            "choose a smaller thickness"
        )
    count = len(outer.vertices)
    rim = border_edges(outer.triangles)
    a, b = rim.T
    walls = np.concatenate(
        [
            np.stack([b, a, a + count], axis=1),
            np.stack([b, a + count, b + count], axis=1),
        ]
    )
    triangles = np.concatenate(
        [outer.triangles, outer.triangles[:, ::-1] + count, walls]
    )
    return np.concatenate([outer.vertices, inner]), triangles


def border_edges(triangles: Indices) -> Indices:
    """Directed edges with a triangle on one side only, (k, 2)."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]]])
    edges = np.concatenate([edges, triangles[:, [2, 0]]])
    size = int(triangles.max()) + 1
    number = edges[:, 0] * size + edges[:, 1]
    back = edges[:, 1] * size + edges[:, 0]
    return edges[~np.isin(number, back)]


def volume(points: Array, triangles: Indices) -> float:
    """Volume of a closed mesh, mm^3."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6)


def _unfolded(inner: Array, outer: Array, triangles: Indices) -> Array:
    """The inner points, smoothed where a triangle is turned over."""
    count = len(inner)
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]]])
    edges = np.concatenate([edges, triangles[:, [2, 0]]])
    A = sparse.coo_array((np.ones(len(edges)), edges.T), shape=(count, count))
    A = ((A + A.T) > 0).astype(float).tocsr()
    mean = sparse.diags_array(1 / np.asarray(A.sum(axis=1)).ravel()) @ A
    front, sides = _normals(outer, triangles), _sides(outer, triangles)
    inner = inner.copy()
    # Triangles that were slivers before have no direction to lose.
    real = np.linalg.norm(front, axis=1) > 1e-9
    worst = 0
    for _ in range(ROUNDS):
        behind = _normals(inner, triangles)
        # Past both centres of curvature a triangle faces forwards again, turned round.
        bad = (behind * front).sum(axis=1) <= 0
        bad |= ((_sides(inner, triangles) * sides).sum(axis=2) <= 0).any(axis=1)
        bad &= real
        if not bad.any():
            return inner
        move = np.zeros(count, bool)
        move[triangles[bad]] = True
        move |= (A @ move) > 0
        worst = int(bad.sum())
        inner[move] = (mean @ inner)[move]
    raise ValueError(
        f"the inside of the solid folds in {worst} triangles; "
        "choose a smaller thickness"
    )


def _normals(points: Array, triangles: Indices) -> Array:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def _sides(points: Array, triangles: Indices) -> Array:
    corner = points[triangles]
    return np.roll(corner, -1, axis=1) - corner
