"""Curves on the face for CAD: a seal drawn in (u, v) or from landmark to landmark.

The points become a cubic B-spline in (u, v), and the curve in space a cubic B-spline
that follows the surface along it to within 1e-4 mm (`exchange.EDGE_TOLERANCE_MM`). Pass
it on as ``ExportOptions(curves=(("seal", curve),))``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from .._types import Array
from ..kinds import expect, real_numbers
from ..surface.bspline import BSplineSurface
from ..surface.template import Template
from .exchange import ExchangeCurve, closed_curve, edge_in_space, open_curve


def curve_on_surface(
    surface: BSplineSurface, uv: npt.ArrayLike, *, closed: bool = True
) -> ExchangeCurve:
    """A smooth curve on the surface through points.

    Parameters
    ----------
    surface : BSplineSurface
        The face or its offset.
    uv : (k, 2) array
        At least four distinct points of the core's (u, v) in order; a closed curve
        returns to the first one by itself.
    closed : bool

    Raises
    ------
    ValueError
        When there are too few points, or the curve leaves the (u, v) square or cannot
        follow the surface.
    """
    expect(BSplineSurface, "a BSplineSurface", surface=surface)
    points = real_numbers(uv, "uv")
    if points.ndim != 2 or points.shape[1] != 2 or not np.isfinite(points).all():
        raise ValueError(
            f"a curve needs finite points (k, 2) in (u, v), got {points.shape}"
        )
    if closed and len(points) and np.array_equal(points[0], points[-1]):
        points = points[:-1]
    if len(points) < 4:
        raise ValueError(f"a curve needs at least 4 points, got {len(points)}")
    ring = np.vstack([points, points[:1]]) if closed else points
    # Chord lengths on the face: equal steps in (u, v) are not equal steps in space.
    there = surface.evaluate(*ring.T)
    length = np.linalg.norm(np.diff(there, axis=0), axis=1)
    if (length <= 0).any():
        raise ValueError("two points of the curve that follow each other are the same")
    at = np.r_[0, np.cumsum(length)]
    # v of the file runs upwards.
    ring = np.stack([ring[:, 0], 1 - ring[:, 1]], axis=1)
    make = closed_curve if closed else open_curve
    flat = make(at / at[-1], np.asarray(ring, float))
    drawn = flat(np.linspace(0, 1, 40 * len(ring)))
    if drawn.min() < -1e-9 or drawn.max() > 1 + 1e-9:
        raise ValueError(
            "the curve leaves the surface; keep its points further inside or closer "
            "together"
        )
    return edge_in_space(surface, flat, make)


def landmark_path(template: Template, landmarks: Sequence[int]) -> Array:
    """(u, v) of landmarks, (k, 2), as points for `curve_on_surface`.

    Parameters
    ----------
    template : Template
    landmarks : sequence of int
        Numbers of the 468 in order.
    """
    numbers = np.asarray(landmarks)
    if numbers.ndim != 1 or numbers.dtype.kind not in "iu" or not numbers.size:
        raise ValueError("landmarks must be a list of whole numbers, such as [6, 198]")
    if numbers.min() < 0 or numbers.max() >= len(template.landmark_uv):
        raise ValueError(
            f"landmarks have numbers from 0 to {len(template.landmark_uv) - 1}"
        )
    return template.landmark_uv[numbers]
