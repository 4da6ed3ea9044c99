"""Photos of one person in, a face out: the only module that knows the whole way."""

from __future__ import annotations

import contextlib
import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .camera.camera import Camera
from .camera.coverage import shortcomings
from .camera.linear_pose import linear_pose
from .clock import Clock
from .errors import ReconstructionError, out_of_memory
from .landmarks.landmarks import Landmarks
from .landmarks.observations import observe_landmarks
from .photo_reports import photo_reports
from .photometry import harmonics
from .photometry.lighting import PhotometricEvidence
from .prepare import PhotoCollection, collect_photos
from .problem import Constraint as ProblemConstraint
from .problem import FaceEstimate, Problem
from .progress import Progress
from .result import Reconstruction
from .settings import Settings
from .solve.alignment import head_frame
from .solve.constraint import Constraint, edited_template, hold
from .solve.expression import select_neutral
from .solve.joint.method import joint
from .solve.known_face import personalise_landmarks
from .solve.motion import Bundle, LandmarkObservations, MotionOptions, estimate_motion
from .solve.paper.on_photos import run_imls
from .surface.bspline import BSplineSurface
from .surface.prior import shape_prior
from .surface.template import Template, load_template
from .threads import one_blas_thread

Array = NDArray[np.float64]
logger = logging.getLogger(__name__)

FEWEST_FOR_SHADING = 3


def reconstruct(
    photos: str | os.PathLike | Sequence,
    settings: Settings | None = None,
    *,
    template: Template | BSplineSurface | str | os.PathLike | None = None,
    progress: Progress | None = None,
    ignore: Sequence[str] = (),
    landmarks: Mapping[str, Landmarks] | None = None,
    held: Constraint | None = None,
) -> Reconstruction:
    """Reconstruct a face from photos of one person.

    Parameters
    ----------
    photos : folder, or sequence of paths or of (H, W, 3) RGB arrays
    settings : Settings, optional
    template : Template, path of a template file, or BSplineSurface, optional
        Another ``b_t``; a bare surface (an edited result) keeps the landmarks and modes
        of the bundled template.
    progress : callable, optional
        Receives a `Step` after each piece of work; may raise `Cancelled`.
    ignore : sequence of str
        Names of photos that are not to be used.
    landmarks : mapping of photo name to Landmarks, optional
        Win over files and over the detector.
    held : Held, optional
        Control points of the template that stay; not for the classic methods.

    Returns
    -------
    Reconstruction

    Raises
    ------
    ReconstructionError
        The job failed; one sentence says why and what to do.
    Cancelled
        Raised by ``progress``, passed on.
    """
    settings = settings or Settings()
    clock = Clock(progress)
    with one_blas_thread(), _memory_told():
        model = _template(template, settings)
        settings = replace(settings, control_points=model.surface.shape)
        collection = collect_photos(
            photos,
            settings,
            clock.nested("landmarks"),
            template=model,
            landmarks=landmarks,
            ignore=ignore,
        )
        clock.lap("landmarks")
        return solve(collection, settings, model, clock, held)


@contextlib.contextmanager
def _memory_told() -> Iterator[None]:
    """Want of memory, of whichever library, as a sentence."""
    try:
        yield
    except Exception as error:
        if not out_of_memory(error):
            raise
        raise ReconstructionError(
            "There is not enough memory; use fewer photos or a smaller net "
            "(control_points 30, 30)."
        ) from None


