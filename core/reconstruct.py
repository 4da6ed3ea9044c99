"""Photos of one person in, a face out: the whole way on one page.

Photos become a `Problem`; motion and then a method turn it into better and better
estimates of the face; `finish` makes the result of the last one (docs/method.md).
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from ._types import Array, Array32
from .errors import memory_reported
from .finish import finish
from .images.sources import Photos
from .kinds import CALLBACK, expect
from .landmarks.landmarks import Landmarks
from .prepare import Inputs, TemplateLike, prepare
from .problem import Constraint, FaceEstimate, Iteration, Method, Problem
from .progress import CheckCancelled, Clock, Progress
from .result import HistoryEntry, Reconstruction
from .settings import Settings
from .solve.constraint import hold
from .solve.expression import move_to_neutral, select_neutral
from .solve.joint.method import joint
from .solve.landmark_deviation import landmark_deviation
from .solve.motion import motion
from .solve.paper.as_printed import paper
from .solve.paper.imls import imls
from .surface.alignment import head_frame
from .surface.bspline import BSplineSurface
from .threads import one_blas_thread

logger = logging.getLogger(__name__)

FEWEST_FOR_SHADING = 3


def motion_only(
    problem: Problem, estimate: FaceEstimate, check_cancelled: CheckCancelled
) -> Iterator[Iteration]:
    """The face that the landmarks alone give: nothing is added to motion."""
    yield from ()


#: What `Settings.method` names.
METHODS: dict[str, Method] = {
    "joint": joint,
    "imls": imls,
    "paper": paper,
    "motion": motion_only,
}


def reconstruct(
    photos: Photos,
    settings: Settings | Mapping[str, Any] | None = None,
    *,
    template: TemplateLike | None = None,
    progress: Progress | None = None,
    ignore: Sequence[str] = (),
    landmarks: Mapping[str, Landmarks] | None = None,
    masks: Mapping[str, Array32] | None = None,
    constraint: Constraint | None = None,
    recursive: bool = False,
    **changes: Any,
) -> Reconstruction:
    """Reconstruct a face from photos of one person.

    Parameters
    ----------
    photos : folder, video, or sequence of paths or of (H, W, 3) RGB arrays
    settings : Settings or mapping, optional
    template : Template, path of a template file, or BSplineSurface, optional
        Another ``b_t``; a bare surface (an edited result) keeps the landmarks and modes
        of the bundled template.
    progress : callable, optional
        Receives a `Step` after each piece of work; may raise `Cancelled`.
    ignore : sequence of str
        Names of photos that are not to be used.
    landmarks : mapping of photo name to Landmarks, optional
        Win over files and over the detector.
    masks : mapping of photo name to (h, w) float32 array, optional
        What is skin of the face, over the whole upright photo in any size: 1 is, 0 is
        not, 0.5 stays as it is measured. Win over mask files.
    constraint : Constraint, optional
        Control points of the template that stay where it has them.
    recursive : bool
        Read the sub-folders of a folder too.
    **changes
        Single settings, such as ``method="motion"``.

    Returns
    -------
    Reconstruction

    Raises
    ------
    ReconstructionError
        The job failed; one sentence says why and what to do.
    Cancelled
        Raised by ``progress``, passed on.
    TypeError, ValueError
        An argument is of the wrong kind, or a setting is not possible.
    """
    expect(CALLBACK, "a function", progress=progress)
    chosen = Settings.of(settings, changes)
    inputs = Inputs(
        template=template,
        landmarks={} if landmarks is None else landmarks,
        ignore=ignore,
        constraint=constraint,
        recursive=recursive,
        masks={} if masks is None else masks,
    )
    clock = Clock(progress)
    with one_blas_thread(), memory_reported():
        problem = prepare(photos, chosen, inputs, clock.nested("landmarks"))
        clock.lap("landmarks")
        return solve(problem, clock)


@one_blas_thread()
def solve(problem: Problem, clock: Clock | None = None) -> Reconstruction:
    """Motion, the method of the settings, and the result."""
    clock = clock or Clock(None)
    history: list[HistoryEntry] = []

    def face() -> Array:
        return as_result(problem, estimate.surface)

    clock.tell("motion", 0, 1, "estimating poses and landmarks")
    for iteration in motion(problem, clock.check_cancelled):
        history.append(HistoryEntry.of(iteration))
        estimate = iteration.estimate
    clock.tell("motion", 1, 1, "poses and landmarks estimated", face)
    clock.lap("motion")
    name = problem.settings.method
    if name in ("joint", "imls") and len(problem.photos) < FEWEST_FOR_SHADING:
        name = "motion"
    estimate = constrained(problem, select_neutral(problem, estimate))
    clock.tell("refine", 0, 1, "measuring light and shape", face)
    for iteration in METHODS[name](problem, estimate, clock.check_cancelled):
        history.append(HistoryEntry.of(iteration))
        estimate = iteration.estimate
        moved = f"{iteration.stage}: the surface moved {iteration.step_mm:.2f} mm"
        clock.tell("refine", iteration.done, iteration.total, moved, face)
    if problem.constraint is None:
        # The method has measured the expressions again.
        estimate = move_to_neutral(problem, estimate)
    if name == "motion":
        clock.check_cancelled()
        estimate = replace(estimate, deviation=landmark_deviation(problem, estimate))
    clock.lap("refine")
    result = finish(problem, estimate, history)
    clock.tell("output", 1, 1, "face finished")
    clock.lap("output")
    for sentence in result.warnings:
        logger.warning(sentence)
    return replace(result, seconds=dict(clock.seconds))


def constrained(problem: Problem, estimate: FaceEstimate) -> FaceEstimate:
    """The estimate with constrained control points where the template has them."""
    if problem.constraint is None:
        return estimate
    target = problem.template.surface.control_points
    surface = hold(estimate.surface, target, problem.constraint, problem.prior)
    moved = surface.vector - estimate.surface.vector
    return replace(estimate, surface=surface, smooth=estimate.smooth + moved)


def as_result(problem: Problem, surface: BSplineSurface) -> Array:
    """Control points of an estimate in the frame and size of results, (M, N, 3) mm."""
    move = head_frame(surface, problem.template, problem.settings.eye_distance_mm)
    return surface.transformed(move.scale, move.R, move.t).control_points
