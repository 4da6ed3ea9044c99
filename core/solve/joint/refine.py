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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...camera.camera import PARAMETERS, Camera
from ...images.photo import Photo
from ...photometry import harmonics
from ...photometry.lighting import (
    PhotometricEvidence,
    estimate_lighting,
    light_diversity,
)
from ...photometry.sampling import smooth_photo, view_weights
from ...progress import CheckCancelled, never_cancelled
from ...surface.bspline import BSplineSurface, basis_matrix
from ...surface.prior import ShapePrior
from ...surface.template import Template
from ..motion import Bundle, LandmarkObservations
from .samples import sample_surface
from .system import (
    Blocks,
    add_held,
    add_landmarks,
    normal_equations,
    read_photos,
    solve_bordered,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Level:
    """One resolution of the coarse-to-fine schedule."""

    blur_mm: float
    iterations: int  #: at most; the last level takes them all
    grid: int


@dataclass(frozen=True)
class JointOptions:
    """Weights of the joint refinement."""

    levels: tuple[Level, ...] = (
        Level(3.0, 15, 40),
        Level(1.5, 10, 50),
        Level(0.8, 5, 75),
    )
    noise: float = 0.06  #: Cauchy scale of intensities, of the photo's median
    independence: float = 0.3  #: share of the samples that count as independent
    landmark_mm: float = 1.5  #: standard deviation of a landmark in one photo
    landmark_weight: float = 0.05
    degree: int = 6  #: of the light's spherical harmonics, 1 to 6
    coarse_degree: int = 4  #: the most of all levels but the last
    shadows: bool = True  #: of the face on itself
    grazing: float = 0.25  #: cosine of the viewing angle below which nothing is read
    distance_mm: float = 1200.0
    distance_spread: float = 0.25
    light_ridge: float = 1e-3
    max_step_mm: float = 4.0
    settled_mm: float = 0.3  #: largest step after which a coarse level is done


@dataclass(frozen=True)
class JointState:
    """State after one iteration of `refine`.

    Attributes
    ----------
    surface, cameras
        Where the face and the photos are now.
    uv, albedo, lights, weights, values, intensity_residual
        The photometric side: sample points (p, 2), albedo (p,), harmonics of the light
        (n, k), robust weights, intensities and residuals (n, p).
    residual : float
        Root mean square of the weighted residuals.
    step_mm : float
        Largest movement of the surface in this iteration.
    level, turn : int
        Which level, and how many steps it has taken.
    modes : (k,) array
        Coefficients of the prior's modes, start included.
    deviation : (M*N,) array or None
        Standard deviation of the control points along their normals, mm; with the last
        state only.
    """

    surface: BSplineSurface
    cameras: tuple[Camera, ...]
    uv: Array
    albedo: Array
    lights: Array
    weights: Array
    values: Array
    intensity_residual: Array
    residual: float
    step_mm: float
    level: int
    turn: int
    modes: Array
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


class _Unknowns(NamedTuple):
    """Displacement of control points, modes, and the rest of the state."""

    d: Array
    a: Array
    cameras: list[Camera]
    lights: Array


def refine(
    template: Template,
    prior: ShapePrior,
    start: Bundle,
    photos: Sequence[Photo],
    seen: LandmarkObservations,
    options: JointOptions = JointOptions(),  # noqa: B008 (frozen)
    photo_weights: Array | None = None,
    check_cancelled: CheckCancelled = never_cancelled,
    held: Array | None = None,
) -> Iterator[JointState]:
    """Iterate the joint system from a motion result.

    Parameters
    ----------
    template : Template
    prior : ShapePrior
        Of the displacement from the template.
    start : Bundle
        Surface, cameras, landmark structure and expressions to start from.
    photos : sequence of n
    seen : Observations
        Landmarks.
    options : JointOptions
    photo_weights : (n,) array, optional
        How much each photo counts.
    tick : callable, optional
        Called between the parts of an iteration.
    held : (M*N,) array, optional
        Inverse variance (1/mm^2) of control points that belong where the template has
        them; 0 for free ones.

    Yields
    ------
    JointState
        After each iteration.
    """
    shape = start.surface.shape
    surface = reference = start.surface
    places = [np.clip((np.arange(c) - 1.0) / (c - 3), 0, 1) for c in shape]
    directions = reference.normals(*np.meshgrid(*places, indexing="ij"))
    directions = directions.reshape(-1, 3)
    D = np.einsum("kbx,bx->bk", prior.modes, directions)
    n = len(photos)
    weigh = np.ones(n) if photo_weights is None else photo_weights
    own = _own_faces(template, start)
    mark_uv = template.landmark_uv[seen.index]
    mark_T = basis_matrix(shape, *mark_uv.T)
    offset = start.structure - surface.evaluate(*mark_uv.T)
    offset = offset + np.stack([mark_T @ x.reshape(-1, 3) for x in own])
    # the prior holds the whole displacement from the template, so what the start
    # already has counts too
    before = ((start.smooth * directions).sum(1), start.modes)
    home = template.surface.vector - reference.vector
    home = (home * directions).sum(1)
    x = _Unknowns(
        np.zeros(len(D)),
        np.zeros(D.shape[1]),
        list(start.cameras),
        np.zeros((n, 0)),
    )
    for number, level in enumerate(options.levels):
        fine = number + 1 == len(options.levels)
        degree = options.degree if fine else min(options.degree, options.coarse_degree)
        at = sample_surface(
            template, reference, surface, level.grid, own, degree, options.shadows
        )
        x = x._replace(lights=_with_degree(x.lights, degree))
        fields = []
        for q, c in zip(photos, x.cameras, strict=True):
            check_cancelled()
            fields.append(smooth_photo(q, c, level.blur_mm))
        albedo = np.ones(len(at.uv))
        for turn in range(level.iterations):
            check_cancelled()
            faces = [BSplineSurface(surface.control_points + e) for e in own]
            view = view_weights(
                faces if own.any() else surface, x.cameras, at.uv, options.grazing
            )
            view *= weigh[:, None]
            check_cancelled()
            X, N, up = at.geometry(surface)
            X = np.broadcast_to(X, (n, *X.shape[1:]))
            value, by_camera, along = read_photos(
                fields, x.cameras, X, at.T[0] @ directions, view
            )
            Y = np.stack([at.transfer.basis(k) for k in N])
            check_cancelled()
            lights, albedo, W, r = estimate_lighting(
                value, view * at.area, Y, x.lights, albedo, options.noise,
                ridge=options.light_ridge,
            )  # fmt: skip
            x = x._replace(lights=lights)
            check_cancelled()
            c, h, s = _rows(at, N, up, Y, lights, albedo, along, by_camera)
            scale = options.independence / options.noise**2
            check_cancelled()
            blocks = normal_equations(at.T, c, h, s, scale * W, r)
            del c, h, s  # the largest arrays, while the solution needs room
            check_cancelled()
            add_landmarks(
                blocks, seen, x.cameras, surface, offset, mark_uv, mark_T, directions,
                options.landmark_mm, options.landmark_weight,
            )  # fmt: skip
            _add_photo_priors(blocks, x.cameras, options)
            if held is not None:
                add_held(blocks, held, home - (x.d + D @ x.a))
            check_cancelled()
            dd, da, step, deviation = solve_bordered(
                blocks, prior.smooth, shape, D, x.d + before[0], x.a + before[1]
            )
            size = float(np.abs(at.T[0] @ (dd + D @ da)).max())
            damp = min(1.0, options.max_step_mm / max(size, 1e-12))
            step = damp * step.reshape(n, -1)
            x = _Unknowns(
                x.d + damp * dd,
                x.a + damp * da,
                [k.moved(y[:PARAMETERS]) for k, y in zip(x.cameras, step, strict=True)],
                lights + step[:, PARAMETERS:],
            )
            moved = ((x.d + D @ x.a)[:, None] * directions).reshape(*shape, 3)
            surface = BSplineSurface(reference.control_points + moved)
            check_cancelled()
            last = fine and turn + 1 == level.iterations
            yield JointState(
                surface=surface,
                cameras=tuple(x.cameras),
                uv=at.uv,
                albedo=albedo,
                lights=x.lights,
                weights=W,
                values=value,
                intensity_residual=r,
                residual=float(np.sqrt((W * r**2).sum() / max(W.sum(), 1e-30))),
                step_mm=damp * size,
                level=number,
                turn=turn + 1,
                modes=before[1] + x.a,
                deviation=deviation() if last else None,
            )
            if not fine and damp * size < options.settled_mm:
                break


def _own_faces(template: Template, start: Bundle) -> Array:
    """Displacement of the control points by the expression of each photo."""
    e = start.expressions
    modes = template.expression_modes[: e.shape[1]]
    shape = (*template.surface.shape, 3)
    if not e.any():
        return np.zeros((len(e), *shape))
    return np.einsum("ik,kuvx->iuvx", e, modes)


def _with_degree(lights: Array, degree: int) -> Array:
    """The same lights with harmonics up to a higher degree, the new ones zero."""
    more = (degree + 1) ** 2 - lights.shape[1]
    return np.pad(lights, ((0, 0), (0, more)))


def _rows(at, N, up, Y, lights, albedo, along, by_camera):
    """Derivatives of the residuals: by displacement and slopes; by photo; shading."""
    n = len(lights)
    c = np.zeros((*along.shape, 3))
    c[..., 0] = along
    h = np.zeros((*along.shape, PARAMETERS + lights.shape[1]))
    h[..., :PARAMETERS] = by_camera
    s = np.zeros_like(along)
    for k in range(len(N)):
        which = range(n) if len(N) == 1 else [k]
        turn = at.transfer.slopes(N[k], lights[list(which)])
        for t, i in zip(turn, which, strict=True):
            c[i, :, 1] = albedo * (t * up[k][0]).sum(1)
            c[i, :, 2] = albedo * (t * up[k][1]).sum(1)
            h[i, :, PARAMETERS:] = -albedo[:, None] * Y[k]
            s[i] = Y[k] @ lights[i]
    return c, h, s


def _add_photo_priors(blocks: Blocks, cameras: Sequence[Camera], options) -> None:
    """Distances near the typical one; a little damping for all the rest."""
    n = len(cameras)
    m = len(blocks.gh) // n
    hold = np.full((n, m), 1e-6)
    hold[:, 6] = 1 / options.distance_spread**2
    hold[:, PARAMETERS:] = 1.0
    blocks.H[np.diag_indices(n * m)] += hold.ravel()
    for i, camera in enumerate(cameras):
        if camera.kappa > 0:
            drift = np.log(camera.kappa * options.distance_mm)
            blocks.gh[i * m + 6] -= drift / options.distance_spread**2
