"""Editing a face by a coarse net: the movement goes on, the detail stays.

The coarse net of ``M_c x N_c`` points spans a uniform bicubic spline of its own. Its
movement ``D`` is a spline ``d(u, v)`` that is added to the surface. The control points
of ``d`` on the fine net are its blossom at the fine knots (Ramshaw 1987): in one
direction, with the knot distance ``h``,

    b_i = d[t_i - h, t_i, t_i + h] = d(t_i) - h^2 / 6 d''(t_i),   t_i = (i - 1) h.

Where the fine knots contain the coarse ones this is knot insertion and exact; elsewhere
it is a local quasi-interpolant that reproduces every cubic polynomial. So a coarse
point moves the face within its own support of four coarse spans and nowhere else, up to
one fine span.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy import sparse

from .._types import Array
from ..kinds import expect, real_numbers
from .bspline import BSplineSurface, net_shape, segment_basis

#: Points of the coarse net: few enough to model with, enough for brows, nose and lips.
COARSE_SHAPE = (12, 14)
SIDES = ("left", "right")


@lru_cache(maxsize=16)
def prolongation(fine: int, coarse: int) -> sparse.csr_array:
    """Matrix from coarse to fine control points in one direction, (fine, coarse).

    Parameters
    ----------
    fine, coarse : int
        Numbers of control points, at least 4.
    """
    if coarse > fine:
        raise ValueError(
            f"the coarse net has more points than the fine one: {coarse} and {fine}"
        )
    h = 1.0 / (fine - 3)
    t = (np.arange(fine) - 1) * h
    first, value = segment_basis(coarse, t)
    second = segment_basis(coarse, t, 2)[1]
    data = value - h**2 / 6 * second
    # What is left of rounding would make the support look larger than it is.
    data[np.abs(data) < 1e-14] = 0.0
    rows = np.repeat(np.arange(fine), 4)
    columns = (first[:, None] + np.arange(4)).ravel()
    matrix = sparse.csr_array((data.ravel(), (rows, columns)), shape=(fine, coarse))
    matrix.eliminate_zeros()
    return matrix


def coarse_net(surface: BSplineSurface, shape: tuple[int, int] = COARSE_SHAPE) -> Array:
    """A coarse net that lies on the face, to be edited: (M_c, N_c, 3), mm.

    The least-squares approximation of the surface. Only its movement counts, so what it
    smooths away is not lost.
    """
    shape = net_shape(shape)
    _check(surface, shape)
    return surface.resampled(shape).control_points


def apply_coarse(
    surface: BSplineSurface, before: Array, after: Array
) -> BSplineSurface:
    """The surface moved along with its coarse net.

    Parameters
    ----------
    surface : BSplineSurface
    before, after : (M_c, N_c, 3) arrays
        The coarse net, mm, as `coarse_net` gave it and after the edit.

    Returns
    -------
    BSplineSurface
        With the same number of control points; the surface itself where nothing moved.
    """
    before, after = np.asarray(before, float), np.asarray(after, float)
    if before.shape != after.shape or before.ndim != 3 or before.shape[2] != 3:
        raise ValueError(
            "the coarse nets must both be (M, N, 3), got "
            f"{before.shape} and {after.shape}"
        )
    movement = after - before
    if not np.isfinite(movement).all():
        raise ValueError("the coarse nets hold numbers that are not finite")
    if not movement.any():
        return surface
    return BSplineSurface(surface.control_points + prolonged(movement, surface.shape))


def prolonged(movement: Array, shape: tuple[int, int]) -> Array:
    """Movement of a coarse net as movement of a fine one.

    Parameters
    ----------
    movement : (M_c, N_c, 3) array
    shape : (M, N)

    Returns
    -------
    (M, N, 3) array
    """
    m, n = shape
    along_u = prolongation(m, movement.shape[0]) @ movement.reshape(len(movement), -1)
    along_u = along_u.reshape(m, movement.shape[1], -1)
    along_v = prolongation(n, movement.shape[1]) @ along_u.transpose(1, 0, 2).reshape(
        movement.shape[1], -1
    )
    return np.asarray(along_v).reshape(n, m, -1).transpose(1, 0, 2)


def mirrored_edit(before: Array, after: Array, side: str | None = None) -> Array:
    """An edit of one half of a net done to the other half as well.

    Parameters
    ----------
    before, after : (M, N, 3) arrays
        A net, coarse or fine, before and after the edit; first index u.
    side : "left" or "right", optional
        The half that was edited, as in the picture: "left" is small u, x < 0. By
        default of every two partners the one that moved further.

    Returns
    -------
    (M, N, 3) array
        ``after`` with a mirror symmetric movement. Points of a middle column move
        within the plane x = 0 only. The face keeps its own asymmetry.
    """
    if side is not None and side not in SIDES:
        raise ValueError(f"side must be one of {', '.join(SIDES)}, not {side!r}")
    before, after = real_numbers(before, "before"), real_numbers(after, "after")
    if before.shape != after.shape or before.ndim != 3 or before.shape[2] != 3:
        raise ValueError(
            f"before and after must both be (M, N, 3), not {before.shape} and "
            f"{after.shape}"
        )
    movement = after - before
    if not np.isfinite(movement).all():
        raise ValueError("before and after must be finite")
    other = movement[::-1] * (-1.0, 1.0, 1.0)
    m = len(movement)
    index = np.arange(m)[:, None]
    if side is None:
        own = np.linalg.norm(movement, axis=2)
        partner = own[::-1]
        # Equal lengths: the left leads, so that the result is symmetric all the same.
        taken = (own > partner) | ((own == partner) & (2 * index < m - 1))
    else:
        taken = np.broadcast_to(
            2 * index < m - 1 if side == "left" else 2 * index > m - 1,
            movement.shape[:2],
        )
    result = np.where(taken[..., None], movement, other)
    if m % 2:
        result[m // 2] = movement[m // 2] * (0.0, 1.0, 1.0)
    return before + result


def _check(surface: BSplineSurface, shape: tuple[int, int]) -> None:
    expect(BSplineSurface, "a BSplineSurface", surface=surface)
    if min(shape) < 4 or shape[0] > surface.shape[0] or shape[1] > surface.shape[1]:
        raise ValueError(
            f"a coarse net needs 4 to {surface.shape[0]} x {surface.shape[1]} points, "
            f"got {shape[0]} x {shape[1]}"
        )
