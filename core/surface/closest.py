"""The points of a surface that are closest to given ones: Newton's method, damped."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from .._types import Array

if TYPE_CHECKING:
    from .bspline import BSplineSurface


def closest_points(
    surface: BSplineSurface, q: Array, iterations: int
) -> tuple[Array, Array]:
    """See `BSplineSurface.closest_point`, for finite points ``q`` (p, 3)."""
    u, v = (np.linspace(0, 1, 4 * (c - 3) + 1) for c in surface.shape)
    u, v = (x.ravel() for x in np.meshgrid(u, v, indexing="ij"))
    _, nearest = cKDTree(surface.evaluate(u, v)).query(q)
    uv = np.stack([u[nearest], v[nearest]], 1)
    best = np.linalg.norm(surface.evaluate(*uv.T) - q, axis=1)
    step = np.ones(len(q))
    for _ in range(iterations):
        r = q - surface.evaluate(*uv.T)
        fu, fv = surface.evaluate(*uv.T, du=1), surface.evaluate(*uv.T, dv=1)
        a, b = (r * fu).sum(1), (r * fv).sum(1)
        e, f, g = (fu * fu).sum(1), (fu * fv).sum(1), (fv * fv).sum(1)
        # Newton where the distance is convex: far from a curved surface the tangent
        # plane alone converges slowly
        ne = e - (r * surface.evaluate(*uv.T, du=2)).sum(1)
        nf = f - (r * surface.evaluate(*uv.T, du=1, dv=1)).sum(1)
        ng = g - (r * surface.evaluate(*uv.T, dv=2)).sum(1)
        convex = (ne > 0.1 * e) & (ng > 0.1 * g) & (ne * ng > 1.1 * nf * nf)
        e, f, g = (
            np.where(convex, new, old) for new, old in ((ne, e), (nf, f), (ng, g))
        )
        det = np.maximum(e * g - f * f, 1e-12 * np.maximum(e * g, 1e-30))
        move = np.stack([(g * a - f * b) / det, (e * b - f * a) / det], 1)
        # on the border only along it, unless the step leads back inside
        along_v, along_u = b / np.maximum(g, 1e-30), a / np.maximum(e, 1e-30)
        for k, alone in ((0, along_v), (1, along_u)):
            x, dx = uv[:, k], move[:, k]
            out = ((x <= 0) & (dx < 0)) | ((x >= 1) & (dx > 0))
            move[out, k], move[out, 1 - k] = 0.0, alone[out]
        trial = np.clip(uv + step[:, None] * move, 0, 1)
        d = np.linalg.norm(surface.evaluate(*trial.T) - q, axis=1)
        better = d < best
        uv[better], best[better] = trial[better], d[better]
        step = np.where(better, np.minimum(1.0, 2 * step), step / 2)
        if not better.any() and (step < 1e-3).all():
            break
    return uv, best
