"""Triangles on a B-spline surface at a chosen tolerance, millimetres.

The (u, v) square is cut into a grid whose lines lie on the knots and, between them, as
densely as the second derivatives ask for; the grid is clipped at the outline. All
vertices lie on the surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .._types import Array
from ..surface.bspline import BSplineSurface
from .clipping import clip_mesh


@dataclass(frozen=True)
class Mesh:
    """Triangles on a surface.

    Attributes
    ----------
    vertices, normals : (k, 3) arrays
        Millimetres; outward unit normals.
    uv : (k, 2) array
        Parameters of the core, v downwards.
    triangles : (t, 3) int array
        Counter-clockwise seen from outside.
    deviation : float
        Largest distance found between surface and triangles, mm.
    """

    vertices: Array
    normals: Array
    uv: Array
    triangles: npt.NDArray[np.int64]
    deviation: float


def tessellate(
    surface: BSplineSurface,
    outline_uv: npt.ArrayLike | None = None,
    tolerance: float = 0.05,
    max_vertices: int = 4_000_000,
) -> Mesh:
    """Triangles that stay within ``tolerance`` of the surface.

    Parameters
    ----------
    surface : BSplineSurface
    outline_uv : (k, 2) array, optional
        Outline in (u, v); the whole surface without it.
    tolerance : float
        Millimetres.
    max_vertices : int
        Refuse to make more.

    Raises
    ------
    ValueError
        When the tolerance is not positive or asks for too many vertices.
    """
    if not tolerance > 0:
        raise ValueError(f"tolerance must be a positive length in mm, got {tolerance}")
    share = 1.0
    while True:
        lines = _grid_lines(surface, tolerance * share)
        if len(lines[0]) * len(lines[1]) > max_vertices:
            raise ValueError(
                f"a tolerance of {tolerance:g} mm needs more than {max_vertices} "
                "vertices; choose a larger one"
            )
        uv, triangles = _grid(*lines)
        if outline_uv is not None:
            uv, triangles = clip_mesh(uv, triangles, np.asarray(outline_uv, float))
        vertices = surface.evaluate(uv[:, 0], uv[:, 1])
        deviation = _deviation(surface, uv, vertices, triangles)
        if deviation <= tolerance:
            normals = surface.normals(uv[:, 0], uv[:, 1])
            return Mesh(vertices, normals, uv, triangles, deviation)
        # The estimate holds in the limit of small cells; ask for smaller ones.
        share *= 0.8 * tolerance / deviation


def _grid_lines(surface: BSplineSurface, tolerance: float) -> tuple[Array, Array]:
    """Parameters of the grid lines in u and in v.

    A chord of length h in one parameter leaves the curve by at most h^2 |F''| / 8. The
    twist F_uv adds h_u h_v |F_uv| / 4 for two triangles on a cell.
    """
    m, n = surface.shape
    # Five samples in each knot span: second derivatives are linear along it.
    per = 5
    u = np.linspace(0, 1, (m - 3) * (per - 1) + 1)
    v = np.linspace(0, 1, (n - 3) * (per - 1) + 1)
    uu, vv = np.meshgrid(u, v, indexing="ij")
    bend_u = np.linalg.norm(surface.evaluate(uu, vv, du=2), axis=2).max(axis=1)
    bend_v = np.linalg.norm(surface.evaluate(uu, vv, dv=2), axis=2).max(axis=0)
    twist = np.linalg.norm(surface.evaluate(uu, vv, du=1, dv=1), axis=2)
    # |h_u h_v F_uv| <= (h_u^2 + h_v^2) |F_uv| / 2: share it out to both directions.
    bend_u, bend_v = bend_u + twist.max(axis=1), bend_v + twist.max(axis=0)
    return (
        _subdivided(bend_u, m - 3, per, tolerance / 2),
        _subdivided(bend_v, n - 3, per, tolerance / 2),
    )


def _subdivided(bend: Array, spans: int, per: int, tolerance: float) -> Array:
    lines = [np.zeros(1)]
    for span in range(spans):
        worst = bend[span * (per - 1) : span * (per - 1) + per].max()
        step = np.sqrt(8 * tolerance / max(worst, 1e-12))
        count = max(1, int(np.ceil(1 / (spans * step))))
        lines.append((span + np.arange(1, count + 1) / count) / spans)
    joined = np.concatenate(lines)
    joined[-1] = 1.0
    return joined


def _grid(u: Array, v: Array) -> tuple[Array, npt.NDArray[np.int64]]:
    uu, vv = np.meshgrid(u, v, indexing="ij")
    nv = len(v)
    first = (np.arange(len(u) - 1)[:, None] * nv + np.arange(nv - 1)).ravel()
    below, right, across = first + 1, first + nv, first + nv + 1
    triangles = np.concatenate(
        [
            np.stack([first, below, across], axis=1),
            np.stack([first, across, right], axis=1),
        ]
    )
    return np.stack([uu.ravel(), vv.ravel()], axis=1), triangles


def _deviation(
    surface: BSplineSurface,
    uv: Array,
    vertices: Array,
    triangles: npt.NDArray[np.int64],
) -> float:
    """Largest distance between surface and mesh, at seven points a triangle.

    Measured along the triangle's normal: the distance to its plane.
    """
    weights = np.array(
        [
            [1, 1, 1],
            *([1, 1, 0], [0, 1, 1], [1, 0, 1]),
            *([4, 1, 1], [1, 4, 1], [1, 1, 4]),
        ],
        float,
    )
    weights /= weights.sum(axis=1, keepdims=True)
    corners = vertices[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, size, out=np.zeros_like(normal), where=size > 1e-12)
    worst = 0.0
    for weight in weights:
        at = np.einsum("c,tck->tk", weight, uv[triangles])
        off = surface.evaluate(at[:, 0], at[:, 1]) - corners[:, 0]
        worst = max(worst, float(np.abs((off * normal).sum(axis=1)).max(initial=0)))
    return worst
