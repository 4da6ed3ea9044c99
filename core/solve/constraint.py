"""Control points that a person placed: the surface moved smoothly until they fit."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.sparse.linalg import splu

from ..problem import Constraint
from ..surface.bspline import BSplineSurface
from ..surface.prior import ShapePrior


def hold(
    surface: BSplineSurface,
    target: ArrayLike,
    constraint: Constraint,
    prior: ShapePrior,
) -> BSplineSurface:
    """The surface moved smoothly so that some control points are where they belong.

    The displacement ``d`` has the smooth part of the shape prior, with precision ``Q``,
    and is observed at the constrained points: ``(Q + D) d = D r``, with ``D`` their
    precision and ``r`` the way to their targets.

    Parameters
    ----------
    surface : BSplineSurface
    target : (M, N, 3) array
        Where the control points belong, mm; only the constrained ones count.
    constraint : Constraint
    prior : ShapePrior
        With the surface's net.

    Raises
    ------
    ValueError
        If the sizes of the nets differ.
    """
    points = np.asarray(constraint.points, bool)
    if points.shape != surface.shape or np.shape(target) != (*surface.shape, 3):
        raise ValueError(
            f"the constraint must have the shape of the net {surface.shape}, got "
            f"{points.shape} and {np.shape(target)}"
        )
    if not points.any():
        return surface
    precision = constraint.precision
    r = (np.asarray(target, float) - surface.control_points).reshape(-1, 3)
    A = sparse.csc_array(prior.smooth + sparse.diags_array(precision))
    d = splu(A).solve(precision[:, None] * r)
    return BSplineSurface(surface.control_points + d.reshape(*surface.shape, 3))
