"""A known face found again: pose and expression of new photos, identity fixed.

The paper names this as its future work.  The unknowns of a photo are its camera and a
mixture of the template's expression modes, a low-rank offset of the control points;
the face itself stays as it was reconstructed.  Landmarks sit on every face a little
elsewhere; where they sit on this one is learnt from the photos that it was made of.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..camera.camera import PARAMETERS, Camera
from ..camera.linear_pose import linear_pose
from ..errors import PhotoFailure
from ..surface.bspline import BSplineSurface, basis_matrix
from ..surface.template import Template
from .alignment import relative_size
from .motion import LandmarkObservations, MotionOptions

Array = NDArray[np.float64]

ROUNDS = 40
SETTLED = 1e-5  # of all parameters in their own units


@dataclass(frozen=True)
class KnownFace:
    """A face that can be looked for.

    Attributes
    ----------
    surface : BSplineSurface
    index : (f,) int array
        Which of the template's 468 landmarks are used.
    marks : (f, 3) array
        Where they sit on this face, mm.
    normals : (f, 3) array
        Normals of the surface there.
    moves : (f, 3, k) array
        Their displacement by one standard deviation of each expression mode.
    modes : (k, M, N, 3) array
        The modes themselves, in the size of this face.
    sigma : (f,) array
        Standard deviation of the detections, mm.
    """

    surface: BSplineSurface
    index: NDArray[np.int64]
    marks: Array
    normals: Array
    expression_offsets: Array
    modes: Array
    sigma: Array

    def with_expression(self, expression: Array) -> BSplineSurface:
        """The surface under a mixture of expression modes."""
        moved = np.einsum("k,kuvx->uvx", expression, self.modes)
        return BSplineSurface(self.surface.control_points + moved)


@dataclass(frozen=True)
class Pose:
    """What one photo says of a known face.

    Attributes
    ----------
    camera : Camera
    expression : (k,) array
        Coefficients of the expression modes, relative to the face as it was
        reconstructed; standard deviations.
    residual_mm : float
        Median distance between landmarks and their projection, mm at the head.
    rounds : int
        Gauss-Newton steps.
    """

    camera: Camera
    expression: Array
    residual_mm: float
    rounds: int


def personalise_landmarks(
    surface: BSplineSurface,
    template: Template,
    cameras: Sequence[Camera] = (),
    seen: LandmarkObservations | None = None,
    options: MotionOptions = MotionOptions(),  # noqa: B008 (frozen)
    expressions: Array | None = None,
) -> KnownFace:
    """Make a face ready to be found again.

    Parameters
    ----------
    surface : BSplineSurface
    template : Template
        With the surface's number of control points.
    cameras, seen : sequence of n Camera, Observations, optional
        Of the photos that the face was made of: they tell where the landmarks sit on
        this face. Without them they sit as on the template.
    options : BundleOptions
        Standard deviations.
    expressions : (n, k) array, optional
        Mixture of the expression modes in each of those photos.
    """
    reliable = template.landmark_reliable
    index = np.flatnonzero(reliable) if seen is None else seen.index
    uv = template.landmark_uv[index]
    T = basis_matrix(surface.shape, *uv.T)
    size = relative_size(surface, template)
    sigma = size * np.hypot(template.landmark_sigma[index], options.noise_mm)
    raised = template.landmark_xyz[index] - template.surface.evaluate(*uv.T)
    marks = T @ surface.vector + size * raised
    normals = surface.normals(*uv.T)
    modes = options.expression * size * template.expression_modes
    expression_offsets = [T @ mode.reshape(-1, 3) for mode in modes]
    if seen is not None and len(cameras):
        offset = size * options.offset_mm
        away = np.zeros((len(cameras), *marks.shape))
        if expressions is not None and np.any(expressions):
            away = np.einsum("ik,klx->ilx", expressions, size * _at(T, template))
        marks = _personal(
            marks, away, normals, cameras, seen, sigma, offset, options.robust
        )
    return KnownFace(
        surface,
        index,
        marks,
        normals,
        np.stack(expression_offsets, -1)
        if len(expression_offsets)
        else np.zeros((len(index), 3, 0)),
        modes,
        sigma,
    )


def estimate_pose_expression(
    known: KnownFace,
    pixels: Array,
    weight: Array,
    principal: Sequence[float],
    options: MotionOptions = MotionOptions(),  # noqa: B008 (frozen)
    name: str = "photo",
) -> Pose | PhotoFailure:
    """Camera and expression of one photo of a known face.

    Robust Gauss-Newton on the landmarks, from the linear pose of section 2.3.1.

    Parameters
    ----------
    known : KnownFace
    pixels, weight : (f, 2), (f,) arrays
        Landmarks of the photo in the order of ``known.index``.
    principal : (2,)
        Principal point, pixels.
    options : BundleOptions
    name : str
        The photo, for the sentence of a failure.
    """
    start = linear_pose(pixels, known.marks, weight, principal, name)
    if not isinstance(start, Camera):
        return start
    perspective = np.isfinite(options.distance_mm)
    kappa = 1 / options.distance_mm if perspective else 0.0
    camera = Camera(start.R, start.s, start.t, kappa, start.principal)
    k = known.expression_offsets.shape[2]
    e = np.zeros(k)
    hold = np.full(PARAMETERS + k, 1e-9)
    hold[6] = 1 / options.distance_spread**2
    hold[PARAMETERS:] = 1.0
    residual, rounds = np.zeros(len(pixels)), 0
    while rounds < ROUNDS:
        rounds += 1
        Q = known.marks + known.expression_offsets @ e
        A, b, residual = normal_equations(
            known, camera, Q, pixels, weight, options.robust
        )
        A[np.diag_indices_from(A)] += hold
        if camera.kappa:
            drift = np.log(camera.kappa * options.distance_mm)
            b[6] -= drift / options.distance_spread**2
        b[PARAMETERS:] -= e
        step = np.linalg.solve(A, b)
        camera, e = camera.moved(step[:PARAMETERS]), e + step[PARAMETERS:]
        if np.abs(step).max() < SETTLED:
            break
    away = residual[weight > 0]
    return Pose(camera, e, float(np.median(away)) if len(away) else 0.0, rounds)


def normal_equations(
    known: KnownFace,
    camera: Camera,
    Q: Array,
    pixels: Array,
    weight: Array,
    robust: float,
) -> tuple[Array, Array, Array]:
    """Gauss-Newton block of camera and expression from the landmarks at ``Q``.

    Returns
    -------
    A, b : (7 + k, 7 + k), (7 + k,) arrays
    residual : (f,) array
        Distances, mm at the head.
    """
    p, J, C = camera.jacobians(Q)
    r, J, C = (pixels - p) / camera.s, J / camera.s, C / camera.s
    size = np.sqrt((r**2).sum(1))
    w = weight * _facing(camera, Q, known.normals) / known.sigma**2
    w = w / (1 + (size / (robust * known.sigma)) ** 2)
    own = np.concatenate([C, J @ known.expression_offsets], 2)
    A = np.einsum("lxa,l,lxb->ab", own, w, own)
    return A, np.einsum("lxa,l,lx->a", own, w, r), size


def _at(T, template: Template) -> Array:
    """The expression modes at points of the template, (k, f, 3)."""
    return np.stack([T @ mode.reshape(-1, 3) for mode in template.expression_modes])


def _personal(marks, away, normals, cameras, seen, sigma, offset_mm, robust) -> Array:
    """Landmarks where the photos saw them, held near where the template has them.

    ``away`` (n, f, 3) is how far the expression of each photo moves them.
    """
    start, marks = marks, marks.copy()
    for _ in range(5):
        A = np.tile(np.eye(3) / offset_mm**2, (len(marks), 1, 1))
        b = (start - marks) / offset_mm**2
        for i, camera in enumerate(cameras):
            p, J, _ = camera.jacobians(marks + away[i])
            r, J = (seen.pixels[i] - p) / camera.s, J / camera.s
            w = seen.weight[i] * _facing(camera, marks, normals) / sigma**2
            w = w / (1 + (r**2).sum(1) / (robust * sigma) ** 2)
            A += np.einsum("lxa,l,lxb->lab", J, w, J)
            b += np.einsum("lxa,l,lx->la", J, w, r)
        marks = marks + np.linalg.solve(A, b[..., None])[..., 0]
    return marks


def _facing(camera: Camera, Q: Array, normals: Array) -> Array:
    """Weight of landmarks by how far they are turned to the camera."""
    return np.clip(((camera.toward(Q) * normals).sum(1) - 0.1) / 0.3, 0, 1)
