"""Which faces of many differ most in pose and light, and are seen best.

Hundreds of photos, and the frames of a video, differ little from each other.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from .._types import Array
from ..images.frames import far_apart, up_to_median
from .face_selection import Candidate
from .quality import face_patch, sharpness

# One step apart: heads turned by ten degrees, or faces whose brightness, over its mean,
# differs by so much (root mean square).
POSE_STEP = np.sin(np.radians(10))
LIGHT_STEP = 0.15
_CELLS = 6


def differing_faces(faces: Sequence[Candidate], limit: int) -> list[int]:
    """Indices of at most `limit` large and sharp faces that differ in pose and light.

    Parameters
    ----------
    faces : sequence of Candidate
        One of each photo, all without a failure.
    limit : int

    Returns
    -------
    list of int
        In ascending order.
    """
    if len(faces) <= limit:
        return list(range(len(faces)))
    patches = [face_patch(f.photo, f.landmarks, f.fit) for f in faces]
    pairs = zip(faces, patches, strict=True)
    features = np.stack([_pose_and_light(face, patch) for face, patch in pairs])
    size = np.array([f.fit.eye_distance * f.photo.window[2] for f in faces])
    # as large as half of those would be that are chosen for their size alone
    large = float(np.median(np.sort(size)[-limit:]))
    weight = up_to_median(np.array([sharpness(patch) for patch in patches]))
    weight *= np.minimum(size / max(large, 1e-12), 1.0)
    return sorted(far_apart(features, weight, limit))


def _pose_and_light(face: Candidate, patch: Array) -> Array:
    """(3 + 36,) numbers: distances of 1 are one step in pose or in light."""
    rows = face.fit.affine[:, :3] / np.linalg.norm(
        face.fit.affine[:, :3], axis=1, keepdims=True
    )
    toward = np.cross(rows[0], -rows[1])  # the camera, seen from the head
    cells = cv2.resize(patch, (_CELLS, _CELLS), interpolation=cv2.INTER_AREA)
    light = cells / max(float(cells.mean()), 1.0)
    return np.concatenate([toward / POSE_STEP, light.ravel() / (LIGHT_STEP * _CELLS)])
