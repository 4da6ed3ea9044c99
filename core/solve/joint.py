"""Shading and motion in one linearised system over all photos.

The paper alternates between normals (1st order) and landmarks (0th order).  Here both
kinds of information come from the intensities themselves: with the displacement
``delta`` of the surface along its normals, the residual of photo ``i`` at point ``j``

    r_ij = I_i(pi_i(X_j)) - rho_j L_i . Y(n_j)

changes by ``(grad I . dpi/dX n_j) delta`` (motion, 0th order) and by
``rho_j L_i Y'(n_j) (g^u delta_u + g^v delta_v)`` (shading, 1st order, because the
normal turns by minus the surface gradient of ``delta``).  ``delta`` is a spline with
the surface's own basis, so both terms are rows of ``T, T1, T2``.  One Gauss-Newton
system holds ``delta``, the identity modes, all cameras and all lights; the albedo
``rho_j`` is projected out point by point.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse.linalg import splu

from ..evidence import harmonics
from ..evidence.camera import PARAMETERS, Camera
from ..evidence.photometric import (
    PhotometricEvidence,
    estimate_lighting,
    light_diversity,
)
from ..evidence.photos import Photo
from ..evidence.sampling import smooth_photo, view_weights
from ..evidence.shadowing import sky
from ..surface.bspline import BSplineSurface, basis_matrix
from ..surface.prior import ShapePrior
from ..surface.template import Template
from .bundle import Bundle, Observations
from .joint_system import add_landmarks, contravariant, normal_equations, read_photos

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Level:
    """One resolution of the coarse-to-fine schedule."""

    blur_mm: float
    iterations: int
    grid: int


@dataclass(frozen=True)
class JointOptions:
    """Weights of the joint refinement."""

    levels: tuple[Level, ...] = (
        Level(3.0, 5, 45),
        Level(1.6, 5, 55),
        Level(1.0, 5, 60),
    )
    noise: float = 0.06  #: Cauchy scale of intensities, of the photo's median
    independence: float = 0.5  #: share of the samples that count as independent
    landmark_mm: float = 1.5  #: standard deviation of a landmark in one photo
    landmark_weight: float = 0.05
    degree: int = 4  #: of the light's spherical harmonics, 1 to 4
    shadows: bool = True  #: of the face on itself
    grazing: float = 0.25
    distance_mm: float = 1200.0
    distance_spread: float = 0.25
    light_ridge: float = 1e-3
    max_step_mm: float = 4.0


@dataclass(frozen=True)
class JointState:
    """State after one iteration of `refine`."""

    surface: BSplineSurface
    cameras: tuple[Camera, ...]
    uv: Array
    albedo: Array
    lights: Array
    weights: Array
    residual: float
    step_mm: float
    level: int
    displacement: Array
    modes: Array
    values: Array
    intensity_residual: Array
    deviation: Array | None = None

    def evidence(self) -> PhotometricEvidence:
        """The photometric side of this state, lights as nine harmonics."""
        normals = self.surface.normals(*self.uv.T)
        Y = self.albedo[:, None] * harmonics.basis(normals)
        lights = np.stack(
            [
                np.linalg.lstsq(np.sqrt(w)[:, None] * Y, np.sqrt(w) * v, rcond=None)[0]
                for w, v in zip(self.weights, self.values, strict=True)
            ]
        )
        return PhotometricEvidence(
            self.uv,
            normals,
            np.repeat(self.albedo[:, None], 3, 1),
            lights,
            self.weights,
            self.intensity_residual,
            light_diversity(self.values, self.weights),
        )


def sample_grid(template: Template, grid: int) -> Array:
    """Skin points on a regular grid of (u, v), ``(p, 2)``."""
    x = (np.arange(grid) + 0.5) / grid
    uv = np.stack(np.meshgrid(x, x, indexing="ij"), -1).reshape(-1, 2)
    keep = template.is_skin(uv) & template.inside(uv)
    for dx, dy in ((0.01, 0), (-0.01, 0), (0, 0.01), (0, -0.01)):
        keep &= template.is_skin(uv + (dx, dy))
    return uv[keep]


def refine(
    template: Template,
    prior: ShapePrior,
    start: Bundle,
    photos: Sequence[Photo],
    seen: Observations,
    options: JointOptions = JointOptions(),  # noqa: B008 (frozen)
) -> Iterator[JointState]:
    """Iterate the joint system from a motion result.

    Parameters
    ----------
    template : Template
    prior : ShapePrior
        Of the displacement from the template.
    start : Bundle
        Surface, cameras and landmark structure to start from.
    photos : sequence of n
    seen : Observations
        Landmarks.

    Yields
    ------
    JointState
        After each iteration.
    """
    shape = start.surface.shape
    surface = reference = start.surface
    greville = [(np.arange(c) - 1.0) / (c - 3) for c in shape]
    gu, gv = np.meshgrid(*greville, indexing="ij")
    directions = reference.normals(np.clip(gu, 0, 1), np.clip(gv, 0, 1)).reshape(-1, 3)
    D = np.einsum("kbx,bx->bk", prior.modes, directions)
    # the prior holds the whole displacement from the template, so what the start
    # already has counts too
    d0, a0 = (start.smooth * directions).sum(1), start.modes
    d, a = np.zeros(D.shape[0]), np.zeros(D.shape[1])
    cameras = list(start.cameras)
    n, order = len(cameras), (options.degree + 1) ** 2
    lights = np.zeros((n, order))
    mark_uv = template.landmark_uv[seen.index]
    mark_T = basis_matrix(shape, *mark_uv.T)
    offset = start.structure - surface.evaluate(*mark_uv.T)

    for number, level in enumerate(options.levels):
        uv = sample_grid(template, level.grid)
        T = [basis_matrix(shape, *uv.T, *k) for k in ((0, 0), (1, 0), (0, 1))]
        area = np.linalg.norm(
            np.cross(reference.evaluate(*uv.T, 1, 0), reference.evaluate(*uv.T, 0, 1)),
            axis=1,
        )
        area /= area.mean()
        fields = [
            smooth_photo(q, c, level.blur_mm)
            for q, c in zip(photos, cameras, strict=True)
        ]
        albedo = np.ones(len(uv))
        over = sky(surface, uv, options.degree, options.shadows)
        for turn_number in range(level.iterations):
            X, N = surface.evaluate(*uv.T), surface.normals(*uv.T)
            view = view_weights(surface, cameras, uv, options.grazing)
            value, h, c0 = read_photos(fields, cameras, X, T[0] @ directions, view)
            Y = over.basis(N)
            lights, albedo, W, r = estimate_lighting(
                value,
                view * area,
                Y,
                lights,
                albedo,
                options.noise,
                ridge=options.light_ridge,
            )
            # derivative rows: displacement, its u and v slopes; camera; light
            fu, fv = surface.evaluate(*uv.T, 1, 0), surface.evaluate(*uv.T, 0, 1)
            up_u, up_v = contravariant(fu, fv)
            turn = albedo * np.einsum(
                "ik,pkx->ipx", lights, over.slope(N)
            ).transpose(2, 0, 1)
            c = np.stack(
                [
                    c0,
                    np.einsum("xip,px->ip", turn, up_u),
                    np.einsum("xip,px->ip", turn, up_v),
                ],
                -1,
            )
            light_rows = -np.broadcast_to((albedo[:, None] * Y), (n, *Y.shape))
            h = np.concatenate([h, light_rows], 2)
            s = lights @ Y.T
            scaled = W * options.independence / options.noise**2
            blocks = normal_equations(T, c, h, s, scaled, r)
            add_landmarks(
                blocks,
                seen,
                cameras,
                surface,
                offset,
                mark_uv,
                mark_T,
                directions,
                options.landmark_mm,
                options.landmark_weight,
            )
            S, gd, B, H, gh = sum(blocks[0][1:], blocks[0][0]), *blocks[1:]
            m = H.shape[1] // n
            H += np.diag(_border_prior(options, n, m, lights))
            gh += _border_pull(options, cameras, n, m)
            Hdd = sparse.csc_array(S + prior.smooth)
            SD = S @ D
            border = np.concatenate([SD, B], 1)
            Hbb = np.block([[D.T @ SD + np.eye(len(a)), D.T @ B], [B.T @ D, H]])
            gb = np.concatenate([D.T @ gd - a - a0, gh])
            gdd = gd - prior.smooth @ (d + d0)
            solve = splu(Hdd, permc_spec="MMD_AT_PLUS_A").solve
            Z = solve(np.concatenate([border, gdd[:, None]], 1))
            schur = Hbb - border.T @ Z[:, :-1]
            step = cho_solve(cho_factor(schur), gb - border.T @ Z[:, -1])
            dd = Z[:, -1] - Z[:, :-1] @ step
            total = dd + D @ step[: len(a)]
            size = float(np.abs(T[0] @ total).max())
            damp = min(1.0, options.max_step_mm / max(size, 1e-12))
            d, a = d + damp * dd, a + damp * step[: len(a)]
            own = damp * step[len(a) :].reshape(n, -1)
            cameras = [
                k.moved(x[:PARAMETERS]) for k, x in zip(cameras, own, strict=True)
            ]
            lights = lights + own[:, PARAMETERS:]
            surface = BSplineSurface(
                reference.control_points
                + ((d + D @ a)[:, None] * directions).reshape(*shape, 3)
            )
            residual = np.sqrt((W * r**2).sum() / max(W.sum(), 1e-30))
            deviation = None
            if (number, turn_number + 1) == (len(options.levels) - 1, level.iterations):
                own_Z, photo_Z = Z[:, : len(a)], Z[:, len(a) : -1]
                deviation = _deviation(solve, own_Z, photo_Z, schur, D)
            yield JointState(
                surface, tuple(cameras), uv, albedo, lights, W, float(residual),
                damp * size, number, d, a, value, r, deviation,
            )  # fmt: skip


def _deviation(solve, Za, Zh, schur, D) -> Array:
    """Standard deviation of the control points' displacement, mm, ``(M*N,)``.

    The diagonal of ``[I D] H^-1 [I D]^T`` for the bordered normal matrix ``H``.
    """
    Z = np.concatenate([Za - D, Zh], 1)
    inner = solve(np.eye(len(D))).diagonal()
    outer = (Z * cho_solve(cho_factor(schur), Z.T).T).sum(1)
    return np.sqrt(np.maximum(inner + outer, 0.0))


def _border_prior(options, n, m, lights):
    prior = np.full((n, m), 1e-6)
    prior[:, 6] = 1 / options.distance_spread**2
    prior[:, PARAMETERS:] = 1.0
    return prior.ravel()


def _border_pull(options, cameras, n, m):
    pull = np.zeros((n, m))
    for i, c in enumerate(cameras):
        if c.kappa > 0:
            drift = np.log(c.kappa * options.distance_mm)
            pull[i, 6] = -drift / options.distance_spread**2
    return pull.ravel()
