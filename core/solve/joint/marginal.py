"""How well the displacement is known when nothing is known of photos and albedo.

The photos are eliminated one by one from the precision of the displacement, so that the
time is linear in their number.  They also meet in the albedo.  Its smooth part, spanned
by the harmonics of the light and by splines, is kept among the unknowns until the end;
the rest of it, which each sample has to itself, takes its share out of the precision of
each intensity.  That only the share is taken out and not the direction is the
approximation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.linalg.blas import dsyrk
from scipy.linalg.lapack import dpotrf, dtrtri

from ..._types import Array
from ...gram import gram, mirror_lower, product
from ...progress import CheckCancelled, never_cancelled
from .coarse_space import smooth_albedo

if TYPE_CHECKING:
    from .system import BorderedSystem

#: At the finest level of ten of the example photos the deviations are then 5 % too
#: small in the median, 28 % too small to 10 % too large at single control points.
SPLINES = 20
# Photos that are eliminated at a time.
_BATCH = 16


def displacement_deviation(
    system: BorderedSystem,
    splines: int = SPLINES,
    check_cancelled: CheckCancelled = never_cancelled,
) -> Array:
    """Standard deviation of the displacement of each control point, ``(M*N,)``.

    Parameters
    ----------
    system : BorderedSystem
    splines : int
        Splines on a side that span the smooth part of the albedo, besides the
        harmonics.
    check_cancelled : callable
        Called for each photo; may raise `Cancelled`.
    """
    border, shape, size = system.intensities, system.shape, len(system.right)
    rows = border.rows
    T, c, s = rows.samples.T, rows.by_displacement, rows.shading
    F = smooth_albedo(rows, splines)
    rest = 1 - _leverage(np.sqrt(border.den)[:, None] * F)
    W = rows.precision * (1 - rows.precision * s * s * (rest / border.den))
    q, m, n = F.shape[1], border.size, len(W)
    upright = [sparse.csr_array(t.T) for t in T]
    # A spline is zero at nearly all samples, a harmonic at none.
    k = rows.harmonics.shape[2]
    dense, thin = np.ascontiguousarray(F[:, :k]), sparse.csr_array(F[:, k:].T)
    eliminated = np.zeros((size + q, size + q), order="F")
    batch = np.empty((_BATCH * m, size + q))
    for i in range(n):
        check_cancelled()
        h = rows.by_photo(i)
        Wh = W[i][:, None] * h
        H = product(h.T, Wh) + system.photo_precision[i]
        R = np.empty((size + q, m))
        R[:size] = sum(t @ (c[a, i][:, None] * Wh) for a, t in enumerate(upright))
        R[:size, : system.state.motions] += system.coupling[:, i]
        sWh = s[i][:, None] * Wh
        R[size : size + k], R[size + k :] = -product(dense.T, sWh), -(thin @ sWh)
        at = i % _BATCH
        batch[at * m : (at + 1) * m] = solve_triangular(
            np.linalg.cholesky(H), R.T, lower=True
        )
        if at + 1 == _BATCH or i + 1 == n:
            part = batch[: (at + 1) * m].T
            eliminated = dsyrk(1.0, part, 1.0, eliminated, overwrite_c=1)
    del batch, part
    total = np.negative(eliminated, out=eliminated)
    mirror_lower(total.T)
    total[size:, size:] += gram(np.sqrt((W * s * s).sum(0))[:, None] * F)
    total[size:, size:] += 1e-9 * np.diag(np.diag(total[size:, size:]) + 1.0)
    both = np.zeros((size, q))
    for a, t in enumerate(upright):
        both -= t @ ((W * c[a] * s).sum(0)[:, None] * F)
    total[:size, size:] += both
    total[size:, :size] += both.T
    known = shape.S_terms + sum(
        upright[a] @ sparse.diags_array((W * c[a] * c[b]).sum(0)) @ T[b]
        for a in range(3)
        for b in range(3)
    )
    # the modes need no place of their own: this is the prior of d + D a
    K, D = shape.model.prior.along_normals, shape.D
    KD = K @ D
    prior = cho_factor(np.eye(D.shape[1]) + D.T @ KD)
    total[:size, :size] -= KD @ cho_solve(prior, KD.T)
    total[:size, :size] += (known + K).toarray()
    inner = np.linalg.cholesky(total[size:, size:])
    # From here on in place: these matrices are most of the memory.
    left = np.array(total[:size, :size], order="F")
    between = total[size:, :size].copy()
    del total, eliminated
    left -= gram(solve_triangular(inner, between, lower=True))
    factor, failed = dpotrf(left, lower=1, overwrite_a=1)
    if failed:
        raise np.linalg.LinAlgError("the precision of the surface is not definite")
    # The diagonal of (L L^T)^-1 are the squares of the columns of L^-1.
    root, _ = dtrtri(factor, lower=1, overwrite_c=1)
    return np.sqrt(np.einsum("ij,ij->j", root, root))


def _leverage(F: Array) -> Array:
    """Share of each sample that the columns of ``F`` (p, q) span, ``(p,)``."""
    A = gram(F)
    A[np.diag_indices(len(A))] += 1e-9 * np.trace(A) / len(A)
    half = solve_triangular(np.linalg.cholesky(A), F.T, lower=True)
    return np.minimum((half**2).sum(0), 1.0)
