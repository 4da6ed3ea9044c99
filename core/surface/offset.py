"""The offset of a face as a B-spline surface: every point a distance along the normal.

    O(u, v) = F(u, v) + d n(u, v)

is no spline, so it is fitted by least squares on a finer net until no sample is further
from it than the tolerance. The sample of the same (u, v) is compared, which bounds the
distance of the two surfaces. Both share (u, v), so the outline trims both alike. An
offset folds where the face is rounder than the distance (principal curvature k with
1 - d k <= 0, k > 0 where the face is hollow); there it is refused.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .._types import Array, Mask
from ..kinds import coordinates, expect, expect_number
from .bspline import BSplineSurface, segment_basis
from .template import inside_polygon

#: The net is refined by these factors, in this order.
REFINEMENTS = (1, 2, 3, 4, 6)


def offset(
    surface: BSplineSurface,
    distance: float,
    *,
    outline_uv: npt.ArrayLike | None = None,
    tolerance: float = 0.05,
) -> BSplineSurface:
    """The surface at a distance.

    Parameters
    ----------
    surface : BSplineSurface
    distance : float
        mm, positive outwards.
    outline_uv : (k, 2) array, optional
        Only what lies inside this polygon of (u, v) must be within the tolerance and
        free of folds; by default everything.
    tolerance : float
        Largest distance from the exact offset, mm.

    Returns
    -------
    BSplineSurface
        With ``f (M - 3) + 3`` control points along u, ``f`` one of `REFINEMENTS`.

    Raises
    ------
    ValueError
        When the offset folds, or the finest net is not fine enough. The sentence names
        the limit.
    """
    expect(BSplineSurface, "a BSplineSurface", surface=surface)
    expect_number(distance=distance, tolerance=tolerance)
    if not tolerance > 0 or not np.isfinite(distance):
        raise ValueError(
            f"the distance must be finite and the tolerance positive, got {distance} "
            f"and {tolerance}"
        )
    if distance == 0:
        return surface
    limit = offset_limit(surface, outline_uv, outwards=distance > 0)
    if abs(distance) >= limit:
        way = "hollow" if distance > 0 else "round"
        raise ValueError(
            f"an offset of {distance:g} mm folds, because the face is {way} somewhere "
            f"with a radius of {limit:.2f} mm; choose a smaller distance or outline"
        )
    worst = np.inf
    for factor in REFINEMENTS:
        fitted = _fitted(surface, distance, factor)
        worst = _deviation(surface, fitted, distance, outline_uv)
        if worst <= tolerance:
            return fitted
    raise ValueError(
        f"the offset is only known within {worst:.3f} mm on the finest net; choose a "
        "larger tolerance or a smaller distance"
    )


def offset_limit(
    surface: BSplineSurface,
    outline_uv: npt.ArrayLike | None = None,
    *,
    outwards: bool = True,
) -> float:
    """Smallest radius of curvature on the side of the offset, mm.

    That of hollow places for an offset outwards, of round ones for one inwards;
    infinite where there is none.
    """
    u, v = (_samples(count, 8) for count in surface.shape)
    keep = _kept(u, v, outline_uv)
    if not keep.any():
        raise ValueError("outline_uv encloses too little; give a larger outline")
    k_min, k_max = principal_curvatures(surface, u, v)
    most = k_max[keep].max() if outwards else -k_min[keep].min()
    return float(1 / most) if most > 0 else np.inf


def principal_curvatures(surface: BSplineSurface, u: Array, v: Array):
    """Principal curvatures on a grid, 1/mm, positive where the face is hollow.

    Parameters
    ----------
    surface : BSplineSurface
    u, v : (p,), (q,) arrays

    Returns
    -------
    k_min, k_max : (p, q) arrays
    """
    normal = _normals(surface, u, v)
    fu, fv = _grid(surface, u, v, 1, 0), _grid(surface, u, v, 0, 1)
    e, f, g = (fu * fu).sum(-1), (fu * fv).sum(-1), (fv * fv).sum(-1)
    second = ((2, 0), (1, 1), (0, 2))
    a, b, c = ((_grid(surface, u, v, *k) * normal).sum(-1) for k in second)
    area2 = np.maximum(e * g - f * f, 1e-12)
    mean = (e * c - 2 * f * b + g * a) / (2 * area2)
    gauss = (a * c - b * b) / area2
    root = np.sqrt(np.maximum(mean**2 - gauss, 0))
    return mean - root, mean + root


def _fitted(surface: BSplineSurface, distance: float, factor: int) -> BSplineSurface:
    """Least squares at six points a span, in one direction after the other."""
    shape = [factor * (count - 3) + 3 for count in surface.shape]
    u, v = (_samples(count, 6) for count in shape)
    net = _grid(surface, u, v) + distance * _normals(surface, u, v)
    for axis, (count, x) in enumerate(zip(shape, (u, v), strict=True)):
        value = np.moveaxis(net, axis, 0)
        solved = np.linalg.lstsq(
            _basis(count, x, 0), value.reshape(len(x), -1), rcond=None
        )[0]
        net = np.moveaxis(solved.reshape(count, *value.shape[1:]), 0, axis)
    return BSplineSurface(net)


def _deviation(
    surface: BSplineSurface,
    fitted: BSplineSurface,
    distance: float,
    outline_uv: npt.ArrayLike | None,
) -> float:
    # Other samples than those of the fit.
    u, v = (_samples(count, 7) for count in fitted.shape)
    exact = _grid(surface, u, v) + distance * _normals(surface, u, v)
    off = np.linalg.norm(_grid(fitted, u, v) - exact, axis=-1)
    return float(off[_kept(u, v, outline_uv)].max())


def _samples(count: int, per_span: int) -> Array:
    return np.linspace(0, 1, per_span * (count - 3) + 1)


def _kept(u: Array, v: Array, outline_uv: npt.ArrayLike | None) -> Mask:
    if outline_uv is None:
        return np.ones((len(u), len(v)), bool)
    outline = coordinates(outline_uv, "outline_uv", 2)
    if outline.ndim != 2 or len(outline) < 3 or not np.isfinite(outline).all():
        raise ValueError(
            f"outline_uv must be finite and (k >= 3, 2), not {outline.shape}"
        )
    uv = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)
    return inside_polygon(outline, uv)


def _basis(count: int, x: Array, order: int) -> Array:
    first, value = segment_basis(count, x, order)
    dense = np.zeros((len(x), count))
    np.put_along_axis(dense, first[:, None] + np.arange(4), value, 1)
    return dense


def _grid(surface: BSplineSurface, u: Array, v: Array, du: int = 0, dv: int = 0):
    """Points or derivatives on the grid of u and v, (p, q, 3)."""
    m, n = surface.shape
    along_u = np.tensordot(_basis(m, u, du), surface.control_points, (1, 0))
    return np.einsum("qj,pjc->pqc", _basis(n, v, dv), along_u, optimize=True)


def _normals(surface: BSplineSurface, u: Array, v: Array) -> Array:
    h = np.cross(_grid(surface, u, v, 0, 1), _grid(surface, u, v, 1, 0))
    return h / np.maximum(np.linalg.norm(h, axis=-1, keepdims=True), 1e-12)
