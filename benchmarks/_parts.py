"""The default pipeline with some of its parts replaced, for measurements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from bsface.camera.camera import PARAMETERS, Camera
from bsface.camera.prior import CameraPrior
from bsface.images.photo import Photo
from bsface.photometry.lighting import (
    photo_noise,
    robust_weights,
    shading_of,
    solve_albedo,
    solve_lights,
)
from bsface.photometry.sampling import IntensityField, smooth_photo
from bsface.problem import Problem
from bsface.progress import never_cancelled
from bsface.solve.expression import move_to_neutral, select_neutral
from bsface.solve.joint.linearise import Readings, Shading
from bsface.solve.joint.method import joint
from bsface.solve.joint.refine import JointParts
from bsface.solve.joint.samples import Samples
from bsface.solve.joint.state import State
from bsface.solve.joint.terms import CameraTerm
from bsface.solve.motion import MotionOptions, estimate_motion, motion
from bsface.surface.bspline import BSplineSurface
from bsface.threads import one_blas_thread
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Precision that holds a parameter of a photo where it is.
HELD = 1e12
#: Alternations of light and albedo, at first and later.
FIRST_ROUNDS, ROUNDS = 6, 2


@dataclass(frozen=True)
class HeldCameras(CameraPrior):
    """A prior that lets no camera move."""

    def precision(self) -> Array:
        """Prior precision of the parameters, ``(7, 7)``."""
        return super().precision() + HELD * np.eye(PARAMETERS)


@one_blas_thread()
def estimated_surface(
    problem: Problem,
    parts: JointParts,
    cameras: Sequence[Camera] | None = None,
) -> BSplineSurface:
    """The face by the default way, in the template's frame.

    Parameters
    ----------
    problem : Problem
    parts : JointParts
        Of the joint step.
    cameras : sequence of n Camera, optional
        Held by motion and by the joint step.
    """
    if cameras is None:
        *_, last = motion(problem)
    else:
        usual = MotionOptions.of(problem)
        options = replace(usual, camera=HeldCameras(usual.camera.distance_mm))
        *_, last = estimate_motion(
            problem.template, problem.prior, problem.landmarks, cameras, options
        )
        held = CameraTerm(HeldCameras(spread=np.inf), problem.landmarks.focal_px)
        parts = replace(parts, terms=[*parts.terms, held])
    estimate = select_neutral(problem, last.estimate)
    *_, last = joint(problem, estimate, never_cancelled, parts)
    return move_to_neutral(problem, last.estimate).surface


@dataclass(frozen=True)
class Channel:
    """Reads one colour channel in place of the luminance.

    Attributes
    ----------
    index : int
        0 = red, 1 = green, 2 = blue.
    """

    index: int

    def __call__(self, photo: Photo, camera: Camera, blur_mm: float) -> IntensityField:
        """See `PictureReader`."""
        field = smooth_photo(photo, camera, blur_mm, colour=True)
        return replace(field, maps=field.maps[..., [self.index]])


def nothing_hidden(
    surface: BSplineSurface | Sequence[BSplineSurface],
    cameras: Sequence[Camera],
    uv: Array,
    grazing: float,
) -> Array:
    """As `view_weights`, but no part of the face hides another."""
    out = np.empty((len(cameras), len(uv)))
    for i, camera in enumerate(cameras):
        face = surface if isinstance(surface, BSplineSurface) else surface[i]
        toward = camera.toward(face.evaluate(*uv.T))
        cosine = (toward * face.normals(*uv.T)).sum(1)
        out[i] = np.where(cosine > grazing, cosine, 0.0)
    return out


@dataclass(frozen=True)
class EqualWeights:
    """Light and albedo with no sample weighing less for its residual.

    All weigh as much as they do on average with robust weights; without that, the
    change would also make the photos count for more.
    """

    noise: float
    ridge: float

    def __call__(self, seen: Readings, samples: Samples, state: State, /) -> Shading:
        """See `ShadingSolver`."""
        values, view = seen.values, seen.view * samples.area
        lights, albedo, rounds = state.lights, state.albedo, ROUNDS
        if not lights.any():
            total = np.maximum(view.sum(0), 1e-9)
            albedo = np.clip((view * values).sum(0) / total, 0.05, 5.0)
            rounds = FIRST_ROUNDS
        Y = seen.harmonics
        for _ in range(rounds):
            lights = solve_lights(values, view, Y, albedo, self.ridge)
            s = shading_of(lights, Y)
            albedo = solve_albedo(values, view, s)
        residual = values - albedo * s
        noise = photo_noise(view, residual, self.noise)
        robust = robust_weights(view, residual, noise)
        share = float(robust.sum() / max(view.sum(), 1e-12))
        return Shading(lights, albedo, share * view, residual, noise)
