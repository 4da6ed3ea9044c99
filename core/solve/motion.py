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

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from .._types import Array, Indices
from ..camera.camera import PARAMETERS, Camera
from ..camera.linear_pose import linear_pose
from ..camera.prior import CameraPrior
from ..errors import ReconstructionError
from ..landmarks.observations import LandmarkObservations
from ..problem import FaceEstimate, Iteration, Problem
from ..progress import CheckCancelled, never_cancelled
from ..settings import Settings
from ..surface.bspline import BSplineSurface
from ..surface.prior import ShapePrior
from ..surface.template import Template
from .landmark_system import LandmarkModel


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
    def from_settings(
        cls, settings: Settings, distance_mm: float | None = None
    ) -> MotionOptions:
        """The options that the settings mean.

        ``distance_mm`` is that of the settings, unless the face has another size than
        the result.
        """
        distance = settings.distance_mm if distance_mm is None else distance_mm
        distance = distance if settings.perspective else np.inf
        return cls(
            offset_mm=settings.landmark_offset_mm,
            noise_mm=settings.landmark_noise_mm,
            camera=CameraPrior(distance),
            expression=1.0 if settings.expressions else 0.0,
        )

    @classmethod
    def of(cls, problem: Problem) -> MotionOptions:
        """The options that a problem means, at the size of its template."""
        return cls.from_settings(problem.settings, problem.distance_mm)

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
    options = MotionOptions.of(problem)
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
    """The linear pose of each photo (section 2.3.1), at the distance of the prior.

    That is the distance by the focal length where it is known, else the typical one.
    """
    Q = template.landmark_xyz[landmarks.index]
    cameras = []
    for i, name in enumerate(landmarks.names):
        x, y = landmarks.principal[i]
        pose = linear_pose(
            landmarks.pixels[i], Q, landmarks.weight[i], (float(x), float(y)), name
        )
        if not isinstance(pose, Camera):
            raise ReconstructionError(pose.reason)
        cameras.append(
            replace(pose, kappa=prior.of_photo(landmarks.focal_px[i]).kappa(pose.s))
        )
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
    n = len(cameras)
    model = LandmarkModel.of(template, prior, landmarks, options)
    f = len(model.start)
    precision = model.precision
    cameras = list(cameras)
    m, e = np.zeros((f, 3)), np.zeros((n, model.E.shape[2]))
    for iteration in range(options.iterations):
        H, g, blocks, residual = model.linearise(cameras, m, e, check_cancelled)
        dm = cho_solve(cho_factor(H), g)
        m = m + dm.reshape(f, 3)
        for i, block in enumerate(blocks):
            step = block.back_substitute(dm)
            cameras[i] = cameras[i].moved(step[:PARAMETERS])
            e[i] += step[PARAMETERS:]
        modes, smooth = prior.split(landmarks.uv, (precision @ m.ravel()).reshape(f, 3))
        d = np.einsum("k,kbx->bx", modes, prior.modes) + smooth
        estimate = FaceEstimate(
            surface=BSplineSurface(
                template.surface.control_points + d.reshape(*template.surface.shape, 3)
            ),
            cameras=tuple(cameras),
            landmarks_xyz=model.start + m,
            expressions=options.expression * e,
            modes=modes,
            smooth=smooth,
            photo_weights=np.ones(n),
        )
        largest = float(np.abs(dm).max())
        yield Iteration(
            stage="motion",
            estimate=estimate,
            residual=residual,
            step_mm=largest,
            done=iteration + 1,
            total=options.iterations,
        )
        if largest < options.tolerance * template.eye_distance:
            return
