"""Sparse least squares, written as stacked blocks.

Every linear step of the method (Eq. 6, 7 and 8) is

    min_x  sum_k  w_k || A_k x - y_k ||^2

with sparse ``A_k``.  The closed forms of Algorithm 1 invert ``sum w_k A_k^T A_k``; here
that matrix is factorised once by sparse LU in symmetric mode and never inverted or
made dense.  (The norms of the paper are printed unsquared, but its closed forms are
those of the squares.)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from .._types import Array

# A solution whose residual exceeds this part of the right side is not accepted.
RESIDUAL_LIMIT = 1e-6


@dataclass(frozen=True)
class Block:
    """One term ``weight * || matrix x - target ||^2``.

    Parameters
    ----------
    matrix : (k, n) sparse array
    target : (k,) or (k, c) array
        ``c`` right sides are solved together.
    weight : float or (k,) array
        Weight of the *squared* residuals.
    """

    matrix: sparse.csr_array
    target: Array
    weight: float | Array = 1.0


@dataclass(frozen=True)
class LeastSquaresSolution:
    """Solution of `solve_least_squares`.

    Parameters
    ----------
    x : (n,) or (n, c) array
    condition : float
        Estimate (a lower bound, usually within a factor 3) of the condition in the
        1-norm of the matrix of the normal equations, the square of the condition of
        the stacked blocks; about 1e16 and above means that digits are lost.
    residuals : tuple of float
        ``weight * || matrix x - target ||^2`` of each block, in their order.
    """

    x: Array
    condition: float
    residuals: tuple[float, ...] = ()


def ridge(n: int, weight: float, reference: Array) -> Block:
    """``weight ||x - reference||^2``: holds what no other block determines."""
    return Block(sparse.csr_array(sparse.eye_array(n)), reference, weight)


def normal_equations(blocks: Sequence[Block]) -> tuple[sparse.csc_array, Array]:
    """``sum w A^T A`` and ``sum w A^T y`` of the stacked blocks."""
    if not blocks:
        raise ValueError("a least-squares problem needs at least one block")
    n = blocks[0].matrix.shape[1]  # pyright: ignore[reportOptionalSubscript]
    matrix = sparse.csc_array((n, n))
    right: Array | float = 0.0
    for k, block in enumerate(blocks):
        if block.matrix.shape != (len(block.target), n):
            raise ValueError(
                f"block {k}: matrix {block.matrix.shape} does not fit target "
                f"{block.target.shape} and {n} unknowns"
            )
        transposed = block.matrix.T
        weight = block.weight
        if np.ndim(weight):
            transposed = transposed @ sparse.diags_array(np.asarray(weight, float))
            matrix = matrix + transposed @ block.matrix
            right = right + transposed @ block.target
        else:
            matrix = matrix + weight * (transposed @ block.matrix)
            right = right + weight * (transposed @ block.target)
    return sparse.csc_array(matrix), np.asarray(right)


def solve_least_squares(blocks: Sequence[Block]) -> LeastSquaresSolution:
    """Minimise the sum of the blocks.

    Returns
    -------
    LeastSquaresSolution

    Raises
    ------
    numpy.linalg.LinAlgError
        When the blocks together do not determine ``x``.
    """
    matrix, right = normal_equations(blocks)
    x, condition = solve_symmetric(matrix, right)
    residuals = tuple(
        float(np.sum(np.asarray(b.weight) * (b.matrix @ x - b.target).T ** 2))
        for b in blocks
    )
    return LeastSquaresSolution(x, condition, residuals)


def solve_symmetric(matrix: sparse.csc_array, right: Array) -> tuple[Array, float]:
    """Solve ``matrix x = right`` for a symmetric positive definite sparse matrix.

    Parameters
    ----------
    matrix : (n, n) sparse array
    right : (n,) or (n, c) array

    Returns
    -------
    x : array like ``right``
    condition : float
        Estimated condition number in the 1-norm.

    Raises
    ------
    numpy.linalg.LinAlgError
        When the matrix is singular or holds a value that is not finite.
    """
    if not (np.isfinite(matrix.data).all() and np.isfinite(right).all()):
        raise np.linalg.LinAlgError(
            "the least-squares system holds values that are not finite"
        )
    # The fill-reducing order of the symmetric pattern halves the time, but takes
    # pivots from the diagonal only; the second attempt pivots freely.
    attempts = (
        {
            "permc_spec": "MMD_AT_PLUS_A",
            "diag_pivot_thresh": 0.0,
            "options": {"SymmetricMode": True},
        },
        {"permc_spec": "COLAMD"},
    )
    scale = float(np.abs(right).max(initial=0.0))
    for keywords in attempts:
        try:
            factor = splu(matrix, **keywords)
        except RuntimeError:  # SuperLU: "Factor is exactly singular"
            continue
        x = factor.solve(right)
        # One step of iterative refinement wins back what the missing pivoting lost.
        x = x + factor.solve(right - matrix @ x)
        error = float(np.abs(right - matrix @ x).max(initial=0.0))
        if np.isfinite(x).all() and error <= RESIDUAL_LIMIT * scale:
            norm = float(abs(matrix).sum(axis=0).max())
            return x, norm * _inverse_norm(factor.solve, len(right))
    raise np.linalg.LinAlgError("the least-squares system is singular")


def _inverse_norm(solve: Callable[[Array], Array], n: int) -> float:
    """1-norm of the inverse of a symmetric matrix from a few solves.

    Hager's estimator (SIAM J. Sci. Stat. Comput. 5 (1984) 311-316), deterministic.
    """
    x = np.full(n, 1.0 / n)
    estimate = 0.0
    for _ in range(5):
        y = solve(x)
        value = float(np.abs(y).sum())
        if value <= estimate:
            break
        estimate = value
        z = solve(np.where(y < 0, -1.0, 1.0))
        j = int(np.argmax(np.abs(z)))
        if np.abs(z[j]) <= z @ x:
            break
        x = np.zeros(n)
        x[j] = 1.0
    return estimate
