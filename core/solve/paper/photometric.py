"""Photometric stereo as the paper describes it (section 2.2.1).

``M = L S``: intensities of ``n`` photos at ``p`` points are lights ``L`` (n x 4) times
shape ``S`` (4 x p), a column of which is ``rho (1, n_x, n_y, n_z)``.  Steps:

1. ``M = U D V^T``; four singular values give ``L~ = U sqrt(D)``, ``S~ = sqrt(D) V^T``.
2. ``S~`` is updated by ``min ||M - L~ S~|| + S^T G S`` with ``G = diag(-1, 1, 1, 1)``,
   point by point, with the photos that agree at that point ([30]: "locally similar to
   as many photos as possible").
3. ``A`` of ``min ||S^t - A S~||^2`` takes it to the template's normals; ``S = A S~``.
4. ``h``: rows 2-4 of ``S``, normalised.

Readings of the text
--------------------
* ``S^T G S`` is not a penalty (it is indefinite and unbounded below) and ``G`` has no
  meaning before ``A`` has fixed the basis.  What is meant is the constraint ``s^T G s =
  0``, "the length of the normal is the albedo".  So ``A`` is fitted once before step 2,
  and step 2 solves ``min ||m - L s||^2`` *subject to* ``s^T G s = 0``: the stationary
  point ``(L^T L + mu G) s = L^T m`` with the multiplier ``mu`` of each point in place
  of the printed factor 1.
* ``S^t`` has no albedo while ``S~`` has: its columns are multiplied by an albedo, the
  mean photo divided by the shading that the best single light gives the template.
* Missing data is not mentioned, but an SVD needs a full matrix, and photos turned by 30
  degrees see half of the face.  So only points that nearly all photos see
  (`COMMON_SHARE`) are factorised, the remaining holes get the mean of the photos
  that see the point (after each photo is divided by its brightness), and step 2, with
  the lights so found, brings in all other points with the photos that do see them.

Even so the normals of a face are worse than the template's: attached and cast shadows
are not of rank 4, and the 16 unknowns of ``A`` follow the errors of the template.
`photometry.lighting` has the robust method; this one is for comparison.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..._types import Array, Mask
from ...errors import ReconstructionError

RANK = 4
#: At least this part of the photos that see a point is used, the best ones.
MINIMUM_SHARE = 0.5
#: Points that this part of the photos sees are factorised, but never less than the
#: best-seen quarter of the points.
COMMON_SHARE = 0.85
G = np.diag([-1.0, 1.0, 1.0, 1.0])


@dataclass(frozen=True)
class SvdPhotometric:
    """Result of `photometric_svd`.

    Parameters
    ----------
    normals : (p, 3) array
        ``h``: outward unit normals, head axes.
    albedo : (p,) array
        Length of the columns of ``S``, relative to a median of 1.
    lights : (n, 4) array
        ``L`` in the basis of ``S``: ambient, x, y, z, per photo.
    ambiguity : (4, 4) array
        ``A`` from the factorisation to the template's basis.
    singular_values : (k,) array
        ``D``; a clear step after the fourth says that the photos are Lambertian.
    chosen : (n, p) bool array
        Photos used at each point.
    residual : float
        Root mean square of ``M - L S`` over ``chosen``, relative to the mean intensity.
    """

    normals: Array
    albedo: Array
    lights: Array
    ambiguity: Array
    singular_values: Array
    chosen: Mask
    residual: float


def photometric_svd(
    M: Array,
    weights: Array,
    template_normals: Array,
    *,
    tolerance: float = 0.15,
) -> SvdPhotometric:
    """Normals from the intensities of several photos.

    Parameters
    ----------
    M : (n, p) array
        Linear intensities of ``n >= 4`` photos at ``p`` points.
    weights : (n, p) array
        Visibility; 0 where a photo does not see the point.
    template_normals : (p, 3) array
        Outward unit normals of the template at the points.
    tolerance : float
        A photo agrees with a point when ``|m - l s|`` is below this part of the point's
        mean intensity.  0.15 leaves out cast shadows and highlights and keeps skin
        that is not quite Lambertian.

    Returns
    -------
    SvdPhotometric

    Raises
    ------
    ReconstructionError
        With fewer than four photos, or without a point that is seen at all.
    """
    M, weights = np.asarray(M, float), np.asarray(weights, float)
    St_normals = np.asarray(template_normals, float)
    n, p = M.shape
    if weights.shape != (n, p) or St_normals.shape != (p, 3):
        raise ValueError(
            f"M {M.shape}, weights {weights.shape} and normals {St_normals.shape} "
            "do not fit"
        )
    if n < RANK:
        raise ReconstructionError(
            f"Photometric stereo needs at least {RANK} photos under different light "
            f"and got {n}; add photos or choose the method 'motion'."
        )
    seen = (weights > 0) & np.isfinite(M)
    if not seen.any() or not np.abs(M[seen]).max() > 0:
        raise ReconstructionError(
            "No point of the face is seen in any photo; check that the photos show "
            "one person from the front and are not black."
        )
    filled = fill_missing(M, seen)
    share = seen.mean(0)
    common = share >= min(COMMON_SHARE, float(np.quantile(share, 0.75)))
    trusted = np.asarray(seen.sum(0) >= RANK)
    U, D, Vt = np.linalg.svd(filled[:, common], full_matrices=False)
    root = np.sqrt(D[:RANK])
    L0, S0 = U[:, :RANK] * root, root[:, None] * Vt[:RANK]
    St = template_shape(filled.mean(0), St_normals, common)
    A0 = fit_ambiguity(np.asarray(S0, float), St[:, common])
    # A changes the basis of S and its inverse that of L: L~ S~ = (L~ A^-1) (A S~).
    L: Array = np.asarray(np.linalg.lstsq(A0.T, L0.T, rcond=None)[0].T, float)
    S = constrained_shape(filled, L, seen, St)
    chosen = choose_photos(filled, L @ S, seen, tolerance)
    S = constrained_shape(filled, L, chosen, S)
    if trusted.any():
        A1 = fit_ambiguity(S[:, trusted], St[:, trusted])
        S = A1 @ S
        L = np.asarray(np.linalg.lstsq(A1.T, L.T, rcond=None)[0].T, float)
        A0 = A1 @ A0
    length = np.linalg.norm(S[1:], axis=0)
    good = length > 1e-12 * np.median(length)
    normals = np.where(good, S[1:] / np.maximum(length, 1e-300), St_normals.T).T
    residual = (filled - L @ S)[chosen]
    return SvdPhotometric(
        normals=normals,
        albedo=length / max(float(np.median(length)), 1e-300),
        lights=L,
        ambiguity=A0,
        singular_values=D,
        chosen=chosen,
        residual=float(np.sqrt(np.mean(residual**2)) / filled.mean()),
    )


def fill_missing(M: Array, seen: Mask) -> Array:
    """Photos of equal brightness, holes filled with the mean of their point.

    Parameters
    ----------
    M : (n, p) array
    seen : (n, p) bool array

    Returns
    -------
    (n, p) array
        Each photo divided by its median ratio to the mean photo; points that nobody
        sees get the mean of all points.
    """
    known = np.where(seen, M, 0.0)
    mean = _mean(known, seen)
    gain = np.ones(len(M))
    for i in range(len(M)):
        use = seen[i] & (mean > 0)
        if use.any():
            gain[i] = max(float(np.median(known[i, use] / mean[use])), 1e-6)
    known = known / gain[:, None]
    return np.where(seen, known, _mean(known, seen))


def template_shape(mean: Array, normals: Array, trusted: Mask) -> Array:
    """``S^t`` (4, p): template normals times an estimate of the albedo.

    Parameters
    ----------
    mean : (p,) array
        Mean photo.
    normals : (p, 3) array
        Of the template.
    trusted : (p,) bool array
        Points that the light is fitted to.
    """
    t = np.hstack([np.ones((len(normals), 1)), normals])
    light = np.linalg.lstsq(t[trusted], mean[trusted], rcond=None)[0]
    shading = t @ light
    # Where the fitted light leaves next to nothing the quotient means nothing.
    floor = 0.2 * float(np.median(shading[trusted]))
    return (mean / np.maximum(shading, max(floor, 1e-12)) * t.T).astype(float)


def fit_ambiguity(S: Array, St: Array) -> Array:
    """``A`` (4, 4) of ``min ||S^t - A S||^2``."""
    return np.linalg.lstsq(S.T, St.T, rcond=None)[0].T.astype(float)


def choose_photos(
    M: Array,
    model: Array,
    seen: Mask,
    tolerance: float,
) -> Mask:
    """Which photos agree with the rank-4 model at each point, (n, p).

    Photos beyond ``tolerance`` (relative to the point's mean) are left out, but never
    below the best `MINIMUM_SHARE` of those that see the point.
    """
    error = np.where(seen, np.abs(M - model), np.inf)
    limit = tolerance * np.abs(M.mean(0))
    count = seen.sum(0)
    keep = np.clip(np.ceil(MINIMUM_SHARE * count), np.minimum(RANK, count), None)
    rank = np.argsort(np.argsort(error, axis=0, kind="stable"), axis=0)
    return seen & ((error <= limit) | (rank < keep))


def constrained_shape(M: Array, L: Array, chosen: Mask, start: Array) -> Array:
    """``min ||m - L s||^2`` subject to ``s^T G s = 0``, point by point.

    With ``B = L^T L`` of the chosen photos the stationary points are ``(B + mu G) s =
    L^T m``.  Simultaneous diagonalisation of ``B`` and ``G`` makes ``s^T G s`` a
    monotone function of ``mu`` where ``B + mu G`` is positive definite, and its root
    there is the global minimum: bisection finds it for all points at once.

    Parameters
    ----------
    M : (n, p) array
    L : (n, 4) array
        Lights in the basis in which ``G`` is diagonal.
    chosen : (n, p) bool array
    start : (4, p) array
        Kept where fewer than four photos are chosen, their lights are dependent, or
        the albedo would not be positive.

    Returns
    -------
    (4, p) array
    """
    use = chosen.astype(float)
    B = np.einsum("np,na,nb->pab", use, L, L)
    g = np.einsum("np,np,na->pa", use, M, L)
    spread = np.linalg.eigvalsh(B)
    usable = (spread[:, 0] > 1e-9 * spread[:, -1]) & (chosen.sum(0) >= RANK)
    result = start.copy()
    if not usable.any():
        return result
    C = np.linalg.cholesky(B[usable])
    # C^-1 G C^-T = W diag(theta) W^T: one negative and three positive values.
    half = np.linalg.solve(C, np.broadcast_to(G, C.shape))
    theta, W = np.linalg.eigh(np.linalg.solve(C, np.swapaxes(half, 1, 2)))
    c = np.einsum("pba,pb->pa", W, np.linalg.solve(C, g[usable][..., None])[..., 0])
    low, high = -1.0 / theta[:, 3], -1.0 / theta[:, 0]
    for _ in range(100):
        mu = (low + high) / 2
        factor = 1.0 + mu[:, None] * theta
        # Strictly inside the interval all factors are positive.
        value = (theta * (c / np.maximum(factor, 1e-300)) ** 2).sum(1)
        low, high = np.where(value > 0, mu, low), np.where(value > 0, high, mu)
    factor = 1.0 + ((low + high) / 2)[:, None] * theta
    y = np.einsum("pab,pb->pa", W, c / np.maximum(factor, 1e-300))
    s = np.linalg.solve(np.swapaxes(C, 1, 2), y[..., None])[..., 0]
    fine = (s[:, 0] > 0) & np.isfinite(s).all(1)
    where = np.flatnonzero(usable)[fine]
    result[:, where] = s[fine].T
    return result


def _mean(known: Array, seen: Mask) -> Array:
    """Mean over the photos that see a point; mean of all for the others."""
    count = seen.sum(0)
    overall = known.sum() / max(int(seen.sum()), 1)
    return np.where(count > 0, known.sum(0) / np.maximum(count, 1), overall)
