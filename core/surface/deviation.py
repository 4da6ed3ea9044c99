"""How far points, such as the vertices of an imported mesh, lie from a face."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .._types import Array, Indices
from ..kinds import expect, expect_whole, real_numbers
from .bspline import BSplineSurface
from .template import inside_polygon


@dataclass(frozen=True, eq=False)
class Deviation:
    """Distances of points from a surface.

    Attributes
    ----------
    points : (p, 3) array
        Those that were measured, mm.
    uv : (p, 2) array
        Where their closest points lie.
    distance : (p,) array
        mm, positive outside (in front), negative inside.
    outside : int
        Points that lie beside the face: their closest point is on its border or
        outside the outline. They are not measured.
    """

    points: Array
    uv: Array
    distance: Array
    outside: int

    def summary(self) -> str:
        """One line for people."""
        if not len(self.distance):
            return "no point lies on the face"
        size = np.abs(self.distance)
        return (
            f"{len(size)} points: mean {size.mean():.3f} mm, rms "
            f"{np.sqrt((size**2).mean()):.3f}, 95 % below "
            f"{np.percentile(size, 95):.3f}, largest {size.max():.3f} mm; "
            f"{self.distance.mean():+.3f} mm on average (+ = in front of the face); "
            f"{self.outside} points beside the face"
        )


def deviation(
    surface: BSplineSurface,
    points: npt.ArrayLike,
    outline_uv: npt.ArrayLike | None = None,
    *,
    most: int = 20_000,
) -> Deviation:
    """Measure points against a surface, in the coordinates that they have.

    Parameters
    ----------
    surface : BSplineSurface
    points : (p, 3) array
        mm, in the axes of the face: nothing is aligned.
    outline_uv : (k, 2) array, optional
        Outline of the face; the whole patch without it.
    most : int
        Of more points, every k-th in their order is measured.
    """
    expect(BSplineSurface, "a BSplineSurface", surface=surface)
    expect_whole(1, 10**9, most=most)
    q = real_numbers(points, "points")
    if q.ndim != 2 or q.shape[1] != 3 or not len(q) or not np.isfinite(q).all():
        raise ValueError(f"points must be finite and (p, 3), got {q.shape}")
    q = q[:: -(-len(q) // most)]
    uv, length = surface.closest_point(q)
    on = ((uv > 0) & (uv < 1)).all(axis=1)
    if outline_uv is not None:
        on &= inside_polygon(np.asarray(outline_uv, float), uv)
    kept: Indices = np.flatnonzero(on)
    away = q[kept] - surface.evaluate(*uv[kept].T)
    sign = np.where((away * surface.normals(*uv[kept].T)).sum(axis=1) < 0, -1.0, 1.0)
    return Deviation(q[kept], uv[kept], sign * length[kept], len(q) - len(kept))