@one_blas_thread()
def solve(
    collection: PhotoCollection,
    settings: Settings,
    template: Template,
    clock: Clock | None = None,
    held: Constraint | None = None,
) -> Reconstruction:
    """The reconstruction from photos whose landmarks are known."""
    clock = clock or Clock(None)
    if not collection.photos:
        raise ReconstructionError("No photo can be used; see the reasons per photo.")
    clock.tell("motion", 0, 1, "adjusting poses and landmarks")
    prior = shape_prior(
        template,
        settings.modes,
        settings.expression_modes,
        settings.smooth_mm,
        settings.smooth_length,
    )
    clock.check_cancelled()
    seen = observations(collection, template)
    cameras = _linear_cameras(collection, template, seen, settings)
    options = motion_options(settings)
    bundle = estimate_motion(
        template, prior, seen, cameras, options, clock.check_cancelled
    )
    history: list[dict[str, Any]] = [
        {"stage": "motion", "residual": r, "step_mm": 0.0} for r in bundle.history
    ]
    clock.tell("motion", 1, 1, "poses and landmarks adjusted together")
    clock.lap("motion")
    method = settings.method
    progress = _Progress(history, clock)
    evidence: PhotometricEvidence | None = None
    deviation: Array | None = None
    if method in ("imls", "paper"):
        shown, evidence = _classic(
            collection, template, seen, settings, bundle, progress
        )
    elif method == "motion" or len(collection.photos) < FEWEST_FOR_SHADING:
        shown, _ = select_neutral(bundle, template, seen)
        shown = _holding(shown, template, settings, held)
    else:
        shown, evidence, deviation = _joint(
            collection, template, prior, seen, bundle, settings, progress, held
        )
    clock.lap("refine")
    result = Reconstruction(
        surface=shown.surface,
        template=template,
        photos=collection.photos,
        landmarks=collection.landmarks,
        cameras=shown.cameras,
        photometric=evidence,
        reports=(),
        confidence=deviation,
        settings=settings,
        history=tuple(history),
        expressions=shown.expressions,
    )
    result = _in_head_frame(result)
    reports = photo_reports(collection, template, shown, seen, evidence)
    warnings = collection.identity_warnings + shortcomings(
        np.array([c.yaw_pitch_roll for c in result.cameras]),
        None if evidence is None else evidence.singular_values,
    )
    clock.tell("output", 1, 1, "face finished")
    clock.lap("output")
    for sentence in warnings:
        logger.warning(sentence)
    return replace(
        result, reports=reports, warnings=warnings, seconds=dict(clock.seconds)
    )


def observations(
    collection: PhotoCollection, template: Template
) -> LandmarkObservations:
    """Landmarks of all photos on the numbering of the template's reliable ones."""
    index = np.flatnonzero(template.landmark_reliable)
    n, count = len(collection.photos), len(template.landmark_uv)
    pixels, weight = np.zeros((n, count, 2)), np.zeros((n, count))
    for i, marks in enumerate(collection.landmarks):
        which = template.schemes[marks.scheme]
        pixels[i, which], weight[i, which] = marks.points, marks.weight
    used = index[(weight[:, index] > 0).any(0)]
    return LandmarkObservations(pixels[:, used], weight[:, used], used)


def motion_options(settings: Settings) -> MotionOptions:
    """Options of the motion stage."""
    return MotionOptions(
        offset_mm=settings.landmark_offset_mm,
        noise_mm=settings.landmark_noise_mm,
        distance_mm=settings.distance_mm,
        expression=1.0 if settings.expressions else 0.0,
    )


def _holding(bundle: Bundle, template, settings, held: Constraint | None) -> Bundle:
    """The bundle with held control points near where the template has them."""
    if held is None or not held.points.any():
        return bundle
    surface = hold(
        bundle.surface,
        template.surface.control_points,
        held.points,
        held.softness_mm,
        settings.smooth_mm,
        settings.smooth_length,
    )
    moved = surface.vector - bundle.surface.vector
    return replace(bundle, surface=surface, smooth=bundle.smooth + moved)


