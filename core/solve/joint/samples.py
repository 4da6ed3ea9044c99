"""Sample points of the face: where the shading is looked at, and the basis there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from ...photometry.transfer import Transfer, radiance_transfer
from ...surface.bspline import BSplineSurface, basis_matrix
from ...surface.template import Template
from .system import contravariant

Array = NDArray[np.float64]


class Samples(NamedTuple):
    """What one level of the joint refinement keeps.

    Attributes
    ----------
    uv : (p, 2) array
    T : list of three (p, M*N) sparse arrays
        ``T, T1, T2`` there.
    area : (p,) array
        Area of the surface that each point stands for, mean 1.
    moves : list of three (k, p, 3) arrays
        Displacement of the points and of their two slopes by the expression of each
        photo; ``k`` is 1 if no photo has one.
    over : Sky
        What the face leaves open of the sky at each point.
    """

    uv: Array
    T: list[sparse.csr_array]
    area: Array
    expression_offsets: list[Array]
    transfer: Transfer

    def geometry(
        self, surface: BSplineSurface
    ) -> tuple[Array, Array, list[tuple[Array, Array]]]:
        """Points and normals (k, p, 3) and ``g^u, g^v``: of the face of each photo."""
        at = zip(self.T, self.expression_offsets, strict=True)
        X, fu, fv = (t @ surface.vector + move for t, move in at)
        N = np.cross(fv, fu)
        N /= np.maximum(np.linalg.norm(N, axis=-1, keepdims=True), 1e-12)
        up = [contravariant(a, b) for a, b in zip(fu, fv, strict=True)]
        return X, N, up


def sample_grid(template: Template, grid: int) -> Array:
    """Skin points on a regular grid of (u, v), ``(p, 2)``."""
    x = (np.arange(grid) + 0.5) / grid
    uv = np.stack(np.meshgrid(x, x, indexing="ij"), -1).reshape(-1, 2)
    keep = template.is_skin(uv)
    for dx, dy in ((0.01, 0), (-0.01, 0), (0, 0.01), (0, -0.01)):
        keep &= template.is_skin(uv + (dx, dy))
    return uv[keep]


def sample_surface(
    template: Template,
    reference: BSplineSurface,
    surface: BSplineSurface,
    grid: int,
    own: Array,
    degree: int,
    shadows: bool,
) -> Samples:
    """The samples of one level.

    Parameters
    ----------
    template : Template
    reference, surface : BSplineSurface
        The face that weighs the points by area, and that which casts the shadows.
    grid : int
        Points a side of the parameter square, before what is no skin is left out.
    own : (n, M, N, 3) array
        Displacement of the control points by the expression of each photo.
    degree : int
        Of the light.
    shadows : bool
        Whether the face hides a part of the sky from itself.
    """
    uv = sample_grid(template, grid)
    u, v = uv.T
    T = [basis_matrix(surface.shape, u, v, *k) for k in ((0, 0), (1, 0), (0, 1))]
    fu, fv = reference.evaluate(u, v, du=1), reference.evaluate(u, v, dv=1)
    area = np.linalg.norm(np.cross(fu, fv), axis=1)
    kept = own if own.any() else own[:1]
    expression_offsets = [np.stack([t @ e.reshape(-1, 3) for e in kept]) for t in T]
    transfer = radiance_transfer(surface, uv, degree, shadows)
    return Samples(uv, T, area / area.mean(), expression_offsets, transfer)
