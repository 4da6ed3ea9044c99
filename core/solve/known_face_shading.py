"""A known face in a photo by its intensities, after its landmarks.

Detected landmarks slide with the pose by millimetres.  The albedo of a face that was
reconstructed from many photos says where everything is: the photo, lit by an unknown
light of nine harmonics, must show it.  One robust Gauss-Newton system holds camera,
expression and light; the landmarks keep a small weight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..camera.camera import PARAMETERS
from ..images.photo import Photo
from ..photometry import harmonics
from ..photometry.sampling import smooth_photo, view_weights
from ..surface.bspline import basis_matrix
from .known_face import KnownFace, Pose, normal_equations
from .motion import MotionOptions

Array = NDArray[np.float64]

FEWEST_SAMPLES = 100
MAX_STEP = 0.2  # radians, relative scale; expressions in standard deviations times 5


@dataclass(frozen=True)
class ShadingOptions:
    """Weights of the search by intensities; the same as those of `joint`."""

    blurs_mm: tuple[float, ...] = (3.0, 1.6, 1.0)
    rounds: int = 6  #: at each blur
    noise: float = 0.06  #: Cauchy scale of intensities, of the photo's median
    independence: float = 0.5  #: share of the samples that count as independent
    landmark_weight: float = 0.05
    grazing: float = 0.25
    light_ridge: float = 1e-3


@dataclass(frozen=True)
class Skin:
    """Albedo at points of a known face.

    Attributes
    ----------
    uv : (p, 2) array
    albedo : (p,) array
    T : three (p, M*N) sparse arrays
        Basis at the points: value, u and v slope.
    moves : (p, 3, k) array
        Displacement of the points by the expression modes.
    """

    uv: Array
    albedo: Array
    T: Sequence
    expression_offsets: Array


def skin(known: KnownFace, uv: Array, albedo: Array) -> Skin:
    """Points of a known face with their albedo, ready for `refine_pose_expression`."""
    shape = known.surface.shape
    u, v = uv.T
    T = [basis_matrix(shape, u, v, *k) for k in ((0, 0), (1, 0), (0, 1))]
    expression_offsets = [T[0] @ mode.reshape(-1, 3) for mode in known.modes]
    empty = np.zeros((len(uv), 3, 0))
    return Skin(
        uv, albedo, T, np.stack(expression_offsets, -1) if expression_offsets else empty
    )


def refine_pose_expression(
    known: KnownFace,
    at: Skin,
    start: Pose,
    photo: Photo,
    pixels: Array,
    weight: Array,
    prior: MotionOptions = MotionOptions(),  # noqa: B008 (frozen)
    options: ShadingOptions = ShadingOptions(),  # noqa: B008 (frozen)
) -> Pose:
    """Improve a pose by what the photo shows.

    Parameters
    ----------
    known : KnownFace
    at : Skin
    start : Pose
        From the landmarks.
    photo : Photo
    pixels, weight : (f, 2), (f,) arrays
        Its landmarks in the order of ``known.index``.
    prior : BundleOptions
        Standard deviations of camera and landmarks.
    options : ShadingOptions

    Returns
    -------
    Pose
        The start where too little of the face is seen.
    """
    camera, e = start.camera, start.expression
    k, rounds = len(e), start.rounds
    order = 9
    for blur in options.blurs_mm:
        field = smooth_photo(photo, camera, blur)
        light = np.zeros(order)
        for _ in range(options.rounds):
            surface = known.with_expression(e)
            X, fu, fv = (T @ surface.vector for T in at.T)
            N = np.cross(fv, fu)
            N /= np.maximum(np.linalg.norm(N, axis=1, keepdims=True), 1e-12)
            view = view_weights(surface, [camera], at.uv, options.grazing)[0]
            where, J, C = camera.jacobians(X)
            value, slope, inside = field.read(where)
            view = view * inside
            if (view > 0).sum() < FEWEST_SAMPLES:
                return start
            middle = max(float(np.median(value[view > 0])), 1e-3)
            value, slope = value[:, 0] / middle, slope[:, 0] / middle
            Y = at.albedo[:, None] * harmonics.basis(N, order)
            light = _light(value, view, Y, light, options)
            r = value - Y @ light
            w = view / (1 + (r / options.noise) ** 2)
            w *= options.independence / options.noise**2
            rows = np.concatenate(
                [
                    np.einsum("px,pxa->pa", slope, C),
                    np.einsum("px,pxy,pyk->pk", slope, J, at.expression_offsets),
                    -Y,
                ],
                1,
            )
            A = rows.T @ (w[:, None] * rows)
            b = -rows.T @ (w * r)
            marks = known.marks + known.expression_offsets @ e
            own, right, _ = normal_equations(
                known, camera, marks, pixels, weight, prior.robust
            )
            m = PARAMETERS + k
            A[:m, :m] += options.landmark_weight * own
            b[:m] += options.landmark_weight * right
            hold = np.full(len(b), 1e-6)
            hold[6] = 1 / prior.distance_spread**2
            hold[PARAMETERS:m] = 1.0
            hold[m:] = 1.0
            A[np.diag_indices_from(A)] += hold
            if camera.kappa:
                drift = np.log(camera.kappa * prior.distance_mm)
                b[6] -= drift / prior.distance_spread**2
            b[PARAMETERS:m] -= e
            step = np.linalg.solve(A, b)
            size = max(
                np.abs(step[:PARAMETERS] * _UNITS).max(),
                np.abs(step[PARAMETERS:m]).max(initial=0.0) / 5,
            )
            step *= min(1.0, MAX_STEP / max(size, 1e-12))
            camera = camera.moved(step[:PARAMETERS])
            e = e + step[PARAMETERS:m]
            light = light + step[m:]
            rounds += 1
    marks = known.marks + known.expression_offsets @ e
    away = np.linalg.norm(camera.project(marks) - pixels, axis=1)[weight > 0]
    residual = float(np.median(away)) / camera.s if len(away) else 0.0
    return replace(
        start, camera=camera, expression=e, residual_mm=residual, rounds=rounds
    )


# Rotation, scale, shift (a hundred millimetres count as 1), distance.
_UNITS = np.array([1, 1, 1, 1, 0.01, 0.01, 0.3])


def _light(value, view, Y, light, options: ShadingOptions) -> Array:
    """Robust least squares for the light of the photo."""
    for _ in range(6 if not light.any() else 2):
        r = value - Y @ light if light.any() else np.zeros_like(value)
        w = view / (1 + (r / options.noise) ** 2)
        A = Y.T @ (w[:, None] * Y)
        A += (np.trace(A) / len(A) + 1e-9) * options.light_ridge * np.eye(len(A))
        light = np.linalg.solve(A, Y.T @ (w * value))
    return light
