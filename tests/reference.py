"""Oracles from the definitions: slow, dense and naive on purpose.

Nothing here shares code or formulas with the library. What the library computes with
segment polynomials, sparse matrices and eliminated unknowns is computed here with
recursions, loops and dense matrices, so that the tests can compare the two.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


# --- B-splines -----------------------------------------------------------------------


def basis_function(m: int, order: int, t: float, last: float) -> float:
    """``N_{m,order}(t)`` on the integer knots by the Cox-de Boor recursion.

    The half-open knot spans are closed at ``last``, the right end of the valid
    interval.
    """
    if order == 1:
        inside = m + 1 == last if t == last else m <= t < m + 1
        return float(inside)
    left = (t - m) / (order - 1) * basis_function(m, order - 1, t, last)
    right = (m + order - t) / (order - 1) * basis_function(m + 1, order - 1, t, last)
    return left + right


def basis_derivative(m: int, order: int, t: float, last: float, n: int) -> float:
    """``n``-th derivative of ``N_{m,order}`` by the knot value."""
    if n == 0:
        return basis_function(m, order, t, last)
    return basis_derivative(m, order - 1, t, last, n - 1) - basis_derivative(
        m + 1, order - 1, t, last, n - 1
    )


def basis_row(count: int, x: float, n: int = 0) -> Array:
    """All ``count`` cubic basis functions, or derivatives, at ``x`` in [0, 1]."""
    t, last = 3 + x * (count - 3), float(count)
    row = [basis_derivative(m, 4, t, last, n) for m in range(count)]
    return np.array(row) * float(count - 3) ** n


def dense_matrix(
    shape: tuple[int, int], u: ArrayLike, v: ArrayLike, du: int = 0, dv: int = 0
) -> Array:
    """``T, T1, ...`` as a dense (p, M*N) matrix of products."""
    rows = []
    for x, y in zip(np.ravel(u), np.ravel(v), strict=True):
        bu, bv = basis_row(shape[0], x, du), basis_row(shape[1], y, dv)
        rows.append([bu[m] * bv[n] for m in range(shape[0]) for n in range(shape[1])])
    return np.array(rows)


def monomial_coefficients(count: int, power: int) -> Array:
    """Control values of ``x -> x**power`` on [0, 1], by polar forms; power <= 3."""
    knots = (np.arange(count + 4.0) - 3) / (count - 3)
    out = []
    for m in range(count):
        a, b, c = knots[m + 1 : m + 4]
        out.append(
            [1.0, (a + b + c) / 3, (a * b + b * c + c * a) / 3, a * b * c][power]
        )
    return np.array(out)


def polynomial_control_points(
    shape: tuple[int, int], terms: dict[tuple[int, int], ArrayLike]
) -> Array:
    """Control points of ``sum coefficient u**i v**j``, coefficients (3,), exact."""
    b = np.zeros((*shape, 3))
    for (i, j), value in terms.items():
        column = monomial_coefficients(shape[0], i)
        row = monomial_coefficients(shape[1], j)
        b += (column[:, None] * row)[..., None] * np.asarray(value, float)
    return b


def quadrature(spans: int, nodes: int) -> tuple[Array, Array]:
    """Nodes and weights of a composite Gauss rule on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    at = (np.arange(spans)[:, None] + (x + 1) / 2) / spans
    return at.ravel(), np.tile(w / 2 / spans, spans)


# --- derivatives ---------------------------------------------------------------------


def numerical_derivative(
    f: Callable[[Array], Array], count: int, step: float = 1e-6
) -> Array:
    """Central differences of ``f`` at 0, the parameter axis last."""
    columns = []
    for k in range(count):
        e = np.zeros(count)
        e[k] = step
        columns.append((np.asarray(f(e)) - np.asarray(f(-e))) / (2 * step))
    return np.stack(columns, -1)


# --- cameras -------------------------------------------------------------------------


def pinhole(Q: Array, K: Array, R: Array, centre: Array) -> Array:
    """Pixels of a textbook pinhole with its centre at ``centre`` (head axes).

    Parameters
    ----------
    K : (3, 3) array
        Calibration for camera axes x right, y down, z away from the camera.
    R : (3, 3) array
        Rotation into camera axes x right, y up, z toward the camera.
    """
    flip = np.diag([1.0, -1.0, -1.0])
    x = (np.asarray(Q, float) - centre) @ R.T @ flip @ K.T
    return x[..., :2] / x[..., 2:]


# --- the joint system ----------------------------------------------------------------


def dense_gauss_newton(
    T: list[Array], c: Array, h: Array, s: Array, W: Array, r: Array
) -> tuple[Array, Array]:
    """Normal matrix and right side with every unknown kept, albedo last.

    Residual ``r_ij`` of photo i at point j changes by ``c_ij . (T, T1, T2)_j d`` for
    the displacement ``d``, by ``h_ij . x_i`` for what belongs to photo i, and by
    ``-s_ij a_j`` for the albedo. The step minimises ``sum W (r + change)^2``.
    """
    n, p, m = h.shape
    size = T[0].shape[1]
    rows, right, weights = [], [], []
    for i in range(n):
        for j in range(p):
            row = np.zeros(size + n * m + p)
            for k in range(3):
                row[:size] += c[i, j, k] * T[k][j]
            row[size + i * m : size + (i + 1) * m] = h[i, j]
            row[size + n * m + j] = -s[i, j]
            rows.append(row)
            right.append(-r[i, j])
            weights.append(W[i, j])
    A, w = np.array(rows), np.array(weights)
    return A.T @ (w[:, None] * A), A.T @ (w * np.array(right))


def schur_complement(A: Array, g: Array, keep: int) -> tuple[Array, Array]:
    """The system that is left when all unknowns from ``keep`` on are eliminated."""
    inner = A[keep:, keep:]
    B = A[:keep, keep:]
    return A[:keep, :keep] - B @ np.linalg.solve(inner, B.T), g[:keep] - B @ (
        np.linalg.solve(inner, g[keep:])
    )
