"""Local shape from shading (section 2.2.2, Eq. 6 and 7).

Given normals ``h`` at ``p`` surface points, find control points ``b`` whose surface has
them.  The normal is bilinear in ``b``, so one factor of the cross product is frozen at
the current ``b_0`` and the other solved for, in turn::

    L|b_0 = Lambda|b_0 [F_u x] T2     "optimise v, keep u"     Eq. 6
    R|b_0 = Lambda|b_0 [F_v x] T1     "optimise u, keep v"     Eq. 7

with ``Lambda = 1 / |F_u x F_v|`` and ``F_u = T1 b_0``, ``F_v = T2 b_0``.

Orientation
-----------
Here ``v`` runs down, so the normal out of the face is ``F_v x F_u`` and both matrices
are the printed ones with the sign turned: ``L = -Lambda [T1 b]x T2`` and
``R = +Lambda [T2 b]x T1``.  For ``b`` itself both give its normals: ``L|b b = R|b b =
H``.

Readings of the text
--------------------
* Norms are squared, as in the closed forms of Algorithm 1.  The right side printed
  there, ``G^T h``, leaves out ``T^(sxy) b_t`` of Eq. 6; it is kept.
* The three terms have different units, the factors between them are not given, and
  ``T1 b`` depends on the knot spacing.  Here the frontal term is a mean over the points
  in units of ``frontal_scale_mm``, the paper's unit (1/50 of the eye distance), and the
  ``lambda`` term is a mean in units of the mean ``|F_u|^2`` (``|F_v|^2``) of the
  template, which makes ``lambda`` a number without unit.
* Eq. 6 and 7 take ``b_t`` as the reference of the ``lambda`` term, Algorithm 1 takes
  ``b_0``: `ShadingParameters.derivative_reference` chooses, ``b_t`` by default.
* Both systems are singular: a constant shift in z changes no term, and control points
  away from all normals have no equation.  A small ridge towards ``b_0`` holds them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from ..._types import Array
from ...surface.bspline import basis_matrix
from ..least_squares import Block, LeastSquaresSolution, ridge, solve_least_squares


@dataclass(frozen=True)
class ShadingParameters:
    """The factors that the paper names but does not print.

    Parameters
    ----------
    lam : float
        ``lambda`` of Eq. 6 and 7: weight of keeping the frozen derivative, relative to
        the normals.  Exact normals need little (1 or less); 10 holds the surface
        together when they are wrong by 20 degrees, as those of section 2.2.1 are.
    frontal_weight : float
        Weight of the frontal constraint ``T^(sxy)``, relative to the normals; the paper
        prints 1, in its unit.
    frontal_scale_mm : float
        The paper's unit of length: its eyes are 50 apart, ours 62 mm.
    derivative_reference : {"template", "previous"}
        ``b_t`` as in Eq. 6 and 7, or ``b_0`` as in Algorithm 1.  With ``b_0`` the term
        only slows the steps down: the loop ends where the normals alone lead, and wrong
        normals lead away from any face.
    ridge : float
        Weight per control point and unit^2 of staying at ``b_0``: just enough to make
        the system regular.
    """

    lam: float = 10.0
    frontal_weight: float = 1.0
    frontal_scale_mm: float = 62.0 / 50.0
    derivative_reference: str = "template"
    ridge: float = 1e-6

    def __post_init__(self) -> None:
        if self.derivative_reference not in ("template", "previous"):
            raise ValueError(
                "derivative_reference must be 'template' or 'previous', got "
                f"{self.derivative_reference!r}"
            )
        if min(self.lam, self.frontal_weight, self.ridge) < 0:
            raise ValueError("weights of the shading step must not be negative")
        if self.frontal_scale_mm <= 0:
            raise ValueError("frontal_scale_mm must be positive")


@dataclass(frozen=True)
class NormalField:
    """What photometric stereo gives to Eq. 6 and 7.

    Parameters
    ----------
    h : (p, 3) array
        Outward unit normals at the sample points.
    weights : (p,) array
        Confidence, 1 for all in the paper; 0 where nothing is known.
    """

    h: Array
    weights: Array


@dataclass(frozen=True)
class NormalRows:
    """``T^(sn), T1^(sn), T2^(sn)``: coefficients at the points that have a normal.

    Parameters
    ----------
    T, T1, T2 : (p, M*N) sparse arrays
        Scalar rows; the paper's ``3p x 3MN`` matrices are ``kron(T, I_3)``.
    """

    T: sparse.csr_array
    T1: sparse.csr_array
    T2: sparse.csr_array

    @classmethod
    def at(cls, shape: tuple[int, int], uv: Array) -> NormalRows:
        """Rows for a net of ``shape`` at ``uv`` (p, 2)."""
        u, v = np.asarray(uv, float).T
        return cls(
            basis_matrix(shape, u, v),
            basis_matrix(shape, u, v, du=1),
            basis_matrix(shape, u, v, dv=1),
        )


def cross_matrix(w: Array) -> sparse.csr_array:
    """``[w]`` with a circled cross: block diagonal of ``[w_i]x``, for ``w`` (p, 3).

    ``cross_matrix(w) @ x.ravel()`` is ``np.cross(w, x).ravel()``.
    """
    w = np.asarray(w, float)
    p = len(w)
    # Rows of [w]x without their zero diagonal: (-z, y), (z, -x), (-y, x).
    x, y, z = w.T
    data = np.stack([-z, y, z, -x, -y, x], 1).ravel()
    column = 3 * np.arange(p)[:, None] + np.array([1, 2, 0, 2, 0, 1])
    return sparse.csr_array(
        (data, column.ravel(), 2 * np.arange(3 * p + 1)), shape=(3 * p, 3 * p)
    )


def inverse_area(Fu: Array, Fv: Array) -> Array:
    """``Lambda``: reciprocal lengths of ``F_u x F_v``, (p,)."""
    return 1.0 / np.maximum(np.linalg.norm(np.cross(Fu, Fv), axis=1), 1e-12)


def normals_of(b: Array, rows: NormalRows) -> Array:
    """Outward unit normals of the net ``b`` (M*N, 3) at the rows, (p, 3)."""
    Fu, Fv = rows.T1 @ b, rows.T2 @ b
    return inverse_area(Fu, Fv)[:, None] * np.cross(Fv, Fu)


def left_matrix(b0: Array, rows: NormalRows) -> sparse.csr_array:
    """``L|b_0`` (3p, 3MN) of Eq. 6; acts on ``b.ravel()``; outward sign."""
    Fu, Fv = rows.T1 @ b0, rows.T2 @ b0
    scaled = -inverse_area(Fu, Fv)[:, None] * Fu
    return cross_matrix(scaled) @ _three(rows.T2)


def right_matrix(b0: Array, rows: NormalRows) -> sparse.csr_array:
    """``R|b_0`` (3p, 3MN) of Eq. 7; acts on ``b.ravel()``; outward sign."""
    Fu, Fv = rows.T1 @ b0, rows.T2 @ b0
    scaled = inverse_area(Fu, Fv)[:, None] * Fv
    return cross_matrix(scaled) @ _three(rows.T1)


def solve_eq6(
    b0: Array,
    normals: NormalField,
    bt: Array,
    rows: NormalRows,
    parameters: ShadingParameters | None = None,
) -> LeastSquaresSolution:
    """Eq. 6: ``|h - L|b_0 b|^2 + |T^(sxy)(b - b_t)|^2 + lambda |T1 (b - b_ref)|^2``.

    Parameters
    ----------
    b0 : (M*N, 3) array
        Where ``L`` is taken.
    normals : NormalField
        Target normals ``h``.
    bt : (M*N, 3) array
        Template; reference of the frontal constraint.
    rows : NormalRows
        Coefficients at the ``p`` points.
    parameters : ShadingParameters, optional

    Returns
    -------
    LeastSquaresSolution
        ``x`` (3*M*N,); residuals in the order normals, frontal, lambda, ridge.
    """
    return _solve(
        b0, normals, bt, rows, parameters, matrix=left_matrix(b0, rows), frozen=rows.T1
    )


def solve_eq7(
    b0: Array,
    normals: NormalField,
    bt: Array,
    rows: NormalRows,
    parameters: ShadingParameters | None = None,
) -> LeastSquaresSolution:
    """Eq. 7: as `solve_eq6` with ``R`` for ``L`` and ``T2`` for ``T1``."""
    return _solve(
        b0, normals, bt, rows, parameters, matrix=right_matrix(b0, rows), frozen=rows.T2
    )


def shading_step(
    b0: Array,
    normals: NormalField,
    bt: Array,
    rows: NormalRows,
    parameters: ShadingParameters | None = None,
) -> tuple[Array, dict[str, float]]:
    """One turn of Eq. 6 and Eq. 7: lines 6 and 7 of Algorithm 1.

    Returns
    -------
    b2 : (M*N, 3) array
        The updated ``b_0``.
    figures : dict
        ``normal_rms_deg`` between ``h`` and the normals of ``b2``, and ``condition``,
        the larger of both systems.
    """
    first = solve_eq6(b0, normals, bt, rows, parameters)
    b1 = first.x.reshape(-1, 3)
    second = solve_eq7(b1, normals, bt, rows, parameters)
    b2 = second.x.reshape(-1, 3)
    return b2, {
        "normal_rms_deg": normal_rms_degrees(normals, normals_of(b2, rows)),
        "condition": max(first.condition, second.condition),
    }


def normal_rms_degrees(target: NormalField, n: Array) -> float:
    """Root mean square angle of unit normals ``n`` (p, 3) to the target, degrees."""
    angle = np.degrees(np.arccos(np.clip((target.h * n).sum(1), -1, 1)))
    return float(np.sqrt(np.average(angle**2, weights=target.weights)))


def _three(T: sparse.csr_array) -> sparse.csr_array:
    """The paper's matrix with three rows a point."""
    return sparse.csr_array(sparse.kron(T, sparse.eye_array(3), format="csr"))


def _solve(
    b0: Array,
    normals: NormalField,
    bt: Array,
    rows: NormalRows,
    parameters: ShadingParameters | None,
    *,
    matrix: sparse.csr_array,
    frozen: sparse.csr_array,
) -> LeastSquaresSolution:
    par = parameters or ShadingParameters()
    w = normals.weights / normals.weights.sum()
    w3 = np.repeat(w, 3)
    reference = b0 if par.derivative_reference == "previous" else bt
    # T^(sxy): the rows of z are zero, so that depth stays free.
    flat = sparse.diags_array(np.tile([1.0, 1.0, 0.0], len(w))) @ _three(rows.T)
    length2 = float(w @ ((frozen @ bt) ** 2).sum(1))
    xy = par.frontal_weight / par.frontal_scale_mm**2
    scale2 = par.frontal_scale_mm**2 * len(b0)
    derivative = _three(frozen)
    return solve_least_squares(
        [
            Block(matrix, normals.h.ravel(), w3),
            Block(flat, flat @ bt.ravel(), xy * w3),
            Block(derivative, derivative @ reference.ravel(), par.lam / length2 * w3),
            ridge(3 * len(b0), par.ridge / scale2, b0.ravel()),
        ]
    )
