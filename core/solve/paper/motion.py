"""Global shape from motion with the paper's camera (section 2.3.2, Eq. 8).

::

    min_b  || f - P T^(sf) b ||^2 + zeta || K b - K b_0 ||^2 ,   K = [T11; T22; T12]

``f`` stacks the landmarks of all photos without their translation, ``P`` the first two
rows of ``s R`` of each photo, ``T^(sf)`` the coefficients at the landmarks; the second
term keeps the second derivatives of ``b_0``.

Readings of the text
--------------------
* Rows of ``P`` and ``f`` are divided by the photo's scale ``s``, so that residuals are
  millimetres on the face and not pixels; as printed, a photo would count by the square
  of its size.  The first term is the mean over all landmarks, so that ``zeta`` does not
  depend on the number of photos.
* ``K`` is taken at "all" points: its square is the integral over the parameter square,
  with ``sqrt(2)`` on ``T12`` (see `surface.bending`).  ``zeta`` is then a pure number:
  both terms are squared lengths.
* Similarity motions that bend nothing are held by the landmarks only; a ridge of
  ``RIDGE * zeta`` towards ``b_0`` makes the system regular without any landmark.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse

from ..._types import Array
from ...camera.camera import Camera
from ...camera.linear_pose import linear_pose
from ...errors import PhotoFailure
from ...landmarks.observations import LandmarkObservations
from ...surface.bending import bending_matrix
from ...surface.bspline import basis_matrix
from ..least_squares import solve_symmetric

RIDGE = 1e-3


def estimate_poses(
    b: Array, shape: tuple[int, int], landmarks: LandmarkObservations
) -> tuple[Camera | PhotoFailure, ...]:
    """``s, R, t`` of every photo from the surface ``b`` (M*N, 3), section 2.3.1."""
    Q = basis_matrix(shape, *landmarks.uv.T) @ b
    return tuple(
        linear_pose(q, Q, w, (float(x), float(y)), name)
        for q, w, (x, y), name in zip(
            landmarks.pixels,
            landmarks.weight,
            landmarks.principal,
            landmarks.names,
            strict=True,
        )
    )


def motion_vector(
    cameras: Sequence[Camera | PhotoFailure], landmarks: LandmarkObservations
) -> tuple[Array, Array, Array]:
    """``f`` and ``P``, divided by the scales, and the weights of the observations.

    Returns
    -------
    f : (n, f, 2) array
        ``(q - t) / s`` with y up, mm.
    P : (n, 2, 3) array
        First two rows of each rotation.
    weights : (n, f) array
        Sum 1; zero for photos without a pose.
    """
    n, count = landmarks.weight.shape
    f, P = np.zeros((n, count, 2)), np.zeros((n, 2, 3))
    weights = landmarks.weight.copy()
    for i, camera in enumerate(cameras):
        if not isinstance(camera, Camera):
            weights[i] = 0.0
            continue
        q = landmarks.pixels[i] - camera.principal - camera.t
        f[i] = q * np.array([1.0, -1.0]) / camera.s
        P[i] = camera.R[:2]
    total = weights.sum()
    return f, P, weights / total if total > 0 else weights


def warp(
    b0: Array,
    shape: tuple[int, int],
    cameras: Sequence[Camera | PhotoFailure],
    landmarks: LandmarkObservations,
    zeta: float = 1e-3,
) -> tuple[Array, dict[str, float]]:
    """Eq. 8 by the closed form of Algorithm 1, factorised sparsely.

    Parameters
    ----------
    b0 : (M*N, 3) array
        Control points that carry the local shape.
    shape : (M, N)
    cameras : sequence of Camera or PhotoFailure
        ``kappa`` is not used.
    landmarks : LandmarkObservations
    zeta : float
        Weight of the second derivatives.  1e-3 suits detected landmarks, whose error is
        2-4 % of the eye distance; 1e-6 true ones.  Softer, the warp undoes the relief
        that shading has found.

    Returns
    -------
    b : (M*N, 3) array
    figures : dict
        ``landmark_rms_mm`` before (``landmark_rms_before_mm``) and after, the bending
        of ``b - b_0`` and the ``condition`` of the system.
    """
    if not zeta > 0:
        raise ValueError(f"zeta must be positive, got {zeta}")
    f, P, w = motion_vector(cameras, landmarks)
    if not w.any():
        raise ValueError("no photo has a pose and landmarks; Eq. 8 has no data")
    T = basis_matrix(shape, *landmarks.uv.T)
    T3 = sparse.csr_array(sparse.kron(T, sparse.eye_array(3), format="csr"))
    # P couples the three coordinates of one landmark only: P^T P is block diagonal,
    # 3 x 3 a landmark, summed over the photos.  That keeps (P T)^T (P T) as sparse as
    # the surface, whatever the number of photos.
    PtP = np.einsum("nf,nia,nib->fab", w, P, P)
    count = len(PtP)
    PtP3 = sparse.bsr_array(
        (PtP, np.arange(count), np.arange(count + 1)), shape=(3 * count, 3 * count)
    )
    K2 = sparse.kron(bending_matrix(shape), sparse.eye_array(3), format="csr")
    hold = RIDGE * zeta * sparse.eye_array(3 * len(b0), format="csr")
    matrix = sparse.csc_array(T3.T @ (PtP3 @ T3) + zeta * K2 + hold)
    # Solved for the displacement b - b_0: the same minimum, better digits.
    residual = f - np.einsum("nia,fa->nfi", P, T @ b0)
    right = T3.T @ np.einsum("nf,nia,nfi->fa", w, P, residual).ravel()
    d, condition = solve_symmetric(matrix, right)
    b = b0 + d.reshape(-1, 3)
    after = f - np.einsum("nia,fa->nfi", P, T @ b)
    return b, {
        "landmark_rms_before_mm": _rms(residual, w),
        "landmark_rms_mm": _rms(after, w),
        "bending": float(d @ (K2 @ d)),
        "condition": condition,
    }


def _rms(residual: Array, weights: Array) -> float:
    return float(np.sqrt((weights * (residual**2).sum(2)).sum()))
