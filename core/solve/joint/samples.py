"""Sample points of the face: where the shading is looked at, and the basis there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import sparse

from ..._types import Array
from ...photometry.transfer import Transfer, radiance_transfer
from ...surface.bspline import BSplineSurface, basis_matrix, unit_normals
from ...surface.template import Template
from .options import Level
from .state import State


class Geometry(NamedTuple):
    """The samples on the faces of k photos, or of all of them (k = 1).

    Attributes
    ----------
    points, normals : (k, p, 3) arrays
    g_u, g_v : (k, p, 3) arrays
        The surface gradient of f is ``g^u f_u + g^v f_v``.
    """

    points: Array
    normals: Array
    g_u: Array
    g_v: Array


class Samples(NamedTuple):
    """What one level of the joint refinement keeps.

    Attributes
    ----------
    level : Level
    uv : (p, 2) array
    T : list of three (p, M*N) sparse arrays
        ``T, T1, T2`` there.
    area : (p,) array
        Area of the surface that each point stands for, mean 1.
    expressions : list of three (e, p, 3) arrays
        Displacement of the points and of their two slopes by each expression mode.
    transfer : Transfer
        What the face leaves open of the sky at each point.
    """

    level: Level
    uv: Array
    T: list[sparse.csr_array]
    area: Array
    expressions: list[Array]
    transfer: Transfer

    def geometry(self, surface: BSplineSurface, expressions: Array) -> Geometry:
        """Where the samples are on the face of each photo, expressions (n, e)."""
        if expressions.shape[1] == 0:
            expressions = expressions[:1]
        at = zip(self.T, self.expressions, strict=True)
        X, fu, fv = (
            t @ surface.vector + np.tensordot(expressions, move, 1) for t, move in at
        )
        return Geometry(X, unit_normals(fu, fv), *contravariant(fu, fv))


def contravariant(fu: Array, fv: Array) -> tuple[Array, Array]:
    """``g^u, g^v``: the surface gradient of f is ``g^u f_u + g^v f_v``.

    ``(..., 3)`` each.
    """
    E, F, G = (fu * fu).sum(-1), (fu * fv).sum(-1), (fv * fv).sum(-1)
    det = np.maximum(E * G - F * F, 1e-9)[..., None]
    return (
        (G[..., None] * fu - F[..., None] * fv) / det,
        (E[..., None] * fv - F[..., None] * fu) / det,
    )


def sample_grid(template: Template, grid: int) -> Array:
    """Skin points on a regular grid of (u, v), ``(p, 2)``."""
    x = (np.arange(grid) + 0.5) / grid
    uv = np.stack(np.meshgrid(x, x, indexing="ij"), -1).reshape(-1, 2)
    keep = template.is_skin(uv)
    for dx, dy in ((0.01, 0), (-0.01, 0), (0, 0.01), (0, -0.01)):
        keep &= template.is_skin(np.clip(uv + (dx, dy), 0, 1))
    return uv[keep]


def sample_surface(state: State, level: Level, shadows: bool) -> Samples:
    """The samples of one level.

    The reference of the model weighs them by area; the face of ``state`` casts the
    shadows, if there are to be any.
    """
    model, surface = state.model, state.surface
    uv = sample_grid(model.template, level.grid)
    u, v = uv.T
    T = [basis_matrix(surface.shape, u, v, *k) for k in ((0, 0), (1, 0), (0, 1))]
    reference = model.reference
    fu, fv = reference.evaluate(u, v, du=1), reference.evaluate(u, v, dv=1)
    area = np.linalg.norm(np.cross(fu, fv), axis=1)
    modes = [mode.reshape(-1, 3) for mode in model.expression_modes]
    expressions = [
        np.array([t @ mode for mode in modes]).reshape(len(modes), len(uv), 3)
        for t in T
    ]
    transfer = radiance_transfer(surface, uv, level.degree, shadows)
    return Samples(level, uv, T, area / area.mean(), expressions, transfer)
