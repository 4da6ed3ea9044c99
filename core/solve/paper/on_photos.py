"""Algorithm 1 on photos: as printed ("paper") or with robust ingredients ("imls")."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...camera.camera import Camera
from ...images.photo import Photo
from ...photometry import harmonics
from ...photometry.lighting import PhotometricEvidence, light_diversity, robust_normals
from ...photometry.sampling import smooth_photo, view_weights
from ...progress import CheckCancelled, never_cancelled
from ...settings import Settings
from ...surface.bspline import BSplineSurface
from ...surface.template import Template
from ..joint.samples import sample_grid
from ..motion import LandmarkObservations
from .algorithm1 import ImlsState, Limits, NormalField, Steps, imls, paper_steps
from .motion import PaperLandmarks
from .shading import ShadingParameters

Array = NDArray[np.float64]
BLUR_MM = 1.5
GRID = 55


def sample_photos(
    photos: Sequence[Photo],
    surface: BSplineSurface,
    cameras: Sequence[Camera],
    uv: Array,
    blur_mm: float = BLUR_MM,
    check_cancelled: CheckCancelled = never_cancelled,
) -> tuple[Array, Array]:
    """The matrix ``M`` of section 2.2.1 and its visibility weights, ``(n, p)`` each.

    Intensities are luminances over the median of their photo. ``check_cancelled`` is called for
    each of them.
    """
    view = view_weights(surface, cameras, uv)
    points = surface.evaluate(*uv.T)
    M = np.zeros_like(view)
    for i, (photo, camera) in enumerate(zip(photos, cameras, strict=True)):
        check_cancelled()
        value, _, inside = smooth_photo(photo, camera, blur_mm).read(
            camera.project(points)
        )
        view[i] *= inside
        seen = view[i] > 0
        scale = float(np.median(value[seen, 0])) if seen.any() else 1.0
        M[i] = value[:, 0] / max(scale, 1e-3)
    return M, view


def run_imls(
    photos: Sequence[Photo],
    template: Template,
    seen: LandmarkObservations,
    settings: Settings,
    on_state: Callable[[ImlsState], None],
    check_cancelled: CheckCancelled = never_cancelled,
) -> tuple[BSplineSurface, tuple[Camera, ...], PhotometricEvidence]:
    """Run Algorithm 1 to its end.

    Parameters
    ----------
    photos : sequence of n Photo
    template : Template
    seen : Observations
    settings : Settings
        ``method`` "paper" or "imls", ``lam``, ``zeta``, ``outer_passes``.
    on_state : callable
        Gets each state; may raise to stop.
    tick : callable, optional
        Called for each photo that is sampled and in each robust step.

    Returns
    -------
    surface : BSplineSurface
    cameras : tuple of n Camera
    evidence : PhotometricEvidence
    """
    uv = sample_grid(template, GRID)
    marks = PaperLandmarks(
        seen.pixels,
        seen.weight,
        template.landmark_uv[seen.index],
        np.array([[(w - 1) / 2, (h - 1) / 2] for w, h in (p.size for p in photos)]),
        tuple(p.name for p in photos),
    )

    def sample(surface: BSplineSurface, cameras: Sequence[Any]) -> tuple[Array, Array]:
        pairs = [
            (p, c)
            for p, c in zip(photos, cameras, strict=True)
            if isinstance(c, Camera)
        ]
        shown, seen_by = [p for p, _ in pairs], [c for _, c in pairs]
        return sample_photos(
            shown, surface, seen_by, uv, check_cancelled=check_cancelled
        )

    steps = paper_steps(
        marks,
        template.surface.shape,
        uv,
        sample,
        zeta=settings.zeta,
        shading=ShadingParameters(lam=settings.lam),
    )
    if settings.method == "imls":
        steps = replace(
            steps, photometric=_robust(sample, uv, settings, check_cancelled)
        )
    state = None
    for state in imls(template.surface, uv, steps, Limits(outer=settings.outer_passes)):
        on_state(state)
    assert state is not None
    cameras = tuple(c for c in state.cameras if isinstance(c, Camera))
    M, view = sample(state.surface, state.cameras)
    normals, albedo, lights, W = robust_normals(
        M,
        view,
        state.surface.normals(*uv.T),
        noise=settings.intensity_noise,
        check_cancelled=check_cancelled,
    )
    residual = M - albedo * (lights @ harmonics.basis(normals).T)
    evidence = PhotometricEvidence(
        uv,
        normals,
        np.repeat(albedo[:, None], 3, 1),
        lights,
        W,
        residual,
        light_diversity(M, view),
    )
    return state.surface, cameras, evidence


def _robust(
    sample, uv: Array, settings: Settings, check_cancelled: CheckCancelled
) -> Steps | Any:
    def photometric(surface, template, cameras) -> NormalField:
        M, view = sample(surface, cameras)
        normals, _, _, W = robust_normals(
            M,
            view,
            surface.normals(*uv.T),
            order=4 if settings.light_degree == 1 else 9,
            noise=settings.intensity_noise,
            check_cancelled=check_cancelled,
        )
        total = W.sum(0)
        return NormalField(normals, total / max(float(np.median(total)), 1e-9), None)

    return photometric
