"""A known face in a photo by its intensities, after its landmarks.

Detected landmarks slide with the pose by millimetres.  The albedo of a face that was
reconstructed from many photos says where everything is: the photo, lit by an unknown
light of nine harmonics, must show it.  One robust Gauss-Newton system holds camera,
expression and light; the landmarks keep a small weight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.linalg import block_diag

from .._types import Array
from ..camera.camera import PARAMETERS, Camera
from ..camera.prior import CameraPrior
from ..images.photo import Photo
from ..photometry import harmonics
from ..photometry.lighting import robust_weights, solve_lights
from ..photometry.sampling import IntensityField, smooth_photo, view_weights
from ..surface.bspline import basis_matrix, unit_normals
from .known_face import (
    KnownFace,
    PhotoLandmarks,
    PoseExpression,
    pose_equations,
    residual_mm,
)

FEWEST_SAMPLES = 100
MAX_STEP = 0.2  # radians, relative scale; expressions in standard deviations times 5
# Rotation, scale, shift (a hundred millimetres count as 1), distance.
_UNITS = np.array([1, 1, 1, 1, 0.01, 0.01, 0.3])
_ORDER = 9  # harmonics of the light
#: Precision of the step of a camera's parameters.
CAMERA_DAMPING = 1e-6


@dataclass(frozen=True)
class ShadingOptions:
    """Weights of the fit to the intensities."""

    blurs_mm: tuple[float, ...] = (3.0, 1.6, 1.0)
    iterations: int = 6  #: at each blur
    noise: float = 0.06  #: Cauchy scale of intensities, relative to the photo's median
    independence: float = 0.5  #: share of the samples that count as independent
    landmark_weight: float = 0.05
    grazing: float = 0.25
    light_ridge: float = 1e-3
    camera: CameraPrior = CameraPrior(damping=CAMERA_DAMPING)  # noqa: RUF009 (frozen)


@dataclass(frozen=True)
class SkinSamples:
    """Points of a known face with their albedo.

    Attributes
    ----------
    uv : (p, 2) array
    albedo : (p,) array
    T : three (p, M*N) sparse arrays
        Basis at the points: value, u and v slope.
    offsets : (p, 3, k) array
        Displacement of the points by the expression modes.
    """

    uv: Array
    albedo: Array
    T: Sequence[sparse.csr_array]
    offsets: Array


def skin_samples(face: KnownFace, uv: Array, albedo: Array) -> SkinSamples:
    """Points of a known face with their albedo, ready for `refine_pose_expression`."""
    shape = face.surface.shape
    u, v = uv.T
    T = [basis_matrix(shape, u, v, *k) for k in ((0, 0), (1, 0), (0, 1))]
    offsets = [T[0] @ mode.reshape(-1, 3) for mode in face.modes]
    empty = np.zeros((len(uv), 3, 0))
    return SkinSamples(uv, albedo, T, np.stack(offsets, -1) if offsets else empty)


def refine_pose_expression(
    face: KnownFace,
    skin: SkinSamples,
    start: PoseExpression,
    photo: Photo,
    marks: PhotoLandmarks,
    options: ShadingOptions | None = None,
) -> PoseExpression:
    """Improve a pose by what the photo shows.

    Parameters
    ----------
    face : KnownFace
    skin : SkinSamples
        Of the face.
    start : PoseExpression
        From the landmarks.
    photo : Photo
    marks : PhotoLandmarks
        Of the photo.
    options : ShadingOptions, optional

    Returns
    -------
    PoseExpression
        The start where too little of the face is seen.
    """
    options = options or ShadingOptions()
    camera, e, iterations = start.camera, start.expression, start.iterations
    for blur in options.blurs_mm:
        intensities = smooth_photo(photo, camera, blur)
        light = np.zeros(_ORDER)
        for _ in range(options.iterations):
            rows = _intensity_rows(face, skin, intensities, (camera, e), options)
            if rows is None:
                return start
            light = _light(rows, light, options)
            step = _step(face, rows, (camera, e, light), marks, options)
            k = PARAMETERS + len(e)
            camera = camera.moved(step[:PARAMETERS])
            e, light = e + step[PARAMETERS:k], light + step[k:]
            iterations += 1
    return PoseExpression(camera, e, residual_mm(face, camera, e, marks), iterations)


class _Rows(NamedTuple):
    """One photo at the samples: intensities, derivatives, shading; q = 7 + k."""

    value: Array  # (p,) over the median
    by_pose: Array  # (p, q) by camera and expression
    shading: Array  # (p, 9) by each harmonic, albedo included
    view: Array  # (p,) visibility


def _intensity_rows(
    face: KnownFace,
    skin: SkinSamples,
    intensities: IntensityField,
    at: tuple[Camera, Array],
    options: ShadingOptions,
) -> _Rows | None:
    """Read the photo at the samples; None where it shows too few of them."""
    camera, e = at
    surface = face.with_expression(e)
    X, fu, fv = (T @ surface.vector for T in skin.T)
    N = unit_normals(fu, fv)
    view = view_weights(surface, [camera], skin.uv, options.grazing)[0]
    where, J, C = camera.jacobians(X)
    value, slope, inside = intensities.read(where)
    view = view * inside
    if (view > 0).sum() < FEWEST_SAMPLES:
        return None
    middle = max(float(np.median(value[view > 0])), 1e-3)
    value, slope = value[:, 0] / middle, slope[:, 0] / middle
    by_camera = np.einsum("px,pxa->pa", slope, C)
    by_expression = np.einsum("px,pxy,pyk->pk", slope, J, skin.offsets)
    shading = skin.albedo[:, None] * harmonics.basis(N, _ORDER)
    return _Rows(value, np.concatenate([by_camera, by_expression], 1), shading, view)


def _light(rows: _Rows, light: Array, options: ShadingOptions) -> Array:
    """Robust least squares for the light of the photo, ``(9,)``."""
    flat = np.ones(len(rows.value))
    for _ in range(2 if light.any() else 6):
        r = rows.value - rows.shading @ light if light.any() else np.zeros_like(flat)
        w = robust_weights(rows.view, r, options.noise)
        (light,) = solve_lights(
            rows.value[None], w[None], rows.shading[None], flat, options.light_ridge
        )
    return light


def _step(
    face: KnownFace,
    rows: _Rows,
    at: tuple[Camera, Array, Array],
    marks: PhotoLandmarks,
    options: ShadingOptions,
) -> Array:
    """Damped Gauss-Newton step of camera, expression and light, ``(q + 9,)``."""
    camera, e, light = at
    r = rows.value - rows.shading @ light
    w = robust_weights(rows.view, r, options.noise)
    w *= options.independence / options.noise**2
    all_rows = np.concatenate([rows.by_pose, -rows.shading], 1)
    A = all_rows.T @ (w[:, None] * all_rows)
    b = -all_rows.T @ (w * r)
    q = PARAMETERS + len(e)
    own, right = pose_equations(face, camera, e, marks)
    A[:q, :q] += options.landmark_weight * own
    b[:q] += options.landmark_weight * right
    prior = options.camera.of_photo(marks.focal_px)
    A += block_diag(prior.precision(), np.eye(len(e) + len(light)))
    b[:q] += np.concatenate([prior.pull(camera), -e])
    step = np.linalg.solve(A, b)
    size = max(
        np.abs(step[:PARAMETERS] * _UNITS).max(),
        np.abs(step[PARAMETERS:q]).max(initial=0.0) / 5,
    )
    return step * min(1.0, MAX_STEP / max(size, 1e-12))
