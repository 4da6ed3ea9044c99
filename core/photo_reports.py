"""What a result says about each photo: how it was used and how well it fits."""

from __future__ import annotations

import numpy as np

from .images.folder import natural_key
from .photometry.lighting import PhotometricEvidence
from .prepare import PhotoCollection
from .result import PhotoReport
from .solve.expression import landmark_expression_offsets
from .solve.motion import Bundle, LandmarkObservations
from .surface.template import Template


def photo_reports(
    collection: PhotoCollection,
    template: Template,
    shown: Bundle,
    seen: LandmarkObservations,
    evidence: PhotometricEvidence | None,
) -> tuple[PhotoReport, ...]:
    """One report a photo, in the order of their names; those that were not used too.

    Parameters
    ----------
    gathered : Gathered
    template : Template
    shown : Bundle
        Cameras, landmarks and expressions of the result.
    seen : Observations
    evidence : PhotometricEvidence or None
    """
    reports = [PhotoReport(f.name, f.code, f.reason) for f in collection.failures]
    expression_offsets = landmark_expression_offsets(
        template, seen, shown.expressions.shape[1]
    )
    for i, photo in enumerate(collection.photos):
        known = seen.weight[i] > 0
        camera = shown.cameras[i]
        points = shown.structure + expression_offsets @ shown.expressions[i]
        away = np.linalg.norm(camera.project(points) - seen.pixels[i], axis=1)
        eye = camera.s * template.eye_distance
        yaw, pitch, roll = camera.yaw_pitch_roll
        residual = weight = float("nan")
        if evidence is not None:
            w = evidence.weights[i]
            r = evidence.residual[i]
            residual = float(np.sqrt((w * r**2).sum() / max(w.sum(), 1e-12)))
            weight = float(w[w > 0].mean()) if (w > 0).any() else 0.0
        reports.append(
            PhotoReport(
                photo.name,
                "used",
                collection.landmarks[i].note,
                float(100 * np.median(away[known]) / eye),
                float(yaw),
                float(pitch),
                float(roll),
                residual,
                weight,
            )
        )
    return tuple(sorted(reports, key=lambda r: natural_key(r.name)))
