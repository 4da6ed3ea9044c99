"""Robust photometric stereo on the surface: the default form of section 2.2.1.

The rank-4 factorisation needs every photo at every point, and neither hidden points
nor cast shadows nor highlights fit it (`photometric_svd`).  Here lights are solved from
the current normals, which also fixes the ambiguity ``A`` from the start; albedo and
robust weights alternate with them, and normals follow point by point, pulled gently to
where they started.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .._types import Array
from ..gram import gram, product
from ..progress import CheckCancelled, never_cancelled
from . import harmonics

#: The size of residuals, relative to the photo's median, at which a photo has the
#: noise that the settings name.
USUAL_RESIDUAL = 0.05
#: Power with which the independence of samples falls where all photos are noisier.
NOISY_POWER = 1.5
#: Factors on that noise for other photos: smallest, largest.
NOISE_RANGE = (0.4, 3.0)


@dataclass(frozen=True, eq=False)
class PhotometricEvidence:
    """What the shading of all photos says.

    Attributes
    ----------
    uv : (p, 2) array
        Sample points.
    normals : (p, 3) array
    albedo : (p, 3) array
        Linear RGB, relative.
    lights : (n, 9) array
        Spherical harmonics of each photo's light in head axes (`harmonics.basis`).
    weights : (n, p) array
        Robust weight of each sample, 0 where the photo does not see the point.
    residual : (n, p) array
        Intensity residual, relative to the photo's median.
    singular_values : (k,) array
        Of the intensities with equal brightness; how diverse the light is.
    """

    uv: Array
    normals: Array
    albedo: Array
    lights: Array
    weights: Array
    residual: Array
    singular_values: Array


class LightingFit(NamedTuple):
    """What `estimate_lighting` finds; shapes as there."""

    lights: Array
    albedo: Array
    weights: Array
    residual: Array


class NormalsFit(NamedTuple):
    """What `robust_normals` finds; shapes as there."""

    normals: Array
    albedo: Array
    lights: Array
    weights: Array


def estimate_lighting(
    values: Array,
    view: Array,
    Y: Array,
    lights: Array,
    albedo: Array,
    *,
    noise: float,
    rounds: int = 2,
    ridge: float = 1e-3,
) -> LightingFit:
    """Lights, albedo and robust weights for known normals.

    Parameters
    ----------
    values : (n, p) array
        Intensities over the median of their photo.
    view : (n, p) array
        Visibility weights.
    Y : (p, k), (1, p, k) or (n, p, k) array
        Harmonics of the normals, of all photos or of each.
    lights, albedo : (n, k), (p,) arrays
        Start; lights of zeros mean that nothing is known yet.
    noise : float
        Cauchy scale of the residuals.
    rounds : int
        Alternations.
    ridge : float
        Of the lights, relative.

    Returns
    -------
    lights : (n, k) array
    albedo : (p,) array
    weights : (n, p) array
    residual : (n, p) array
        ``values - albedo * lights @ Y.T``.
    """
    if not lights.any():
        seen = np.maximum(view.sum(0), 1e-9)
        albedo = np.clip((view * values).sum(0) / seen, 0.05, 5.0)
        rounds += 4
    Y = Y.reshape(-1, *Y.shape[-2:])
    residual = values - albedo * shading_of(lights, Y)
    W = view if not lights.any() else robust_weights(view, residual, noise)
    for _ in range(rounds):
        lights = solve_lights(values, W, Y, albedo, ridge)
        s = shading_of(lights, Y)
        albedo = solve_albedo(values, W, s)
        residual = values - albedo * s
        W = robust_weights(view, residual, noise)
    return LightingFit(lights, albedo, W, residual)


def solve_lights(
    values: Array, W: Array, Y: Array, albedo: Array, ridge: float | Array
) -> Array:
    """The light of each photo for a known albedo, ``(n, k)``.

    Arguments as in `estimate_lighting`, ``Y`` (1, p, k) or (n, p, k) and ``W`` the
    robust weights; ``ridge`` may be one of each harmonic, (k,).
    """
    n, order = len(values), Y.shape[2]
    energy, seen = np.sqrt(W) * albedo, W * albedo * values
    A = np.stack([gram(energy[i][:, None] * Y[i % len(Y)]) for i in range(n)])
    b = product(seen, Y[0]) if len(Y) == 1 else np.matmul(seen[:, None], Y)[:, 0]
    scale = np.trace(A, axis1=1, axis2=2)[:, None, None] / order + 1e-9
    A += scale * ridge * np.eye(order)
    return np.linalg.solve(A, b[..., None])[..., 0]


def shading_of(lights: Array, Y: Array) -> Array:
    """Shading by lights (n, k) and harmonics (1, p, k) or (n, p, k), ``(n, p)``."""
    if len(Y) == 1:
        return lights @ Y[0].T
    return np.matmul(Y, lights[..., None])[..., 0]


def solve_albedo(values: Array, W: Array, shading: Array) -> Array:
    """The albedo of each point under known shading (n, p), ``(p,)``."""
    energy = np.maximum((W * shading * shading).sum(0), 1e-9)
    return np.clip((W * shading * values).sum(0) / energy, 0.02, 20.0)


def robust_weights(view: Array, residual: Array, noise: float | Array) -> Array:
    """Visibility times the Cauchy weight of each residual, ``(n, p)``.

    ``noise`` is the Cauchy scale of all photos, or of each (n, 1).
    """
    return view / (1 + (residual / noise) ** 2)


def photo_noise(view: Array, residual: Array, noise: float) -> Array:
    """Cauchy scale of the residuals of each photo, ``(n, 1)``.

    Photos differ in resolution, compression and hardness of the light. How large the
    residuals of a photo are says how far to trust it.

    Parameters
    ----------
    view : (n, p) array
        Visibility weights.
    residual : (n, p) array
    noise : float
        Of a photo whose residuals are of usual size.
    """
    seen = view > 0
    photos = seen.sum(0)
    # The albedo of a point follows the photos that see it, the more so the fewer.
    unbiased = np.sqrt(photos / np.maximum(photos - 1, 1))
    factors = np.ones((len(view), 1))
    for i in range(len(view)):
        shared = seen[i] & (photos > 1)
        if shared.any():
            size = np.median(np.abs(residual[i, shared]) * unbiased[shared])
            factors[i] = 1.4826 * size / USUAL_RESIDUAL
    return noise * np.clip(factors, *NOISE_RANGE)


def independent_share(noise: float | Array, usual: float, share: float) -> Array:
    """Share of the samples of each photo that count as independent, ``(n, 1)``.

    What is not modelled (another expression, a hard shadow, make-up, compression) makes
    residuals that are larger, and alike from point to point.  So the share of a photo
    falls with its noise, relative to the median of all photos, and that of all photos
    falls where this median is above the usual noise.

    Parameters
    ----------
    noise : float or (n, 1) array
        Of the photos, see `photo_noise`.
    usual : float
        Noise of a usual photo.
    share : float
        Of a photo whose noise is the median, where that is usual or less.

    Returns
    -------
    (n, 1) array
        At most 1.
    """
    relative = np.reshape(np.asarray(noise, float) / usual, (-1, 1))
    middle = float(np.median(relative))
    found = share * middle / relative / max(middle, 1.0) ** NOISY_POWER
    return np.minimum(found, 1.0)


def robust_normals(
    values: Array,
    view: Array,
    start: Array,
    *,
    order: int = 9,
    noise: float = 0.06,
    pull: float = 0.05,
    rounds: int = 8,
    check_cancelled: CheckCancelled = never_cancelled,
) -> NormalsFit:
    """Normals by photometric stereo with masked, robust samples.

    Parameters
    ----------
    values, view : (n, p) arrays
        Intensities over the median of their photo, and visibility weights.
    start : (p, 3) array
        Normals of the current surface: start, gauge and weak reference.
    order : int
        4 or 9 harmonics.
    noise : float
        Cauchy scale.
    pull : float
        Weight of staying at ``start``, relative to the data of a usual point.
    rounds : int
        Alternations of lights and per-point steps.
    check_cancelled : callable
        Called in each of them; may raise `Cancelled`.

    Returns
    -------
    normals : (p, 3) array
    albedo : (p,) array
    lights : (n, order) array
    weights : (n, p) array
    """
    n, p = values.shape
    normals = start.copy()
    lights, albedo = np.zeros((n, order)), np.ones(p)
    W = view
    for _ in range(rounds):
        check_cancelled()
        Y = harmonics.basis(normals, order)
        fit = estimate_lighting(values, view, Y, lights, albedo, noise=noise)
        lights, albedo, W, r = fit
        t1, t2 = tangents(normals)
        turn = np.einsum("ik,pkx->ipx", lights, harmonics.slope(normals, order))
        turn = albedo[None, :, None] * turn
        J = np.stack(
            [(turn * t1).sum(2), (turn * t2).sum(2), lights @ Y.T], -1
        )  # (n, p, 3): two turns of the normal, albedo
        A = np.einsum("ipa,ip,ipb->pab", J, W, J)
        b = np.einsum("ipa,ip,ip->pa", J, W, r)
        hold = pull * np.median(A[:, 0, 0] + A[:, 1, 1]) + 1e-9
        away = start - normals
        A[:, 0, 0] += hold
        A[:, 1, 1] += hold
        # of its own size too: a point that one photo sees is singular otherwise
        A += 1e-9 * (1 + np.trace(A, axis1=1, axis2=2))[:, None, None] * np.eye(3)
        b[:, 0] += hold * (away * t1).sum(1)
        b[:, 1] += hold * (away * t2).sum(1)
        step = np.linalg.solve(A, b[..., None])[..., 0]
        size = np.maximum(np.hypot(step[:, 0], step[:, 1]) / 0.3, 1.0)[:, None]
        normals = normals + (step[:, :1] * t1 + step[:, 1:2] * t2) / size
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return NormalsFit(normals, albedo, lights, W)


def tangents(normals: Array) -> tuple[Array, Array]:
    """Two unit vectors across each normal, ``(p, 3)`` each."""
    axis = np.eye(3)[np.abs(normals).argmin(1)]
    a = np.cross(normals, axis)
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    return a, np.cross(normals, a)


def light_diversity(values: Array, weights: Array) -> Array:
    """Singular values of the intensities, divided by the first one, ``(k,)``.

    Only points that most photos see count, holes filled with the point's mean. The
    second to fourth value tell how much the light differs between the photos.
    """
    seen = weights > 0
    common = seen.mean(0) >= min(0.8, float(np.quantile(seen.mean(0), 0.75)))
    v, s = values[:, common], seen[:, common]
    mean = (v * s).sum(0) / np.maximum(s.sum(0), 1)
    d = np.linalg.svd(np.where(s, v, mean), compute_uv=False)
    return d / max(float(d[0]), 1e-12)
