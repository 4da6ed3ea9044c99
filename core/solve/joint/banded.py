"""Cholesky factor of the sparse matrices of a net of control points.

Cubic basis functions overlap three neighbours in each direction, and the prior of the
shape couples each point with its mirror image: in a suitable order (reverse
Cuthill-McKee) all entries are near the diagonal, as LAPACK's band matrices have them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.sparse.csgraph import reverse_cuthill_mckee

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
        factor = self.band, True
        return cho_solve_banded(factor, right[self.order], check_finite=False)[
            self.back
        ]


def banded_cholesky(A: sparse.csr_array) -> BandedCholesky:
    """Factor a symmetric, positive definite matrix (b, b) with a narrow band.

    Raises
    ------
    numpy.linalg.LinAlgError
        If ``A`` is not positive definite.
    """
    order = reverse_cuthill_mckee(sparse.csr_matrix(A), symmetric_mode=True)
    lower = sparse.tril(A[order][:, order], format="coo")
    below = lower.row - lower.col
    band = np.zeros((int(below.max()) + 1, A.shape[0]))
    np.add.at(band, (below, lower.col), lower.data)
    factor = cholesky_banded(band, lower=True, check_finite=False)
    return BandedCholesky(factor, order, np.argsort(order))
