"""Bending energy of a control net: the 2nd-order regularisation of Eq. 8.

``l(b, b_0) = || K (b - b_0) ||^2`` with ``K`` the stacked second derivatives.  The
paper leaves the sample points open; here the integral over the unit square is exact,
and the mixed derivative counts twice, which makes the energy independent of the
direction of the parameter axes.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy import sparse

from .bspline import segment_basis


def _gram(count: int, order: int) -> sparse.csr_array:
    """Integral over [0, 1] of the products of basis derivatives, (count, count)."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    spans = count - 3
    x = ((np.arange(spans)[:, None] + (nodes + 1) / 2) / spans).ravel()
    w = np.tile(weights / 2 / spans, spans)
    first, value = segment_basis(count, x, order)
    rows = np.repeat(np.arange(len(x)), 4)
    columns = (first[:, None] + np.arange(4)).ravel()
    B = sparse.csr_array((value.ravel(), (rows, columns)), shape=(len(x), count))
    return sparse.csr_array(B.T @ sparse.diags_array(w) @ B)


@lru_cache(maxsize=8)
def bending_matrix(shape: tuple[int, int]) -> sparse.csr_array:
    """``K^T K`` for one coordinate.

    Parameters
    ----------
    shape : (M, N)
        Size of the control net.

    Returns
    -------
    (M*N, M*N) sparse array
        ``d^T (K^T K) d`` is the integral over the unit square of
        ``|d_uu|^2 + 2 |d_uv|^2 + |d_vv|^2``.
    """
    m, n = shape
    g0u, g1u, g2u = (_gram(m, k) for k in range(3))
    g0v, g1v, g2v = (_gram(n, k) for k in range(3))
    energy = sparse.kron(g2u, g0v) + 2 * sparse.kron(g1u, g1v) + sparse.kron(g0u, g2v)
    return sparse.csr_array(energy)


@lru_cache(maxsize=8)
def mass_matrix(shape: tuple[int, int]) -> sparse.csr_array:
    """``d^T G d`` is the integral over the unit square of ``|d|^2``; as above."""
    return sparse.csr_array(sparse.kron(_gram(shape[0], 0), _gram(shape[1], 0)))
