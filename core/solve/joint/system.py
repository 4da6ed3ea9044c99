"""The joint system: derivative rows, albedo elimination, landmarks, the step.

All blocks have the form ``T_a^T diag(.) T_b`` with ``a, b`` in value, u-slope, v-slope;
what belongs to one photo (camera, light) borders them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve

from ...camera.camera import PARAMETERS, Camera
from ...photometry.sampling import IntensityField
from ...surface.bspline import BSplineSurface
from ..motion import LandmarkObservations
from .block_banded import BlockCholesky, block_cholesky
from .gram import gram

Array = NDArray[np.float64]


class Blocks(NamedTuple):
    """Normal equations of displacement and photos.

    Attributes
    ----------
    S : list of (M*N, M*N) sparse arrays
        To be summed: block of the displacement.
    gd : (M*N,) array
        Its right side.
    B : (M*N, n m) array
        Block between displacement and photos.
    H, gh : (n m, n m), (n m,) arrays
        Block and right side of the photos.
    """

    S: list[sparse.csr_array]
    gd: Array
    B: Array
    H: Array
    gh: Array


def read_photos(
    fields: Sequence[IntensityField],
    cameras: Sequence[Camera],
    X: Array,
    direction: Array,
    view: Array,
) -> tuple[Array, Array, Array]:
    """Intensities and how they change with the geometry.

    Parameters
    ----------
    fields, cameras : sequences of n
    X : (n, p, 3) array
        The points as they are in each photo.
    direction : (p, 3) array
        In which they may move.
    view : (n, p) array
        Visibility; set to 0 in place where a photo does not reach.

    Returns
    -------
    value : (n, p) array
        Intensities over the median of their photo.
    by_camera : (n, p, 7) array
    by_displacement : (n, p) array
    """
    n, p = view.shape
    value, along = np.zeros((n, p)), np.zeros((n, p))
    rows = np.zeros((n, p, PARAMETERS))
    for i, (field, camera) in enumerate(zip(fields, cameras, strict=True)):
        pixels, J, C = camera.jacobians(X[i])
        v, g, inside = field.read(pixels)
        view[i] *= inside
        seen = view[i] > 0
        scale = np.median(v[seen, 0]) if seen.any() else 1.0
        scale = max(float(scale), 1e-3)
        value[i], g = v[:, 0] / scale, g[:, 0] / scale
        rows[i] = np.einsum("px,pxa->pa", g, C)
        along[i] = np.einsum("px,pxa,pa->p", g, J, direction)
    return value, rows, along


def contravariant(fu: Array, fv: Array) -> tuple[Array, Array]:
    """``g^u, g^v``: the surface gradient of f is ``g^u f_u + g^v f_v``; (p, 3) each."""
    E, F, G = (fu * fu).sum(1), (fu * fv).sum(1), (fv * fv).sum(1)
    det = np.maximum(E * G - F * F, 1e-9)[:, None]
    return (
        (G[:, None] * fu - F[:, None] * fv) / det,
        (E[:, None] * fv - F[:, None] * fu) / det,
    )


def normal_equations(
    T: Sequence[sparse.csr_array], c: Array, h: Array, s: Array, W: Array, r: Array
) -> Blocks:
    """Blocks of the Gauss-Newton system with the albedo projected out.

    Parameters
    ----------
    T : three (p, M*N) sparse arrays
        ``T, T1, T2`` at the sample points.
    c : (n, p, 3) array
        Derivative of the residual by displacement and its two slopes.
    h : (n, p, m) array
        Derivative by camera and light of the photo.
    s, W, r : (n, p) arrays
        Shading (minus the derivative by the albedo), weights, residuals.

    Returns
    -------
    Blocks
    """
    n, p, m = h.shape
    Ws = W * s
    den = np.maximum((Ws * s).sum(0), 1e-9)
    r = r - s * ((Ws * r).sum(0) / den)
    Wc = W[..., None] * c
    cs = np.einsum("ip,ipa->pa", Ws, c)
    share = cs / den[:, None]
    A = np.einsum("ipa,ipb->pab", Wc, c) - cs[:, :, None] * share[:, None, :]
    S = [
        T[a].T @ sparse.diags_array(A[:, a, b]) @ T[b]
        for a in range(3)
        for b in range(3)
    ]
    right = -np.einsum("ipa,ip->pa", Wc, r)
    gd = np.sum([T[a].T @ right[:, a] for a in range(3)], axis=0)
    # photo by photo: what one photo needs stays in the processor's cache
    upright = [sparse.csr_array(t.T) for t in T]
    B = np.empty((T[0].shape[1], n * m))
    G = np.empty((p, n * m))
    own = np.empty((n, m, m))
    gh = np.empty(n * m)
    root = np.sqrt(den)
    for i in range(n):
        k = slice(i * m, (i + 1) * m)
        G[:, k] = (Ws[i] / root)[:, None] * h[i]
        B[:, k] = sum(
            t @ ((Wc[i, :, a] - share[:, a] * Ws[i])[:, None] * h[i])
            for a, t in enumerate(upright)
        )
        Wh = W[i][:, None] * h[i]
        own[i] = Wh.T @ h[i]
        gh[k] = -(Wh.T @ r[i])
    H = gram(G)
    np.negative(H, out=H)
    for i in range(n):
        k = slice(i * m, (i + 1) * m)
        H[k, k] += own[i]
    return Blocks(S, gd, B, H, gh)


def add_landmarks(
    blocks: Blocks,
    seen: LandmarkObservations,
    cameras: Sequence[Camera],
    surface: BSplineSurface,
    offset: Array,
    uv: Array,
    T: sparse.csr_array,
    directions: Array,
    sigma: float,
    weight: float,
) -> None:
    """Add the reprojection of the landmarks, which move with the surface, in place.

    Parameters
    ----------
    blocks : Blocks
    seen, cameras, surface
    offset : (n, f, 3) array
        From the surface point to the landmark in each photo.
    uv, T : (f, 2) array, (f, M*N) sparse array
        The surface points.
    directions : (M*N, 3) array
        Directions in which control points move.
    sigma, weight : float
        Standard deviation of a landmark (mm) and weight of the whole term.
    """
    S, gd, B, H, gh = blocks
    X, normal = surface.evaluate(*uv.T), surface.normals(*uv.T)
    along = T @ directions
    m = H.shape[1] // len(cameras)
    total = np.zeros(len(uv))
    upright = sparse.csr_array(T.T)
    for i, camera in enumerate(cameras):
        p, J, C = camera.jacobians(X + offset[i])
        r = (seen.pixels[i] - p) / camera.s
        J, C = np.einsum("lxa,la->lx", J, along) / camera.s, C / camera.s
        facing = np.clip(((camera.toward(X) * normal).sum(1) - 0.1) / 0.3, 0, 1)
        w = weight * seen.weight[i] * facing / sigma**2
        w = w / (1 + (r**2).sum(1) / (3 * sigma) ** 2)
        k = slice(i * m, i * m + PARAMETERS)
        total += w * (J**2).sum(1)
        gd += upright @ (w * (J * r).sum(1))
        B[:, k] += upright @ (w[:, None] * np.einsum("lx,lxa->la", J, C))
        H[k, k] += np.einsum("lxa,l,lxb->ab", C, w, C)
        gh[k] += np.einsum("lxa,l,lx->a", C, w, r)
    S.append(upright @ sparse.diags_array(total) @ T)


def add_held(blocks: Blocks, weight: Array, away: Array) -> None:
    """Add control points that a person placed, in place.

    Parameters
    ----------
    blocks : Blocks
    weight : (M*N,) array
        Inverse variance of their displacement, 1/mm^2; 0 for free ones.
    away : (M*N,) array
        Displacement that would bring them to their places, mm.
    """
    S, gd, *_ = blocks
    S.append(sparse.csr_array(sparse.diags_array(weight)))
    gd += weight * away


def solve_bordered(
    blocks: Blocks,
    smooth: sparse.csr_array,
    shape: tuple[int, int],
    D: Array,
    d: Array,
    a: Array,
) -> tuple[Array, Array, Array, Callable[[], Array]]:
    """One Gauss-Newton step: sparse for the displacement, dense for modes and photos.

    Parameters
    ----------
    blocks : Blocks
    smooth : (M*N, M*N) sparse array
        Prior precision of the smooth displacement.
    shape : (M, N)
        Of the net.
    D : (M*N, k) array
        Displacement by the modes.
    d, a : (M*N,), (k,) arrays
        Smooth displacement and modes so far, counted from the prior's mean.

    Returns
    -------
    dd, da, step : (M*N,), (k,), (n m,) arrays
        Steps of displacement, modes and photos.
    deviation : callable
        Gives the standard deviation of each control point's displacement, ``(M*N,)``.
    """
    S = sum(blocks.S[1:], blocks.S[0])
    k = D.shape[1]
    SD = S @ D
    border = np.concatenate([SD, blocks.B], 1)
    DB = D.T @ blocks.B
    corner = np.block([[D.T @ SD + np.eye(k), DB], [DB.T, blocks.H]])
    right = np.concatenate([D.T @ blocks.gd - a, blocks.gh])
    top = blocks.gd - smooth @ d
    factor = block_cholesky(sparse.csr_array(S + smooth), shape)
    # border^T (S + smooth)^-1 border is the square of half a solution
    Y = factor.half(np.concatenate([border, top[:, None]], 1))
    y, Y = Y[:, -1], Y[:, :-1]
    schur = cho_factor(corner - gram(Y))
    step = cho_solve(schur, right - Y.T @ y)
    dd = factor.other_half((y - Y @ step)[:, None])[:, 0]
    return dd, step[:k], step[k:], lambda: _deviation(factor, Y, schur, D)


def _deviation(factor: BlockCholesky, Y: Array, schur, D: Array) -> Array:
    """The diagonal of ``[I D] H^-1 [I D]^T`` for the bordered matrix ``H``, rooted."""
    Z = factor.other_half(Y)
    Z[:, : D.shape[1]] -= D
    inner = factor.inverse_diagonal()
    outer = (Z * cho_solve(schur, Z.T).T).sum(1)
    return np.sqrt(np.maximum(inner + outer, 0.0))
