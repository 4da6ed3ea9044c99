"""Do landmarks look like a face, seen from in front? A fit that answers.

The template's landmarks, seen from far away, land at an affine image of their
3D positions. Eight numbers cannot bend to any set of points, so the residual of
that fit tells a face from a mistake, and the affine map tells the size of the
eye distance, a swapped or flipped axis, and whether the points collapse.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._types import Array
from ..errors import PhotoFailure
from ..surface.template import Template
from .landmarks import Landmarks

MAX_RESIDUAL = 0.12
# Points set by hand or by other programs mean slightly other places of the face.
MAX_RESIDUAL_FILE = 0.2
MAX_STRETCH = 2.0
MIN_EYE_DISTANCE = 16.0


@dataclass(frozen=True, eq=False)
class FaceFit:
    """The template's landmarks fitted to points of a picture.

    Parameters
    ----------
    eye_distance : float
        Pixels that the eye distance would have, seen from in front.
    residual : float
        Root mean square of the distances, in parts of the eye distance.
    stretch : float
        Ratio of the two scales of the map; 1 for a rigid head.
    flipped : bool
        The points are the mirror image of a face.
    roll : float
        Degrees that the head is turned in the picture, clockwise as seen.
    affine : (2, 4) array
        The map itself: ``pixel = affine @ (x, y, z, 1)``.
    """

    eye_distance: float
    residual: float
    stretch: float
    flipped: bool
    roll: float
    affine: np.ndarray

    @property
    def turn(self) -> float:
        """Angle between the axes of the face and of the camera, degrees."""
        x, y = self.affine[0, :3], -self.affine[1, :3]
        toward = np.cross(x, y)
        length = float(np.linalg.norm(toward))
        return float(np.degrees(np.arccos(toward[2] / max(length, 1e-12))))

    def project(self, xyz: np.ndarray) -> np.ndarray:
        """(..., 2) pixels of points (..., 3) of the template."""
        return xyz @ self.affine[:, :3].T + self.affine[:, 3]


def fit_landmarks(
    template: Template, points: Array, scheme: str, weight: Array
) -> FaceFit:
    """`fit_face` of a template's reliable landmarks to those of a scheme."""
    indices = template.schemes[scheme]
    return fit_face(
        template.landmark_xyz[indices],
        points,
        template.landmark_reliable[indices] * weight,
        template.eye_distance,
    )


def fit_face(
    xyz: np.ndarray, points: np.ndarray, weight: np.ndarray, eye_distance: float
) -> FaceFit:
    """Affine fit of the template's landmarks to points in a picture.

    Parameters
    ----------
    xyz : (f, 3) array
        Template landmarks; x to the picture's right, y up, z to the camera.
    points : (f, 2) array
        Pixels, y down.
    weight : (f,) array
        Not negative.
    eye_distance : float
        Of the template, in the unit of `xyz`.
    """
    root = np.sqrt(weight)[:, None]
    design = np.column_stack([xyz, np.ones(len(xyz))])
    solution, *_ = np.linalg.lstsq(design * root, points * root, rcond=None)
    rest = points - design @ solution
    residual = np.sqrt((weight @ (rest**2).sum(axis=1)) / max(weight.sum(), 1e-12))
    matrix = solution[:3].T * ((1.0,), (-1.0,))  # y up
    large, small = np.linalg.svd(matrix, compute_uv=False)
    size = float(large) * eye_distance
    toward = np.cross(matrix[0], matrix[1])
    return FaceFit(
        eye_distance=size,
        residual=float(residual / max(size, 1e-12)),
        stretch=float(large / max(small, 1e-12)),
        flipped=bool(toward[2] < 0),
        roll=float(np.degrees(np.arctan2(-matrix[1, 0], matrix[0, 0]))),
        affine=solution.T,
    )


def judge_fit(
    fit: FaceFit, landmarks: Landmarks, size: tuple[int, int]
) -> PhotoFailure | None:
    """A failure ``"implausible"`` or ``"small_face"``, or None.

    Parameters
    ----------
    fit : FaceFit
    landmarks : Landmarks
    size : (int, int)
        Width and height of the photo.
    """
    name = landmarks.photo
    detected = landmarks.source == "detected"
    remedy = (
        f"remove {name} or place its landmarks by hand."
        if detected
        else "correct or remove them."
    )

    def implausible(what: str) -> PhotoFailure:
        return PhotoFailure(
            name, "implausible", f"The landmarks of {name} {what}; {remedy}"
        )

    if not np.isfinite([fit.residual, fit.eye_distance, fit.stretch]).all():
        return implausible("form no face")
    if not detected and fit.eye_distance < 1:
        return implausible("lie at one place")
    if outside(landmarks, size) > 0.5:
        return implausible(f"lie outside the picture of {size[0]} x {size[1]} pixels")
    if fit.flipped:
        return implausible("are mirrored or have x and y swapped")
    limit = MAX_RESIDUAL if detected else MAX_RESIDUAL_FILE
    if fit.residual > limit or fit.stretch > MAX_STRETCH:
        return implausible("form no face")
    if not detected and abs(fit.roll) > 150:
        return implausible("are upside down")
    if fit.eye_distance < MIN_EYE_DISTANCE:
        return PhotoFailure(
            name,
            "small_face",
            f"The face in {name} is too small ({fit.eye_distance:.0f} pixels between "
            f"the eyes, {MIN_EYE_DISTANCE:.0f} are needed); use a larger picture.",
        )
    return None


def outside(landmarks: Landmarks, size: tuple[int, int]) -> float:
    """Fraction of the landmarks that lie outside a picture of this width and height."""
    high = np.asarray(size) - 0.5
    inside = ((landmarks.points > -0.5) & (landmarks.points < high)).all(axis=1)
    return float(1 - inside.mean())
