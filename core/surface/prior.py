"""What is known of a face before any photo: a Gaussian over its control points.

``b - b_t`` is the sum of two independent parts: a mixture of identity modes (how faces
vary, learnt from morphs of the template) and a smooth displacement that allows for
faces outside their span.  The smooth part has the precision ``tau (K^T K + l^-4 G)``
per coordinate, the bending energy of Eq. 8 with a mass term ``G`` that lets the
displacement fade over the correlation length ``l`` instead of rotating the whole face.
Shading sees the displacement along the normals; of that, the part in which the two
halves of the face differ has a smaller deviation (`ASYMMETRY`), as faces have.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from .._types import Array
from .bending import bending_matrix, mass_matrix
from .bspline import basis_matrix
from .template import Template

#: Standard deviation of what differs between the halves, relative to what they share.
ASYMMETRY = 0.5


@dataclass(frozen=True)
class ShapePrior:
    """Gaussian prior of the displacement ``b - b_t``.

    Attributes
    ----------
    modes : (k, M*N, 3) array
        Identity modes, then expression modes, one standard deviation each, mm.
    smooth : (M*N, M*N) sparse array
        Precision of the smooth part of each coordinate, 1/mm^2.
    along_normals : (M*N, M*N) sparse array
        The same of its part along the normals, with halves that resemble each other.
    shape : (M, N)
        Size of the control net.
    factor : SuperLU
        Of ``smooth``.
    expression_scale : float
        Factor on the expression modes among ``modes``.
    """

    modes: Array
    smooth: sparse.csr_array
    along_normals: sparse.csr_array
    shape: tuple[int, int]
    factor: SuperLU
    expression_scale: float

    def split(self, uv: ArrayLike, forces: Array) -> tuple[Array, Array]:
        """The two parts of the mean displacement given landmarks.

        Parameters
        ----------
        uv : (f, 2) array
        forces : (f, 3) array
            Inverse covariance of the landmarks' displacement times that displacement.

        Returns
        -------
        modes : (k,) array
            Coefficients.
        smooth : (M*N, 3) array
            Displacement of the control points, mm.
        """
        T = basis_matrix(self.shape, *np.asarray(uv, float).T)
        pull = T.T @ forces
        return np.einsum("kbx,bx->k", self.modes, pull), self.factor.solve(pull)

    def displacement_covariance(self, uv: ArrayLike, rows: ArrayLike) -> Array:
        """Covariance of the displacement at points ``rows`` with that at ``uv``.

        Parameters
        ----------
        uv : (f, 2) array
            Points of the surface.
        rows : (p, M*N) sparse array
            Basis matrix of other points, or the identity for control points.

        Returns
        -------
        (3 p, 3 f) array
            Coordinates interleaved (x, y, z of a point are neighbours).
        """
        T = basis_matrix(self.shape, *np.asarray(uv, float).T)
        smooth = rows @ self.factor.solve(T.T.toarray())
        left = np.einsum("pb,kbx->pxk", _dense(rows), self.modes, optimize=True)
        right = np.einsum("pb,kbx->pxk", _dense(T), self.modes, optimize=True)
        k = len(self.modes)
        return left.reshape(-1, k) @ right.reshape(-1, k).T + np.kron(smooth, np.eye(3))


def _dense(matrix: sparse.csr_array | Array) -> Array:
    return matrix if isinstance(matrix, np.ndarray) else matrix.toarray()


def shape_prior(
    template: Template,
    modes_scale: float,
    expression_scale: float,
    smooth_mm: float,
    smooth_length: float,
) -> ShapePrior:
    """Prior about a template.

    Parameters
    ----------
    template : Template
    modes_scale : float
        Factor on the standard deviation of the identity modes; 0 switches them off.
    expression_scale : float
        The same for the expression that all photos share.
    smooth_mm : float
        Standard deviation of the smooth part in the middle of the face, mm.
    smooth_length : float
        Its correlation length as a fraction of the width of the parameter square.
    """
    shape = template.surface.shape
    Q = bending_matrix(shape) + smooth_length**-4 * mass_matrix(shape)
    middle = basis_matrix(shape, [0.5], [0.5]).toarray()[0]
    variance = middle @ splu(sparse.csc_array(Q)).solve(middle)
    Q = sparse.csr_array(Q * (variance / smooth_mm**2))
    scaled = (
        modes_scale * template.identity_modes,
        expression_scale * template.expression_modes,
    )
    modes = np.concatenate(scaled).reshape(-1, shape[0] * shape[1], 3)
    factor = splu(sparse.csc_array(Q), permc_spec="MMD_AT_PLUS_A")
    return ShapePrior(
        modes, Q, _with_like_halves(Q, shape), shape, factor, expression_scale
    )


def _with_like_halves(Q: sparse.csr_array, shape: tuple[int, int]) -> sparse.csr_array:
    """The precision when what differs between the halves has `ASYMMETRY`."""
    points = np.arange(shape[0] * shape[1])
    opposite = points.reshape(shape)[::-1].ravel()
    ones = np.ones(len(points))
    mirror = sparse.csr_array((ones, (points, opposite)))
    difference = (sparse.csr_array((ones, (points, points))) - mirror) / 2
    more = difference.T @ Q @ difference
    return sparse.csr_array(Q + (ASYMMETRY**-2 - 1) * more)
