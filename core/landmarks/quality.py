"""Is the face in a cut-out sharp and exposed enough to measure on?

All tests look at the face only, brought to one size, and are generous: a press
photo of a hundred pixels must pass.
"""

from __future__ import annotations

import cv2
import numpy as np

from ..errors import PhotoFailure
from ..images.photo import Photo
from .landmarks import Landmarks
from .plausibility import FaceFit

# Eye distance in pixels at which sharpness is measured.
MEASURED_EYE_DISTANCE = 32.0
# Press photos of 40 pixels between the eyes have 0.06 and more; blurred by a tenth
# of the eye distance most photos have less than 0.006.
MIN_SHARPNESS = 0.006
MAX_CLIPPED = 0.9


def judge_quality(
    photo: Photo, landmarks: Landmarks, fit: FaceFit
) -> PhotoFailure | None:
    """A failure ``"dark"``, ``"bright"`` or ``"blurred"``, or None.

    Parameters
    ----------
    photo : Photo
        Cut-out with the face.
    landmarks : Landmarks
    fit : FaceFit
    """
    name = photo.name
    face = face_patch(photo, landmarks, fit)
    if (face < 8).mean() > MAX_CLIPPED:
        return PhotoFailure(
            name, "dark", f"The face in {name} is nearly black; use a lighter photo."
        )
    if (face > 250).mean() > MAX_CLIPPED:
        return PhotoFailure(
            name, "bright", f"The face in {name} is nearly white; use a darker photo."
        )
    if sharpness(face) < MIN_SHARPNESS:
        return PhotoFailure(
            name, "blurred", f"The face in {name} is blurred; use a sharp photo."
        )
    return None


def face_patch(photo: Photo, landmarks: Landmarks, fit: FaceFit) -> np.ndarray:
    """The face's box as grey float32 values 0..255, at one size."""
    xy = photo.to_window(landmarks.points)
    h, w = photo.pixels.shape[:2]
    low = np.clip(xy.min(axis=0), 0, (w - 4, h - 4)).astype(int)
    high = np.clip(xy.max(axis=0), low + 4, (w, h)).astype(int)
    part = photo.bytes8()[low[1] : high[1], low[0] : high[0]]
    grey = cv2.cvtColor(part, cv2.COLOR_RGB2GRAY).astype(np.float32)
    factor = MEASURED_EYE_DISTANCE / (fit.eye_distance * photo.window[2])
    if factor < 1:
        grey = cv2.resize(
            grey, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA
        )
    return grey


def sharpness(grey: np.ndarray) -> float:
    """Energy of the Laplacian relative to the variance: 0 = no detail at all."""
    detail = cv2.Laplacian(grey, cv2.CV_32F)[1:-1, 1:-1]
    return float(detail.var() / max(float(grey.var()), 1e-6))
