"""Cholesky factor of the sparse matrices of a net of control points.

Cubic basis functions overlap three neighbours in each direction, so with the control
points in the order of the net all entries are within ``3 N + 3`` of the diagonal: they
are band matrices of LAPACK.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.linalg import cho_solve_banded, cholesky_banded

from ..._types import Array


@dataclass(frozen=True, eq=False)
class BandedCholesky:
    """``L`` with ``L L^T = A``.

    Attributes
    ----------
    band : (w, b) array
        Diagonals of ``L`` from the main one down.
    """

    band: Array

    def solve(self, right: Array) -> Array:
        """``A^-1 right`` for ``right`` (b,) or (b, k)."""
        return cho_solve_banded((self.band, True), right, check_finite=False)


def banded_cholesky(A: sparse.csr_array) -> BandedCholesky:
    """Factor a symmetric, positive definite matrix (b, b) with a narrow band.

    Raises
    ------
    numpy.linalg.LinAlgError
        If ``A`` is not positive definite.
    """
    lower = sparse.tril(A, format="coo")
    below = lower.row - lower.col
    band = np.zeros((int(below.max()) + 1, A.shape[0]))
    np.add.at(band, (below, lower.col), lower.data)
    return BandedCholesky(cholesky_banded(band, lower=True, check_finite=False))
