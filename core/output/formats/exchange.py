"""What the CAD formats share: the clamped surface and its outline as curves.

CAD systems expect ``S_u x S_v`` to point outwards and some crash on unclamped knots.
The core's ``v`` runs down, so the surface leaves with ``v`` turned round: **v of a file
= 1 - v of the core**, ``u`` as it is, knots clamped on [0, 1]. Both changes are exact.
The texture coordinates of a picture whose row 0 is the top agree with it.

Trimming: the outline polygon becomes a closed cubic B-spline in (u, v), and the edge in
space a cubic B-spline of the same parameter that interpolates the surface along it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.interpolate import BSpline, make_interp_spline

from ...surface.bspline import BSplineSurface

Array = npt.NDArray[np.float64]

#: The edge in space leaves the surface by less than this, in millimetres.
EDGE_TOLERANCE_MM = 1e-4


@dataclass(frozen=True)
class ExchangeCurve:
    """Clamped cubic B-spline curve on [0, 1].

    Attributes
    ----------
    control_points : (k, 2) or (k, 3) array
        (u, v) of the file, or millimetres.
    knots : (k + 4,) array
    """

    control_points: Array
    knots: Array

    def __call__(self, t: npt.ArrayLike) -> Array:
        """Points at parameters ``t``."""
        return BSpline(self.knots, self.control_points, 3)(np.asarray(t, float))


@dataclass(frozen=True)
class ExchangeSurface:
    """A face as CAD formats want it.

    Attributes
    ----------
    control_points : (M, N, 3) array
        Millimetres; first index u, second v of the file (upwards).
    knots_u, knots_v : (M + 4,), (N + 4,) arrays
        Clamped on [0, 1].
    outline : ExchangeCurve or None
        Closed, counter-clockwise, in (u, v) of the file.
    edge : ExchangeCurve or None
        The same curve in space.
    """

    control_points: Array
    knots_u: Array
    knots_v: Array
    outline: ExchangeCurve | None
    edge: ExchangeCurve | None


def exchange_surface(
    surface: BSplineSurface, outline_uv: npt.ArrayLike | None = None
) -> ExchangeSurface:
    """Clamp a surface, turn its ``v`` upwards and make the curves of its outline.

    Parameters
    ----------
    surface : BSplineSurface
    outline_uv : (k, 2) array, optional
        Closed polygon in the core's (u, v); without it the surface is not trimmed.
    """
    points, knots_u, knots_v = surface.clamped()
    knots_u, knots_v = _exact_ends(knots_u), _exact_ends(knots_v)
    outline = edge = None
    if outline_uv is not None:
        outline = outline_curve(np.asarray(outline_uv, float))
        edge = _edge(surface, outline)
    return ExchangeSurface(
        points[:, ::-1].copy(),
        knots_u,
        # Uniform knots are symmetric; turning them round only changes rounding.
        knots_v,
        outline,
        edge,
    )


def _exact_ends(knots: Array) -> Array:
    """Four equal knots at each end, to the last bit; readers compare exactly."""
    knots = knots.copy()
    knots[:4], knots[-4:] = 0.0, 1.0
    return knots


def outline_curve(outline_uv: Array, count: int = 48) -> ExchangeCurve:
    """Closed cubic B-spline near a polygon of the core's (u, v), ``v`` turned up.

    Parameters
    ----------
    outline_uv : (k, 2) array
    count : int
        Distinct points that the curve interpolates, at equal arc length: few enough to
        smooth the polygon's corners.

    Returns
    -------
    ExchangeCurve
        Counter-clockwise; inside the unit square.
    """
    polygon = np.asarray(outline_uv, float)
    if polygon.ndim != 2 or polygon.shape[1] != 2 or len(polygon) < 3:
        raise ValueError(f"outline must be (k >= 3, 2), got {polygon.shape}")
    if np.allclose(polygon[0], polygon[-1]):
        polygon = polygon[:-1]
    polygon = np.stack([polygon[:, 0], 1.0 - polygon[:, 1]], axis=1)
    following = np.roll(polygon, -1, axis=0)
    cross = polygon[:, 0] * following[:, 1] - polygon[:, 1] * following[:, 0]
    if cross.sum() < 0:
        polygon = polygon[::-1]
    closed = np.vstack([polygon, polygon[:1]])
    length = np.r_[0, np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))]
    at = np.linspace(0, length[-1], count + 1)
    points = np.stack([np.interp(at, length, closed[:, c]) for c in (0, 1)], axis=1)
    points[-1] = points[0]
    spline = make_interp_spline(at / length[-1], points, k=3, bc_type="periodic")
    curve = _clamp(spline)
    # The convex hull of the control points bounds the curve.
    inside = np.clip(curve.control_points, 0.0, 1.0)
    inside[-1] = inside[0]
    return ExchangeCurve(inside, curve.knots)


def _edge(surface: BSplineSurface, outline: ExchangeCurve) -> ExchangeCurve:
    count = 8 * (len(outline.control_points) - 3)
    while True:
        # The spline's own knots are kept among the samples: between them the curve in
        # space is as smooth as the surface allows.
        t = np.linspace(0, 1, count + 1)
        points = _on_surface(surface, outline(t))
        points[-1] = points[0]
        edge = _clamp(make_interp_spline(t, points, k=3, bc_type="periodic"))
        between = (t[:-1] + t[1:]) / 2
        off = np.linalg.norm(
            edge(between) - _on_surface(surface, outline(between)), 2, 1
        )
        if off.max() < EDGE_TOLERANCE_MM or count > 4000:
            return edge
        count *= 2


def _on_surface(surface: BSplineSurface, uv: Array) -> Array:
    return surface.evaluate(uv[:, 0], 1.0 - uv[:, 1])


def _clamp(spline: BSpline) -> ExchangeCurve:
    """The periodic spline on [0, 1] with four knots at either end; exact.

    Between the end knots both forms span the same space, so interpolation at the
    averaged knots recovers the curve.
    """
    inner = spline.t[(spline.t > 0) & (spline.t < 1)]
    knots = np.r_[np.zeros(4), inner, np.ones(4)]
    at = np.array([knots[i + 1 : i + 4].mean() for i in range(len(knots) - 4)])
    points = np.asarray(make_interp_spline(at, spline(at), k=3, t=knots).c).copy()
    points[-1] = points[0]
    return ExchangeCurve(points, knots)
