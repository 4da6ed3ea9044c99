"""Does a face look drawn or painted?  How evenly its brightness changes tells.

The brightness of a photographed face changes a little nearly everywhere: few pixels
have no gradient, and all levels occur.  Drawings have flat areas between hard edges, or
few levels; paintings have flat strokes.  `benchmarks/drawn.py` prints how often each is
told, and how often photos are taken for drawings.
"""

from __future__ import annotations

import cv2
import numpy as np

from ..images.photo import Photo
from .landmarks import Landmarks
from .plausibility import FaceFit

# Eye distance in pixels at which the face is looked at; smaller ones stay as they are.
EYE_DISTANCE = 48.0
# Lower quartile of the gradients over their upper decile. Photos have 0.08 and more.
EVEN = 0.065
# Entropy of the levels, in bits below that of a normal distribution as wide. Photos
# have 0.9 at most.
FEW_LEVELS = 1.2
# Faces with less contrast, or with more burnt out, are not judged: they have few levels
# in any case.
LEAST_CONTRAST = 12.0
MOST_BURNT = 0.1
FEWEST_PIXELS = 100


def looks_drawn(photo: Photo, landmarks: Landmarks, fit: FaceFit) -> bool:
    """Whether the face in a cut-out may be drawn or painted.

    Parameters
    ----------
    photo : Photo
        Cut-out with the face.
    landmarks : Landmarks
    fit : FaceFit
    """
    pixels, xy = photo.bytes8(), photo.to_window(landmarks.points)
    factor = EYE_DISTANCE / (fit.eye_distance * photo.window[2])
    if factor < 1:
        pixels = cv2.resize(
            pixels, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA
        )
        xy = (xy + 0.5) * factor - 0.5
    grey = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
    mask = np.zeros(grey.shape, np.uint8)
    cv2.fillConvexPoly(mask, cv2.convexHull(np.rint(xy).astype(np.int32)), (1.0,))
    # Not the outline, behind which is something else.
    mask = cv2.erode(mask, np.ones((5, 5), np.uint8), borderValue=(0.0,))
    face = mask > 0
    inside = face & (grey > 2) & (grey < 253)
    levels = grey[inside]
    if len(levels) < FEWEST_PIXELS or levels.std() < LEAST_CONTRAST:
        return False
    if (grey[face] >= 253).mean() > MOST_BURNT:
        return False
    down, across = np.gradient(grey.astype(float))
    low, high = np.percentile(np.hypot(down, across)[inside], (25, 90))
    return bool(low < EVEN * high or missing_levels(levels) > FEW_LEVELS)


def missing_levels(levels: np.ndarray) -> float:
    """Bits between the entropy of levels and that of a normal distribution as wide."""
    share = np.bincount(levels, minlength=256) / len(levels)
    share = share[share > 0]
    normal = 0.5 * np.log2(2 * np.pi * np.e * float(levels.var()))
    return float(normal + share @ np.log2(share))
