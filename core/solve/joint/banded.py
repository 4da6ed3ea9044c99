"""Cholesky factor of the sparse matrices of a net of control points.

Cubic basis functions overlap three neighbours in each direction, and the prior of the
shape couples each point with its mirror image.  Row by row (equal v), with mirror
images side by side, all entries are within ``3 M + 7`` of the diagonal: they are band
matrices of LAPACK.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import cho_solve_banded, cholesky_banded

from ..._types import Array


@dataclass(frozen=True, eq=False)
class BandedCholesky:
    """``L`` with ``L L^T = A``.

    Attributes
    ----------
    band : (w, b) array
        Diagonals of ``L`` from the main one down, in the order of the factor.
    order, back : (b,) int arrays
        Of the unknowns in the factor, and back.
    """

    band: Array
    order: NDArray[np.intp]
    back: NDArray[np.intp]

    def solve(self, right: Array) -> Array:
        """``A^-1 right`` for ``right`` (b,) or (b, k)."""
        factor, ordered = (self.band, True), right[self.order]
        return cho_solve_banded(factor, ordered, check_finite=False)[self.back]


def mirrored_order(shape: tuple[int, int]) -> NDArray[np.intp]:
    """Control points of a net row by row, mirror images side by side, ``(M*N,)``."""
    m = shape[0]
    u = np.stack([np.arange(m), np.arange(m)[::-1]], 1).ravel()[:m]
    return np.arange(m * shape[1]).reshape(shape)[u].T.ravel()


def banded_cholesky(A: sparse.csr_array, order: NDArray[np.intp]) -> BandedCholesky:
    """Factor a symmetric, positive definite matrix (b, b).

    Parameters
    ----------
    A : (b, b) sparse array
    order : (b,) int array
        Of the unknowns, in which the entries are near the diagonal.

    Raises
    ------
    numpy.linalg.LinAlgError
        If ``A`` is not positive definite.
    """
    lower = sparse.tril(A[order][:, order], format="coo")
    below = lower.row - lower.col
    band = np.zeros((int(below.max()) + 1, A.shape[0]))
    np.add.at(band, (below, lower.col), lower.data)
    factor = cholesky_banded(band, lower=True, check_finite=False)
    return BandedCholesky(factor, order, np.argsort(order))
