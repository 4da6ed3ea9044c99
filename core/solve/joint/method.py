"""The default method: from the motion estimate to the face by the joint refinement."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..._types import Array
from ...photometry import harmonics
from ...photometry.lighting import PhotometricEvidence, light_diversity
from ...photometry.skin import skin_masks
from ...problem import FaceEstimate, Iteration, Problem
from ...progress import CheckCancelled, never_cancelled
from .options import JointOptions
from .refine import JointIteration, JointParts, Refinement, refine
from .state import DisplacementModel, State
from .terms import default_terms

# What the normal matrix cannot know: light and skin are not quite as modelled.
# Added in quadrature it brings the stated deviation near the truth on the sets with
# ground truth (reliability tables of the accuracy page).  It is other in each photo, so
# the mean over the photos has less of it, as far as that was measured.
MODEL_ERROR_MM = 1.0
MEASURED_PHOTOS = 40
# The same where expressions differ, for photos of the usual noise: what the expression
# modes do not span is in the residuals too, and counts with this power of them.
MIXED_MODEL_ERROR_MM, MIXED_POWER = 0.34, 1.5


def joint(
    problem: Problem,
    estimate: FaceEstimate,
    check_cancelled: CheckCancelled = never_cancelled,
    parts: JointParts = JointParts(),  # noqa: B008 (frozen)
    options: JointOptions | None = None,
) -> Iterator[Iteration]:
    """Refine an estimate by shading and motion together.

    Parameters
    ----------
    problem : Problem
    estimate : FaceEstimate
        Of the motion stage; its expressions and photo weights are relative to the
        surface of the result.
    check_cancelled : callable
        Called between the parts of a step; may raise `Cancelled`.
    parts : JointParts
        What is not as usual.
    options : JointOptions, optional
        By default those of the problem's settings.

    Yields
    ------
    Iteration
        One per Gauss-Newton step; the last estimate carries the photometric evidence
        and the deviation of the control points.
    """
    options = options or JointOptions.of(problem)
    work, start = begin(problem, estimate, options, parts, check_cancelled)
    steps = [level.iterations for level in options.levels]
    for one in refine(start, work, check_cancelled):
        state = one.state
        done = sum(steps[: one.level]) + one.turn
        found = estimate_at(state, problem, estimate)
        if done == sum(steps):
            found = replace(
                found,
                photometric=photometric_evidence(one),
                deviation=np.hypot(
                    one.system.deviation(check_cancelled),
                    model_error(
                        one.shading.noise,
                        options.noise,
                        photos=len(state.cameras),
                        mixed=start.model.mixed,
                    ),
                ).reshape(start.model.reference.shape),
                skin=work.skin,
            )
        yield Iteration("refine", found, one.residual, one.step_mm, done, sum(steps))
        del one  # before the next one is made


def begin(
    problem: Problem,
    estimate: FaceEstimate,
    options: JointOptions,
    parts: JointParts,
    check_cancelled: CheckCancelled,
) -> tuple[Refinement, State]:
    """What refines an estimate, and the state at which it starts.

    Each photo gets a skin mask, unless the parts bring them.
    """
    model = DisplacementModel.about(problem, estimate)
    terms = [*default_terms(problem, estimate, model, options), *parts.terms]
    start = State.start(model, estimate.cameras)
    if parts.skin is None:
        skin = skin_masks(
            problem.photos,
            start.faces,
            estimate.cameras,
            problem.template,
            check_cancelled,
        )
        parts = replace(parts, skin=skin)
    photos, weights = problem.photos, estimate.photo_weights
    return Refinement(photos, weights, options, terms, parts), start


def estimate_at(state: State, problem: Problem, start: FaceEstimate) -> FaceEstimate:
    """The estimate ``start`` moved to a state of the refinement."""
    uv, model = problem.landmarks.uv, state.model
    offset = start.landmarks_xyz - start.surface.evaluate(*uv.T)
    return replace(
        start,
        surface=state.surface,
        cameras=state.cameras,
        expressions=state.expressions if model.mixed else start.expressions,
        landmarks_xyz=state.surface.evaluate(*uv.T) + offset,
        modes=model.modes + state.modes,
        smooth=start.smooth + state.smooth[:, None] * model.directions,
    )


def model_error(
    noise: float | Array, usual: float, *, photos: int, mixed: bool
) -> float:
    """Standard deviation of what the normal matrix cannot know, mm.

    Parameters
    ----------
    noise : float or (n, 1) array
        Of the photos, as measured.
    usual : float
        Of a photo of usual quality.
    photos : int
        Their number.
    mixed : bool
        Whether they differ in expression.
    """
    error = MODEL_ERROR_MM / np.sqrt(min(photos, MEASURED_PHOTOS))
    if not mixed:
        return error
    relative = float(np.median(noise)) / usual
    return max(error, MIXED_MODEL_ERROR_MM * relative**MIXED_POWER)


def photometric_evidence(last: JointIteration) -> PhotometricEvidence:
    """The photometric side of an iteration, lights as nine harmonics."""
    uv, albedo = last.rows.samples.uv, last.shading.albedo
    weights, values = last.shading.weights, last.readings.values
    normals = last.state.surface.normals(*uv.T)
    Y = albedo[:, None] * harmonics.basis(normals)
    lights = np.stack(
        [
            np.linalg.lstsq(np.sqrt(w)[:, None] * Y, np.sqrt(w) * v, rcond=None)[0]
            for w, v in zip(weights, values, strict=True)
        ]
    )
    return PhotometricEvidence(
        uv,
        normals,
        np.repeat(albedo[:, None], 3, 1),
        lights,
        weights,
        last.shading.residual,
        light_diversity(values, weights),
    )
