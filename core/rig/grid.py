"""A grid of quads over the face: trimmed to the outline, slit at lids and lips.

A regular grid of the square is laid into the outline so that its border is the outline
and no quad is cut. A slit is a piece of one grid row whose inner vertices are there
twice; its two banks are laid on the two lids, or both on the line between the lips. All
other vertices are relaxed to the mean of their neighbours (a discrete harmonic map).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from .._types import Array, Indices


@dataclass(frozen=True)
class Slit:
    """Where a grid is opened.

    Attributes
    ----------
    upper, lower : (k, 2) arrays
        The banks in (u, v), u rising, both from the same corner to the same corner.
    """

    upper: Array
    lower: Array


@dataclass(frozen=True)
class SlitGrid:
    """Quads over (u, v).

    Attributes
    ----------
    uv : (p, 2) array
        v downwards.
    quads : (q, 4) int array
        Counter-clockwise seen from outside.
    banks : tuple of (upper, lower)
        Vertex indices of the two banks of each slit, u rising; corners are in both.
    side : (slits, p) array
        For each slit +1 above the slit's row, -1 below and 0 on it; the banks count as
        above and below.
    """

    uv: Array
    quads: Indices
    banks: tuple[tuple[Indices, Indices], ...]
    side: Array


def slit_grid(
    outline_uv: Array, slits: tuple[Slit, ...], cells: tuple[int, int]
) -> SlitGrid:
    """Lay a grid into an outline and open it.

    Parameters
    ----------
    outline_uv : (k, 2) array
        Closed polygon, seen from its middle without overlap.
    slits : tuple of Slit
        Must not touch each other or the outline.
    cells : (int, int)
        Quads along u and v.
    """
    nu, nv = cells[0] + 1, cells[1] + 1
    number = np.arange(nu * nv).reshape(nu, nv)
    a, b = np.meshgrid(np.arange(nu), np.arange(nv), indexing="ij")
    border = (a == 0) | (a == nu - 1) | (b == 0) | (b == nv - 1)
    square = np.stack([a / (nu - 1), b / (nv - 1)], axis=-1)
    rim = number[border]
    rim_uv = _onto_outline(square[border], np.asarray(outline_uv, float))
    quads = np.stack(
        [number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1
    )
    flat = quads.reshape(-1, 4)
    uv = _relaxed(flat, nu * nv, rim, rim_uv)

    places = [_place(uv.reshape(nu, nv, 2), slit) for slit in slits]
    banks, fixed, fixed_uv = [], [rim], [rim_uv]
    count = nu * nv
    side = np.zeros((len(slits), nu * nv))
    owner = list(range(nu * nv))
    for k, (slit, (row, first, last)) in enumerate(zip(slits, places, strict=True)):
        upper = number[first : last + 1, row]
        inner = np.arange(count, count + last - first - 1)
        count += len(inner)
        owner += upper[1:-1].tolist()
        lower = np.concatenate([upper[:1], inner, upper[-1:]])
        below = quads[first:last, row]
        for corner, bank in ((0, lower[:-1]), (3, lower[1:])):
            below[:, corner] = bank
        banks.append((upper, lower))
        share = np.linspace(0, 1, last - first + 1)
        fixed += [upper, inner]
        fixed_uv += [along(slit.upper, share), along(slit.lower, share[1:-1])]
        side[k] = np.sign(row - b).ravel()
    flat = quads.reshape(-1, 4)
    side = side[:, owner]
    for k, (upper, lower) in enumerate(banks):
        side[k, upper[1:-1]], side[k, lower[1:-1]] = 1, -1
    uv = _relaxed(flat, count, np.concatenate(fixed), np.concatenate(fixed_uv))
    return SlitGrid(uv, flat, tuple(banks), side)


def _place(uv: Array, slit: Slit) -> tuple[int, int, int]:
    """Row, first and last column of the grid that lie nearest to the slit."""
    corners = slit.upper[[0, -1]]
    middle = corners.mean(axis=0)
    column = int(np.abs(uv[:, uv.shape[1] // 2, 0] - middle[0]).argmin())
    row = int(np.abs(uv[column, :, 1] - middle[1]).argmin())
    first, last = (int(np.abs(uv[:, row, 0] - x).argmin()) for x in corners[:, 0])
    if last - first < 2 or not 0 < row < uv.shape[1] - 1:
        raise ValueError("the grid is too coarse for its slits")
    return row, first, last


def along(curve: Array, share: Array) -> Array:
    """Points of a polygon at shares of its length."""
    length = np.r_[0, np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))]
    at = share * length[-1]
    return np.stack([np.interp(at, length, c) for c in curve.T], axis=1)


def _onto_outline(square: Array, outline: Array) -> Array:
    """Border points of the unit square moved along the rays from its middle."""
    centre = (outline.min(axis=0) + outline.max(axis=0)) / 2
    ray = square - 0.5
    polar = np.arctan2(*(outline - centre).T[::-1])
    order = np.argsort(polar)
    # Every ray is cut with the side of the polygon that it crosses.
    corner = np.concatenate([outline[order], outline[order[:1]]]) - centre
    angle = np.concatenate([polar[order], polar[order[:1]] + 2 * np.pi])
    at = np.arctan2(ray[:, 1], ray[:, 0])
    at = np.where(at < angle[0], at + 2 * np.pi, at)
    k = np.clip(np.searchsorted(angle, at, side="right") - 1, 0, len(order) - 1)
    p, d = corner[k], corner[k + 1] - corner[k]
    cross = ray[:, 0] * d[:, 1] - ray[:, 1] * d[:, 0]
    reach = (p[:, 0] * d[:, 1] - p[:, 1] * d[:, 0]) / cross
    return centre + reach[:, None] * ray


def _relaxed(quads: Indices, count: int, fixed: Indices, values: Array) -> Array:
    """Every free vertex the mean of its neighbours along the edges of the quads."""
    edges = np.concatenate([quads[:, [k, (k + 1) % 4]] for k in range(4)])
    A = sparse.coo_array((np.ones(len(edges)), edges.T), shape=(count, count))
    A = ((A + A.T) > 0).astype(float).tocsr()
    L = sparse.csr_array(sparse.diags_array(np.asarray(A.sum(axis=1)).ravel()) - A)
    free = np.setdiff1d(np.arange(count), fixed)
    uv = np.zeros((count, 2))
    uv[fixed] = values
    rows = L[free]
    solve = splu(sparse.csc_array(rows[:, free]), permc_spec="MMD_AT_PLUS_A").solve
    uv[free] = solve(-(rows[:, fixed] @ values))
    return uv
