"""What the CAD formats share: the clamped surface and its outline as curves.

CAD systems expect ``S_u x S_v`` to point outwards and some crash on unclamped knots.
The core's ``v`` runs down, so the surface leaves with ``v`` turned round: **v of a file
= 1 - v of the core**, ``u`` as it is, knots clamped on [0, 1]. Both changes are exact.
The texture coordinates of a picture whose row 0 is the top agree with it.

Trimming: the outline polygon, split at its corners, becomes a loop of cubic B-splines
in (u, v) (one closed curve where it has none), and each edge in space a cubic B-spline
of the same parameter that interpolates the surface along it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy  # its interpolate loads when it is used, in a tenth of a second

from .._types import Array
from ..surface.bspline import BSplineSurface

#: The edge in space leaves the surface by less than this, in millimetres.
EDGE_TOLERANCE_MM = 1e-4
#: More points are not tried. A face of 100 metres needs 25,000 for its outline.
MOST_EDGE_POINTS = 100_000
#: The outline has a corner where it turns by more, in degrees.
CORNER = 40.0


@dataclass(frozen=True, eq=False)
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
        spline = scipy.interpolate.BSpline(self.knots, self.control_points, 3)
        return spline(np.asarray(t, float))


#: Curves in space with their names.
NamedCurves = tuple[tuple[str, ExchangeCurve], ...]


@dataclass(frozen=True, eq=False)
class ExchangeSurface:
    """A face as CAD formats want it.

    Attributes
    ----------
    control_points : (M, N, 3) array
        Millimetres; first index u, second v of the file (upwards).
    knots_u, knots_v : (M + 4,), (N + 4,) arrays
        Clamped on [0, 1].
    outline : tuple of ExchangeCurve
        Closed loop, counter-clockwise, in (u, v) of the file; empty = not trimmed.
    edges : tuple of ExchangeCurve
        The same curves in space.
    """

    control_points: Array
    knots_u: Array
    knots_v: Array
    outline: tuple[ExchangeCurve, ...]
    edges: tuple[ExchangeCurve, ...]


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
    outline = edges = ()
    if outline_uv is not None:
        outline = outline_curves(np.asarray(outline_uv, float))
        edges = _edges(surface, outline)
    return ExchangeSurface(
        points[:, ::-1].copy(),
        knots_u,
        # Uniform knots are symmetric; turning them round only changes rounding.
        knots_v,
        outline,
        edges,
    )


def _exact_ends(knots: Array) -> Array:
    """Four equal knots at each end, to the last bit; readers compare exactly."""
    knots = knots.copy()
    knots[:4], knots[-4:] = 0.0, 1.0
    return knots


def outline_curves(outline_uv: Array, count: int = 48) -> tuple[ExchangeCurve, ...]:
    """Cubic B-splines along a polygon of the core's (u, v), ``v`` turned up.

    Parameters
    ----------
    outline_uv : (k, 2) array
    count : int
        Points at equal arc length that the curves interpolate, on the whole outline:
        few enough to smooth the steps of the polygon.

    Returns
    -------
    tuple of ExchangeCurve
        A closed loop, counter-clockwise, inside the unit square. One closed curve where
        the polygon has no corner, else one curve between every two corners.
    """
    polygon = _upwards(outline_uv)
    closed = np.vstack([polygon, polygon[:1]])
    length = np.r_[0, np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))]
    corners = _corners(polygon)
    if len(corners) < 2:
        at = np.linspace(0, length[-1], count + 1)
        points = np.stack([np.interp(at, length, c) for c in closed.T], axis=1)
        points[-1] = points[0]
        return (_inside(closed_curve(at / length[-1], points)),)
    curves = []
    for first, last in zip(corners, np.roll(corners, -1), strict=True):
        index = np.arange(first, last + 1 + (len(polygon) if last <= first else 0))
        part = polygon[index % len(polygon)]
        arc = np.r_[0, np.cumsum(np.linalg.norm(np.diff(part, axis=0), axis=1))]
        straight = part[0] + (arc / arc[-1])[:, None] * (part[-1] - part[0])
        steps = 3
        if np.abs(straight - part).max() > 1e-9:
            steps = max(6, round(count * arc[-1] / length[-1]))
        at = np.linspace(0, 1, steps + 1)
        points = np.stack([np.interp(at * arc[-1], arc, c) for c in part.T], axis=1)
        curves.append(_inside(open_curve(at, points)))
    return tuple(curves)


def _upwards(outline_uv: Array) -> Array:
    """Distinct corners, v upwards, counter-clockwise."""
    polygon = np.asarray(outline_uv, float)
    if polygon.ndim != 2 or polygon.shape[1] != 2 or len(polygon) < 3:
        raise ValueError(f"outline must be (k >= 3, 2), got {polygon.shape}")
    polygon = np.stack([polygon[:, 0], 1.0 - polygon[:, 1]], axis=1)
    distinct = np.linalg.norm(polygon - np.roll(polygon, 1, axis=0), axis=1) > 1e-9
    polygon = polygon[distinct]
    following = np.roll(polygon, -1, axis=0)
    cross = polygon[:, 0] * following[:, 1] - polygon[:, 1] * following[:, 0]
    return polygon[::-1] if cross.sum() < 0 else polygon


def _corners(polygon: Array) -> npt.NDArray[np.int64]:
    """Indices of the vertices where the outline turns sharply."""
    step = np.roll(polygon, -1, axis=0) - polygon
    direction = step[:, 0] + 1j * step[:, 1]
    turn = np.angle(direction / np.roll(direction, 1))
    return np.flatnonzero(np.abs(turn) > np.radians(CORNER))


def _inside(curve: ExchangeCurve) -> ExchangeCurve:
    # The convex hull of the control points bounds the curve.
    return ExchangeCurve(np.clip(curve.control_points, 0.0, 1.0), curve.knots)


def _edges(
    surface: BSplineSurface, outline: tuple[ExchangeCurve, ...]
) -> tuple[ExchangeCurve, ...]:
    """The curves of the outline in space."""
    make = closed_curve if len(outline) == 1 else open_curve
    return tuple(edge_in_space(surface, curve, make) for curve in outline)


def edge_in_space(
    surface: BSplineSurface,
    curve: ExchangeCurve,
    make: Callable[[Array, Array], ExchangeCurve],
    most_points: int = MOST_EDGE_POINTS,
) -> ExchangeCurve:
    """The curve in space of a curve in (u, v) of the file, with the same parameter.

    Raises
    ------
    ValueError
        When it cannot follow the surface to within `EDGE_TOLERANCE_MM`.
    """
    # A straight line in (u, v) still crosses the knots of the surface.
    count = max(64, 8 * (len(curve.control_points) - 3))
    while True:
        t = np.linspace(0, 1, count + 1)
        edge = make(t, _on_surface(surface, curve(t)))
        between = (t[:-1] + t[1:]) / 2
        off = edge(between) - _on_surface(surface, curve(between))
        farthest = np.linalg.norm(off, axis=1).max()
        if farthest < EDGE_TOLERANCE_MM:
            return edge
        if count > most_points:
            raise ValueError(
                f"a curve of {count} points leaves the surface by {farthest:.2g} mm; "
                "check the size of the face, which is in millimetres, and the points "
                "of the curve"
            )
        count *= 2


def _on_surface(surface: BSplineSurface, uv: Array) -> Array:
    return surface.evaluate(uv[:, 0], 1.0 - uv[:, 1])


def open_curve(t: Array, points: Array) -> ExchangeCurve:
    """Cubic B-spline through points at parameters ``t`` from 0 to 1."""
    spline = scipy.interpolate.make_interp_spline(t, points, k=3)
    control = np.asarray(spline.c).copy()
    control[0], control[-1] = points[0], points[-1]
    return ExchangeCurve(control, np.asarray(spline.t))


def closed_curve(t: Array, points: Array) -> ExchangeCurve:
    """Periodic cubic B-spline through points, with four knots at either end; exact.

    Between the end knots the periodic and the clamped form span the same space, so
    interpolation at the averaged knots recovers the curve.
    """
    points = np.vstack([points[:-1], points[:1]])
    spline = scipy.interpolate.make_interp_spline(t, points, k=3, bc_type="periodic")
    inner = spline.t[(spline.t > 0) & (spline.t < 1)]
    knots = np.r_[np.zeros(4), inner, np.ones(4)]
    at = np.array([knots[i + 1 : i + 4].mean() for i in range(len(knots) - 4)])
    clamped = scipy.interpolate.make_interp_spline(at, spline(at), k=3, t=knots)
    control = np.asarray(clamped.c).copy()
    control[0] = control[-1] = points[0]
    return ExchangeCurve(control, knots)
