"""Cameras and face from landmarks together: the default form of section 2.3.

The paper alternates pose estimation and the warp of Eq. 8.  Here poses, perspective and
the 3D positions of the landmarks are one Gauss-Newton problem under the shape prior,
and the surface follows the landmarks by conditioning that prior on them (Eq. 8 with
``K`` replaced by the prior's precision).  Each landmark has an offset of its own,
common to all photos, because a detector places it a little elsewhere on every face.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from ..camera.camera import PARAMETERS, Camera
from ..progress import CheckCancelled, never_cancelled
from ..surface.bspline import BSplineSurface, basis_matrix
from ..surface.prior import ShapePrior
from ..surface.template import Template

Array = NDArray[np.float64]
# Of a camera's step: radians, relative change of scale and of distance.
FARTHEST = 1.0
_TURN_SIZE_DISTANCE = [0, 1, 2, 3, 6]


@dataclass(frozen=True)
class LandmarkObservations:
    """Landmarks of all photos on the template's numbering.

    Attributes
    ----------
    pixels : (n, f, 2) array
        Detected positions, pixels of the photos; anything where the weight is 0.
    weight : (n, f) array
        0 where a landmark is missing, 1 for the detector's usual accuracy, more for
        landmarks that were placed by hand.
    index : (f,) int array
        Which of the template's 468 landmarks.
    """

    pixels: Array
    weight: Array
    index: NDArray[np.int64]


@dataclass(frozen=True)
class MotionOptions:
    """Standard deviations of the bundle adjustment."""

    offset_mm: float = 1.2  #: landmark offset between faces
    noise_mm: float = 0.7  #: detector noise besides the template's own sigma
    distance_mm: float = 1200.0  #: typical distance of the camera
    distance_spread: float = 0.35  #: of its logarithm
    robust: float = 3.0  #: Cauchy scale in standard deviations
    expression: float = 1.0  #: scale of the expression modes, 0 = rigid face
    iterations: int = 15
    tolerance: float = 1e-4


@dataclass(frozen=True)
class Bundle:
    """Result of `estimate_motion`.

    Attributes
    ----------
    surface : BSplineSurface
    cameras : tuple of Camera
    structure : (f, 3) array
        3D positions of the landmarks, offsets included.
    modes : (k,) array
        Coefficients of the prior's modes.
    smooth : (M*N, 3) array
        The rest of the displacement from the template, mm.
    expressions : (n, k) array
        Coefficients of the template's expression modes in each photo, besides those
        in ``modes``.
    expression_scale : float
        Factor on the expression modes among ``modes``.
    residual : (n, f) array
        Reprojection error, mm at the head.
    weight : (n, f) array
        Weight that each landmark had in the end.
    history : tuple of float
        Root mean square residual after each iteration, mm.
    """

    surface: BSplineSurface
    cameras: tuple[Camera, ...]
    structure: Array
    modes: Array
    smooth: Array
    expressions: Array
    expression_scale: float
    residual: Array
    weight: Array
    history: tuple[float, ...]


def estimate_motion(
    template: Template,
    prior: ShapePrior,
    seen: LandmarkObservations,
    cameras: Sequence[Camera],
    options: MotionOptions = MotionOptions(),  # noqa: B008 (frozen)
    check_cancelled: CheckCancelled = never_cancelled,
) -> Bundle:
    """Cameras, landmark structure, expressions and the surface that follows them.

    ``check_cancelled`` is called once a photo in every iteration.
    """
    f, n = len(seen.index), len(cameras)
    uv = template.landmark_uv[seen.index]
    start = template.landmark_xyz[seen.index]
    normal = template.surface.normals(*uv.T)
    covariance = prior.displacement_covariance(
        uv, basis_matrix(template.surface.shape, *uv.T)
    )
    offset = options.offset_mm**2 * np.eye(3 * f)
    precision = _inverse(covariance + offset)
    E = _expression_basis(template, uv, options.expression)
    k = E.shape[2]
    sigma = np.hypot(template.landmark_sigma[seen.index], options.noise_mm)

    cameras = list(cameras)
    m = np.zeros((f, 3))
    e = np.zeros((n, k))
    history: list[float] = []
    residual = weight = np.zeros((n, f))
    for _ in range(options.iterations):
        H = precision.copy()
        g = -(precision @ m.ravel())
        blocks = []
        residual, weight = np.zeros((n, f)), np.zeros((n, f))
        for i, camera in enumerate(cameras):
            check_cancelled()
            Q = start + m + E @ e[i]
            p, J, C = camera.jacobians(Q)
            r = (seen.pixels[i] - p) / camera.s
            J, C = J / camera.s, C / camera.s
            facing = (camera.toward(Q) * normal).sum(1)
            size = np.sqrt((r**2).sum(1))
            w = seen.weight[i] * np.clip((facing - 0.1) / 0.3, 0, 1) / sigma**2
            w = w / (1 + (size / (options.robust * sigma)) ** 2)
            residual[i], weight[i] = size, w
            own = np.concatenate([C, J @ E], 2)
            A = np.einsum("lxa,l,lxb->ab", own, w, own)
            A += np.diag(_camera_prior(options, k))
            drift = np.log(camera.kappa * options.distance_mm) if camera.kappa else 0.0
            b = np.einsum("lxa,l,lx->a", own, w, r)
            b[6] -= drift / options.distance_spread**2
            b[PARAMETERS:] -= e[i]
            B = np.einsum("lxa,l,lxb->lba", own, w, J).reshape(3 * f, -1)
            D = np.einsum("lxa,l,lxb->lab", J, w, J)
            for x in range(3):
                for y in range(3):
                    H[np.arange(f) * 3 + x, np.arange(f) * 3 + y] += D[:, x, y]
            g += np.einsum("lxa,l,lx->la", J, w, r).ravel()
            factor = cho_factor(A)
            H -= B @ cho_solve(factor, B.T)
            g -= B @ cho_solve(factor, b)
            blocks.append((factor, B, b))
        dm = cho_solve(cho_factor(H + 1e-9 * np.eye(len(H))), g)
        m = m + dm.reshape(f, 3)
        for i, (factor, B, b) in enumerate(blocks):
            step = cho_solve(factor, b - B.T @ dm)
            # Landmarks that form no face send a camera far away, where nothing brings
            # it back; a step of a usual camera is a tenth of that.
            step /= max(1.0, np.abs(step[_TURN_SIZE_DISTANCE]).max() / FARTHEST)
            cameras[i] = cameras[i].moved(step[:PARAMETERS])
            e[i] += step[PARAMETERS:]
        rms = np.sqrt((weight * residual**2).sum() / max(weight.sum(), 1e-30))
        history.append(float(rms))
        if np.abs(dm).max() < options.tolerance * template.eye_distance:
            break
    modes, smooth = prior.split(uv, (precision @ m.ravel()).reshape(f, 3))
    d = np.einsum("k,kbx->bx", modes, prior.modes) + smooth
    surface = BSplineSurface(
        template.surface.control_points + d.reshape(*template.surface.shape, 3)
    )
    return Bundle(
        surface,
        tuple(cameras),
        start + m,
        modes,
        smooth,
        options.expression * e,
        prior.expression_scale,
        residual,
        weight,
        tuple(history),
    )


def _inverse(covariance: Array) -> Array:
    """Inverse of a small dense covariance, by its Cholesky factor."""
    return cho_solve(cho_factor(covariance), np.eye(len(covariance)))


def _expression_basis(template: Template, uv: Array, scale: float) -> Array:
    """Displacement of each landmark by each expression mode, (f, 3, k)."""
    count = len(template.expression_modes) if scale > 0 else 0
    T = basis_matrix(template.surface.shape, *uv.T)
    moved = [scale * (T @ d.reshape(-1, 3)) for d in template.expression_modes[:count]]
    return np.stack(moved, -1) if count else np.zeros((len(uv), 3, 0))


def _camera_prior(options: MotionOptions, modes: int) -> Array:
    """Prior precision of the parameters of one photo."""
    p = np.zeros(PARAMETERS + modes)
    p[:PARAMETERS] = 1e-9
    p[6] = 1 / options.distance_spread**2
    p[PARAMETERS:] = 1.0
    return p