def _joint(
    collection, template, prior, seen, bundle: Bundle, settings, progress, held=None
):
    bundle, weights = select_neutral(bundle, template, seen)
    bundle = _holding(bundle, template, settings, held)
    problem = Problem(
        collection,  # type: ignore[arg-type]
        template,
        prior,
        observe_landmarks(collection.photos, collection.landmarks, template),
        settings,
        None if held is None else ProblemConstraint(held.points, held.softness_mm),
    )
    estimate = FaceEstimate(
        bundle.surface,
        bundle.cameras,
        bundle.structure,
        bundle.expressions,
        bundle.modes,
        bundle.smooth,
        weights,
    )
    progress.clock.tell("refine", 0, 1, "measuring light and shape together")
    for step in joint(problem, estimate, progress.clock.check_cancelled):
        progress.history.append(
            {"stage": "refine", "residual": step.residual, "step_mm": step.step_mm}
        )
        message = f"largest step {step.step_mm:.2f} mm"
        progress.clock.tell("refine", step.done, step.total, message)
        estimate = step.estimate
    # Where the landmarks sit on this face, seen from where the cameras are now.
    known = personalise_landmarks(
        estimate.surface,
        template,
        estimate.cameras,
        seen,
        motion_options(settings),
        bundle.expressions,
    )
    shown = replace(
        bundle,
        surface=estimate.surface,
        cameras=estimate.cameras,
        structure=known.marks,
    )
    return shown, estimate.photometric, estimate.deviation


def _classic(collection, template, seen, settings, bundle: Bundle, progress):
    def on_state(state) -> None:
        progress.history.append(
            {"stage": state.stage, "step_mm": state.change_mm, **dict(state.figures)}
        )
        done = state.outer - (0 if state.finished else 0.5)
        progress.clock.tell(
            "refine",
            int(2 * done),
            2 * settings.outer_passes,
            f"pass {state.outer}, {state.stage}: moved {state.change_mm:.2f} mm",
        )

    total = 2 * settings.outer_passes
    progress.clock.tell("refine", 0, total, "measuring light")
    surface, cameras, evidence = run_imls(
        collection.photos,
        template,
        seen,
        settings,
        on_state,
        progress.clock.check_cancelled,
    )
    shown = replace(
        bundle,
        surface=surface,
        cameras=cameras,
        structure=surface.evaluate(*template.landmark_uv[seen.index].T),
        expressions=np.zeros_like(bundle.expressions),
    )
    return shown, evidence


def _linear_cameras(collection, template, seen, settings) -> list[Camera]:
    """Start: the paper's linear pose, at the typical distance."""
    cameras = []
    Q = template.landmark_xyz[seen.index]
    kappa = 1 / settings.distance_mm if settings.perspective else 0.0
    for i, photo in enumerate(collection.photos):
        centre = ((photo.size[0] - 1) / 2, (photo.size[1] - 1) / 2)
        pose = linear_pose(seen.pixels[i], Q, seen.weight[i], centre, photo.name)
        if not isinstance(pose, Camera):
            raise ReconstructionError(pose.reason)
        cameras.append(replace(pose, kappa=kappa))
    return cameras


def _template(given, settings: Settings) -> Template:
    if isinstance(given, BSplineSurface):
        return edited_template(given, load_template())
    try:
        base = given if isinstance(given, Template) else load_template(given)
    except ValueError as error:
        raise ReconstructionError(str(error)) from error
    return base.resampled(settings.control_points)


def _in_head_frame(result: Reconstruction) -> Reconstruction:
    """The same result in the frame and size that results have."""
    move = head_frame(result.surface, result.template, result.settings.eye_distance_mm)
    evidence = result.photometric
    if evidence is not None:
        turn = harmonics.rotation(move.R, evidence.lights.shape[1])
        evidence = replace(
            evidence,
            normals=evidence.normals @ move.R.T,
            lights=evidence.lights @ turn,
        )
    spread = result.confidence
    return replace(
        result,
        surface=result.surface.transformed(move.scale, move.R, move.t),
        cameras=tuple(c.rescaled(move.scale, move.R, move.t) for c in result.cameras),
        photometric=evidence,
        confidence=None if spread is None else move.scale * spread,
    )


class _Progress(NamedTuple):
    """Where the stages write what they did."""

    history: list[dict[str, Any]]
    clock: Clock
