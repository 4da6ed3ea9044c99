"""From the last estimate to the result: frame, constraint, checks, reports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ._types import Array
from .camera.coverage import shortcomings
from .images.folder import natural_key
from .photometry import harmonics
from .problem import FaceEstimate, Problem
from .result import HistoryEntry, PhotoReport, Provenance, Reconstruction
from .solve.constraint import hold
from .solve.expression import expression_offsets
from .solve.known_face import SourcePhotos, known_face
from .solve.motion import MotionOptions
from .solve.sanity import check_surface
from .surface.alignment import head_frame


def finish(
    problem: Problem, estimate: FaceEstimate, history: Sequence[HistoryEntry] = ()
) -> Reconstruction:
    """The result of a run.

    Parameters
    ----------
    problem : Problem
    estimate : FaceEstimate
        The last one of the run.
    history : sequence of HistoryEntry

    Raises
    ------
    ReconstructionError
        When the surface cannot be a face.
    """
    estimate = _personal_landmarks(problem, estimate)
    reports = photo_reports(problem, estimate)
    estimate = _in_head_frame(problem, estimate)
    if problem.constraint is not None and problem.target is not None:
        # Size and place of the result are its own; the constrained points' are given.
        target = problem.target.control_points
        surface = hold(estimate.surface, target, problem.constraint, problem.prior)
        estimate = replace(estimate, surface=surface)
    collection, evidence = problem.collection, estimate.photometric
    poses = np.array([camera.yaw_pitch_roll for camera in estimate.cameras])
    light = None if evidence is None else evidence.singular_values
    return Reconstruction(
        surface=estimate.surface,
        template=problem.template,
        photos=collection.photos,
        landmarks=collection.landmarks,
        cameras=estimate.cameras,
        photometric=evidence,
        reports=reports,
        deviation=estimate.deviation,
        skin=estimate.skin,
        settings=problem.settings,
        expressions=estimate.expressions,
        constraint=problem.constraint,
        history=tuple(history),
        warnings=(
            *check_surface(estimate.surface, problem.template),
            *collection.hints,
            *collection.identity_warnings,
            *shortcomings(poses, light, copies=collection.copies),
        ),
        provenance=Provenance.of_this_program(collection.hashes),
    )


def photo_reports(problem: Problem, estimate: FaceEstimate) -> tuple[PhotoReport, ...]:
    """One report per photo, in the order of their names; of unused ones too."""
    collection, seen = problem.collection, problem.landmarks
    reports = [PhotoReport(f.name, f.code, f.reason) for f in collection.failures]
    offsets = expression_offsets(
        problem.template, seen.uv, estimate.expressions.shape[1]
    )
    for i, photo in enumerate(collection.photos):
        camera = estimate.cameras[i]
        points = estimate.landmarks_xyz + offsets @ estimate.expressions[i]
        away = np.linalg.norm(camera.project(points) - seen.pixels[i], axis=1)
        eye = camera.s * problem.template.eye_distance
        yaw, pitch, roll = (float(angle) for angle in camera.yaw_pitch_roll)
        residual, weight = _intensity_fit(estimate, i)
        reports.append(
            PhotoReport(
                name=photo.name,
                status="used",
                reason="; ".join(
                    filter(None, (collection.landmarks[i].note, photo.note))
                ),
                reprojection_pct=float(100 * np.median(away[seen.weight[i] > 0]) / eye),
                yaw=yaw,
                pitch=pitch,
                roll=roll,
                residual=residual,
                weight=weight,
            )
        )
    return tuple(sorted(reports, key=lambda r: natural_key(r.name)))


def _intensity_fit(estimate: FaceEstimate, photo: int) -> tuple[float, float]:
    """Root mean square residual of a photo, and the mean weight of its samples."""
    evidence = estimate.photometric
    if evidence is None:
        return float("nan"), float("nan")
    w, r = evidence.weights[photo], evidence.residual[photo]
    residual = float(np.sqrt((w * r**2).sum() / max(w.sum(), 1e-12)))
    return residual, float(w[w > 0].mean()) if (w > 0).any() else 0.0


def _personal_landmarks(problem: Problem, estimate: FaceEstimate) -> FaceEstimate:
    """Where the landmarks sit on this face, seen from where the cameras are now."""
    if problem.settings.method != "joint" or estimate.photometric is None:
        return estimate
    source = SourcePhotos(estimate.cameras, problem.landmarks, estimate.expressions)
    options = MotionOptions.of(problem)
    face = known_face(estimate.surface, problem.template, options, source)
    return replace(estimate, landmarks_xyz=face.landmarks_xyz)


def _in_head_frame(problem: Problem, estimate: FaceEstimate) -> FaceEstimate:
    """The same estimate in the frame and size that results have."""
    template, settings = problem.template, problem.settings
    move = head_frame(estimate.surface, template, settings.eye_distance_mm)
    evidence = estimate.photometric
    if evidence is not None:
        turn = harmonics.rotation(move.R, evidence.lights.shape[1])
        evidence = replace(
            evidence,
            normals=evidence.normals @ move.R.T,
            lights=evidence.lights @ turn,
        )
    spread: Array | None = estimate.deviation
    return replace(
        estimate,
        surface=estimate.surface.transformed(move.scale, move.R, move.t),
        cameras=tuple(c.rescaled(move.scale, move.R, move.t) for c in estimate.cameras),
        landmarks_xyz=move(estimate.landmarks_xyz),
        photometric=evidence,
        deviation=None if spread is None else move.scale * spread,
    )
