"""Algorithm 1 on photos as printed: the method "paper"."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..._types import Array
from ...camera.camera import Camera
from ...images.photo import Photo
from ...photometry import harmonics
from ...photometry.lighting import PhotometricEvidence, light_diversity, robust_normals
from ...photometry.sampling import smooth_photo, view_weights
from ...problem import FaceEstimate, Iteration, Problem
from ...progress import CheckCancelled, never_cancelled
from ...surface.bspline import BSplineSurface
from ...surface.template import Template
from ..joint.samples import sample_grid
from .algorithm1 import Cameras, Limits, State, Steps, algorithm1, paper_steps
from .shading import ShadingParameters

BLUR_MM = 1.5
GRID = 55
#: Ridge of Eq. 6 and 7 on photos, whose normals are wrong by 20 degrees: it holds the
#: control points beyond the samples, which drift by centimetres with a smaller one.
RIDGE = 1e-2


def paper(
    problem: Problem, estimate: FaceEstimate, check_cancelled: CheckCancelled
) -> Iterator[Iteration]:
    """Algorithm 1 as printed; ``estimate`` is not its start.

    Yields
    ------
    Iteration
        After each turn of each loop; the last one carries the photometric evidence.

    Raises
    ------
    ReconstructionError
        When no photo can be posed or a linear system has no solution.
    """
    steps = _steps(problem, check_cancelled)
    limits = Limits(outer=problem.settings.outer_passes)
    template = problem.template.surface
    uv = sample_grid(problem.template, GRID)
    for state in algorithm1(template, uv, steps, limits):
        now = _estimate(problem, estimate, state)
        if state.finished:
            evidence = _evidence(problem, state, uv, check_cancelled)
            now = replace(now, photometric=evidence)
        yield Iteration(
            state.stage, now, state.residual, state.change_mm, *limits.progress(state)
        )


def sample_photos(
    photos: Sequence[Photo],
    surface: BSplineSurface,
    cameras: Cameras,
    uv: Array,
    check_cancelled: CheckCancelled = never_cancelled,
) -> tuple[Array, Array]:
    """The matrix ``M`` of section 2.2.1 and its visibility weights, ``(n, p)`` each.

    Intensities are luminances over the median of their photo. A photo without a camera
    sees nothing. ``check_cancelled`` is called for each photo.
    """
    posed = {i: c for i, c in enumerate(cameras) if isinstance(c, Camera)}
    points = surface.evaluate(*uv.T)
    M, view = np.zeros((2, len(photos), len(uv)))
    view[list(posed)] = view_weights(surface, list(posed.values()), uv)
    for i, camera in posed.items():
        check_cancelled()
        value, _, inside = smooth_photo(photos[i], camera, BLUR_MM).read(
            camera.project(points)
        )
        view[i] *= inside
        seen = view[i] > 0
        scale = float(np.median(value[seen, 0])) if seen.any() else 1.0
        M[i] = value[:, 0] / max(scale, 1e-3)
    return M, view


def _steps(problem: Problem, check_cancelled: CheckCancelled) -> Steps:
    uv = sample_grid(problem.template, GRID)

    def sample(surface: BSplineSurface, cameras: Cameras) -> tuple[Array, Array]:
        return sample_photos(problem.photos, surface, cameras, uv, check_cancelled)

    return paper_steps(
        problem.landmarks,
        problem.template.surface.shape,
        uv,
        sample,
        zeta=problem.settings.zeta,
        shading=ShadingParameters(lam=problem.settings.lam, ridge=RIDGE),
        kept=_unseen(problem.template),
    )


def _unseen(template: Template) -> Array:
    """The points of the grid that are no skin, ``(k, 2)``."""
    x = (np.arange(GRID) + 0.5) / GRID
    uv = np.stack(np.meshgrid(x, x, indexing="ij"), -1).reshape(-1, 2)
    return uv[~template.is_skin(uv)]


def _estimate(problem: Problem, start: FaceEstimate, state: State) -> FaceEstimate:
    """The state as an estimate; a photo that lost its pose keeps its first camera."""
    posed = [isinstance(camera, Camera) for camera in state.cameras]
    surface = state.surface
    return replace(
        start,
        surface=surface,
        cameras=tuple(
            now if isinstance(now, Camera) else first
            for now, first in zip(state.cameras, start.cameras, strict=True)
        ),
        landmarks_xyz=surface.evaluate(*problem.landmarks.uv.T),
        expressions=np.zeros_like(start.expressions),
        modes=np.zeros_like(start.modes),
        smooth=surface.vector - problem.template.surface.vector,
        photo_weights=np.array(posed, float),
    )


def _evidence(
    problem: Problem, state: State, uv: Array, check_cancelled: CheckCancelled
) -> PhotometricEvidence:
    """Lights and albedo as the final surface has them."""
    surface = state.surface
    M, view = sample_photos(problem.photos, surface, state.cameras, uv, check_cancelled)
    normals, albedo, lights, W = robust_normals(
        M,
        view,
        surface.normals(*uv.T),
        noise=problem.settings.intensity_noise,
        check_cancelled=check_cancelled,
    )
    residual = M - albedo * (lights @ harmonics.basis(normals).T)
    return PhotometricEvidence(
        uv,
        normals,
        np.repeat(albedo[:, None], 3, 1),
        lights,
        W,
        residual,
        light_diversity(M, view),
    )
