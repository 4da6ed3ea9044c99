"""A displacement of a part of a mesh, continued smoothly over the rest.

The smallest thin-plate energy with a pull to zero far away,

    sum_i m_i |(M^-1 L d)_i|^2 + r^-4 m_i |d_i|^2 + w_i m_i |d_i - g_i|^2,

where ``L`` is the cotangent Laplacian, ``m`` the area of the vertices, ``r`` the reach,
``g`` a given displacement and ``w`` how much it counts; where ``w`` is infinite,
``d = g``. The surface and its tangent go on across the seam, since the energy has
second derivatives.
Reference: Botsch and Sorkine, On Linear Variational Surface Deformation Methods, IEEE
TVCG 2008, section 3.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from .._types import Array, Indices


class Continuation:
    """The linear map from given displacements to those of all vertices.

    Parameters
    ----------
    points : (p, 3) array
    quads : (q, 4) int array
    weight : (p,) array
        0 where nothing is given, ``inf`` where the given displacement holds, between
        them mm^-4.
    reach : float
        mm over which a displacement fades out away from the part that is given.
    """

    def __init__(self, points: Array, quads: Indices, weight: Array, reach: float):
        L, area = cotangent_laplacian(points, quads)
        self.fixed, self.free = np.isinf(weight), ~np.isinf(weight)
        soft = np.where(self.fixed, 0.0, weight)
        energy = L.T @ sparse.diags_array(1 / area) @ L
        energy = energy + sparse.diags_array(area * (soft + reach**-4))
        rows = sparse.csr_array(energy)[self.free]
        self.towards = sparse.diags_array((area * soft)[self.free])
        self.from_fixed = rows[:, self.fixed]
        inner = sparse.csc_array(rows[:, self.free])
        # Positive definite: it needs no pivoting, which would spoil the order.
        self.solve = splu(
            inner,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        ).solve

    def __call__(self, given: Array) -> Array:
        """Displacements of all vertices.

        Parameters
        ----------
        given : (p, k) array
            Read where the weight is not zero.
        """
        found = np.array(given, float)
        pull = self.towards @ found[self.free] - self.from_fixed @ found[self.fixed]
        found[self.free] = self.solve(pull)
        return found


def cotangent_laplacian(
    points: Array, quads: Indices
) -> tuple[sparse.csr_array, Array]:
    """Laplacian of a mesh of quads (Pinkall and Polthier 1993) and vertex areas, mm^2.

    Each quad counts as the mean of its two divisions into triangles.
    """
    a, b, c, d = quads.T
    triangles = np.concatenate(
        [np.stack(corner, 1) for corner in ((a, b, c), (a, c, d), (b, c, d), (b, d, a))]
    )
    count = len(points)
    rows, columns, weights = [], [], []
    for k in range(3):
        i, j, opposite = (triangles[:, (k + step) % 3] for step in range(3))
        p, q = points[i] - points[opposite], points[j] - points[opposite]
        size = np.linalg.norm(np.cross(p, q), axis=1)
        cotangent = (p * q).sum(axis=1) / np.maximum(size, 1e-9)
        rows.append(i)
        columns.append(j)
        weights.append(cotangent / 4)
    i, j, w = map(np.concatenate, (rows, columns, weights))
    W = sparse.coo_array((w, (i, j)), shape=(count, count)).tocsr()
    W = W + W.T
    L = sparse.csr_array(sparse.diags_array(np.asarray(W.sum(axis=1)).ravel()) - W)
    corner = points[triangles]
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    third = np.linalg.norm(across, axis=1) / 12
    area = np.zeros(count)
    np.add.at(area, triangles.ravel(), np.repeat(third, 3))
    return L, area
