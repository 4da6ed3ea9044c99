"""Motion: cameras and face from landmarks together, the default form of section 2.3.

The paper alternates pose estimation and the warp of Eq. 8.  Here poses, perspective and
the 3D positions of the landmarks are one Gauss-Newton problem under the shape prior,
and the surface follows the landmarks by conditioning that prior on them (Eq. 8 with
``K`` replaced by the prior's precision).  Each landmark has an offset of its own,
common to all photos, because a detector places it a little elsewhere on every face.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from .._types import Array, Indices
from ..camera.camera import DISTANCE, PARAMETERS, Camera
from ..camera.linear_pose import linear_pose
from ..camera.prior import CameraPrior
from ..errors import ReconstructionError
from ..gram import gram
from ..landmarks.observations import LandmarkObservations
from ..problem import FaceEstimate, Iteration, Problem
from ..progress import CheckCancelled, never_cancelled
from ..settings import Settings
from ..surface.bspline import BSplineSurface, basis_matrix
from ..surface.prior import ShapePrior
from ..surface.template import Template
from .expression import expression_offsets
from .landmark_term import LandmarkRows, facing_weight, landmark_rows

# Photos that are eliminated at a time.
_BATCH = 16
# Largest step of a camera: radians, relative change of scale and of distance.
_LARGEST_STEP = 1.0
_ROTATION_SCALE_DISTANCE = [0, 1, 2, 3, DISTANCE]


@dataclass(frozen=True)
class MotionOptions:
    """Standard deviations of the motion estimate."""

    offset_mm: float = 1.2  #: landmark offset between faces
    noise_mm: float = 0.7  #: detector noise besides the template's own sigma
    camera: CameraPrior = field(default_factory=CameraPrior)
    expression: float = 1.0  #: scale of the expression modes, 0 = rigid face
    iterations: int = 15
    tolerance: float = 1e-4  #: step at which it ends, in eye distances

    @classmethod
    def from_settings(cls, settings: Settings) -> MotionOptions:
        """The options that the settings mean."""
        distance = settings.distance_mm if settings.perspective else np.inf
        return cls(
            offset_mm=settings.landmark_offset_mm,
            noise_mm=settings.landmark_noise_mm,
            camera=CameraPrior(distance),
            expression=1.0 if settings.expressions else 0.0,
        )

    def sigma(self, template: Template, index: Indices) -> Array:
        """Standard deviation of the landmarks in one photo, mm, ``(f,)``."""
        return np.hypot(template.landmark_sigma[index], self.noise_mm)


def motion(
    problem: Problem, check_cancelled: CheckCancelled = never_cancelled
) -> Iterator[Iteration]:
    """Estimate motion, from the paper's linear poses.

    Yields
    ------
    Iteration
        One per Gauss-Newton step.

    Raises
    ------
    ReconstructionError
        When the landmarks of a photo leave its pose open.
    """
    options = MotionOptions.from_settings(problem.settings)
    cameras = initial_cameras(problem.template, problem.landmarks, options.camera)
    yield from estimate_motion(
        problem.template,
        problem.prior,
        problem.landmarks,
        cameras,
        options,
        check_cancelled,
    )


def initial_cameras(
    template: Template, landmarks: LandmarkObservations, prior: CameraPrior
) -> list[Camera]:
    """The linear pose of each photo (section 2.3.1), at the typical distance."""
    Q = template.landmark_xyz[landmarks.index]
    cameras = []
    for i, name in enumerate(landmarks.names):
        x, y = landmarks.principal[i]
        pose = linear_pose(
            landmarks.pixels[i], Q, landmarks.weight[i], (float(x), float(y)), name
        )
        if not isinstance(pose, Camera):
            raise ReconstructionError(pose.reason)
        cameras.append(replace(pose, kappa=1 / prior.distance_mm))
    return cameras


def estimate_motion(
    template: Template,
    prior: ShapePrior,
    landmarks: LandmarkObservations,
    cameras: Sequence[Camera],
    options: MotionOptions,
    check_cancelled: CheckCancelled = never_cancelled,
) -> Iterator[Iteration]:
    """Iterate cameras, landmark positions, expressions and the surface with them.

    Parameters
    ----------
    template : Template
    prior : ShapePrior
    landmarks : LandmarkObservations
        Of n photos.
    cameras : sequence of n Camera
        Start.
    options : MotionOptions
    check_cancelled : callable
        Called once per photo in every iteration.
    """
    f, n = len(landmarks.index), len(cameras)
    uv = landmarks.uv
    start = template.landmark_xyz[landmarks.index]
    normals = template.surface.normals(*uv.T)
    covariance = prior.displacement_covariance(
        uv, basis_matrix(template.surface.shape, *uv.T)
    )
    precision = _inverse(covariance + options.offset_mm**2 * np.eye(3 * f))
    count = len(template.expression_modes) if options.expression > 0 else 0
    E = options.expression * expression_offsets(template, uv, count)
    sigma = options.sigma(template, landmarks.index)
    hold = np.concatenate([options.camera.precision(), np.ones(count)])

    cameras = list(cameras)
    m, e = np.zeros((f, 3)), np.zeros((n, count))
    for iteration in range(options.iterations):
        H, g = precision.copy(), -(precision @ m.ravel())
        blocks, halves = [], []
        squares = weights = 0.0
        for i, camera in enumerate(cameras):
            check_cancelled()
            Q = start + m + E @ e[i]
            weight = landmarks.weight[i] * facing_weight(camera, Q, normals)
            rows = landmark_rows(camera, Q, landmarks.pixels[i], weight, sigma)
            pull = np.concatenate([options.camera.pull(camera), -e[i]])
            block = _photo_block(rows, E, hold, pull)
            halves.append(block.eliminate_from(H, g, rows))
            blocks.append(block)
            if len(halves) == _BATCH or i + 1 == n:
                H -= gram(np.concatenate(halves))
                halves.clear()
            squares += float((rows.weight * rows.distance**2).sum())
            weights += float(rows.weight.sum())
        dm = cho_solve(cho_factor(H + 1e-9 * np.eye(len(H))), g)
        m = m + dm.reshape(f, 3)
        for i, block in enumerate(blocks):
            step = block.back_substitute(dm)
            cameras[i] = cameras[i].moved(step[:PARAMETERS])
            e[i] += step[PARAMETERS:]
        modes, smooth = prior.split(uv, (precision @ m.ravel()).reshape(f, 3))
        d = np.einsum("k,kbx->bx", modes, prior.modes) + smooth
        estimate = FaceEstimate(
            surface=BSplineSurface(
                template.surface.control_points + d.reshape(*template.surface.shape, 3)
            ),
            cameras=tuple(cameras),
            landmarks_xyz=start + m,
            expressions=options.expression * e,
            modes=modes,
            smooth=smooth,
            photo_weights=np.ones(n),
        )
        largest = float(np.abs(dm).max())
        yield Iteration(
            stage="motion",
            estimate=estimate,
            residual=float(np.sqrt(squares / max(weights, 1e-30))),
            step_mm=largest,
            done=iteration + 1,
            total=options.iterations,
        )
        if largest < options.tolerance * template.eye_distance:
            return


class _PhotoBlock(NamedTuple):
    """Normal equations of one photo's camera and expression (q = 7 + k unknowns)."""

    factor: Array  # lower Cholesky factor of the photo's own block, (q, q)
    B: Array  # (3f, q) coupling with the landmarks
    b: Array  # (q,) right side

    def eliminate_from(self, H: Array, g: Array, rows: LandmarkRows) -> Array:
        """Add the photo to the landmarks' system (3f unknowns), itself eliminated.

        Returns the (q, 3f) array whose gram is still to be taken from ``H``: those of
        many photos in one product are faster.
        """
        J, w = rows.by_point, rows.weight
        D = np.einsum("lxa,l,lxb->lab", J, w, J)
        at = 3 * np.arange(len(w))
        for x in range(3):
            for y in range(3):
                H[at + x, at + y] += D[:, x, y]
        g += np.einsum("lxa,l,lx->la", J, w, rows.residual).ravel()
        g -= self.B @ cho_solve((self.factor, True), self.b)
        return solve_triangular(self.factor, self.B.T, lower=True)

    def back_substitute(self, dm: Array) -> Array:
        """Step of the photo's unknowns for the landmarks' step, ``(q,)``."""
        step = cho_solve((self.factor, True), self.b - self.B.T @ dm)
        # Landmarks that form no face send a camera far away, where nothing brings it
        # back; a step of a usual camera is a tenth of that.
        largest = np.abs(step[_ROTATION_SCALE_DISTANCE]).max()
        return step / max(1.0, largest / _LARGEST_STEP)


def _photo_block(rows: LandmarkRows, E: Array, hold: Array, pull: Array) -> _PhotoBlock:
    """Block of one photo; ``hold`` and ``pull`` are the prior of its unknowns, (q,)."""
    w, J = rows.weight, rows.by_point
    own = np.concatenate([rows.by_camera, J @ E], 2)
    weighted = w[:, None, None] * own
    q = own.shape[2]
    A = own.reshape(-1, q).T @ weighted.reshape(-1, q) + np.diag(hold)
    b = rows.residual.ravel() @ weighted.reshape(-1, q) + pull
    B = np.matmul(J.transpose(0, 2, 1), weighted).reshape(-1, q)
    return _PhotoBlock(np.linalg.cholesky(A), B, b)


def _inverse(covariance: Array) -> Array:
    """Inverse of a small dense covariance, by its Cholesky factor."""
    return cho_solve(cho_factor(covariance), np.eye(len(covariance)))
