"""What a reconstruction is: the surface, and all that is known about how it came."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .camera.camera import Camera
from .images.photo import Photo
from .landmarks.landmarks import Landmarks
from .photometry.lighting import PhotometricEvidence
from .settings import Settings
from .surface.bspline import BSplineSurface
from .surface.template import Template

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PhotoReport:
    """One line of the per-photo report.

    Attributes
    ----------
    name : str
    status : str
        "used" or the code of a failure (`errors.FAILURE_CODES`).
    reason : str
        Why it was left out, or a remark on a used photo.
    reprojection_pct : float
        Median distance between landmarks and the projected surface, % of the eye
        distance; NaN if not used.
    yaw, pitch, roll : float
        Degrees; head turned to the picture's right, up, clockwise.
    residual : float
        Root mean square intensity residual, relative to the photo's median.
    weight : float
        Mean robust weight of its samples, 0 to 1.
    """

    name: str
    status: str
    reason: str = ""
    reprojection_pct: float = float("nan")
    yaw: float = float("nan")
    pitch: float = float("nan")
    roll: float = float("nan")
    residual: float = float("nan")
    weight: float = float("nan")


@dataclass(frozen=True)
class Reconstruction:
    """Result of `bsface.reconstruct`.

    Attributes
    ----------
    surface : BSplineSurface
        The face, millimetres, origin midway between the eye centres.
    template : Template
        The template that it started from, with the same size of net.
    photos, landmarks, cameras : tuples of n
        Used photos (cut-outs) in folder order, with landmarks and cameras.
    photometric : PhotometricEvidence or None
        Albedo, lights and normals; None for ``method="motion"``.
    reports : tuple of PhotoReport
        Every photo of the folder, in folder order.
    confidence : (M, N) array or None
        Standard deviation of the control points along their normals, mm.
    settings : Settings
    history : tuple of mappings
        One for each iteration: stage, residual, step in mm.
    warnings : tuple of str
        What the photos cannot tell, in sentences.
    seconds : mapping
        Time of each stage.
    expressions : (n, k) array
        Coefficients of the template's expression modes in each photo.
    """

    surface: BSplineSurface
    template: Template
    photos: tuple[Photo, ...]
    landmarks: tuple[Landmarks, ...]
    cameras: tuple[Camera, ...]
    photometric: PhotometricEvidence | None
    reports: tuple[PhotoReport, ...]
    confidence: Array | None
    settings: Settings
    history: tuple[Mapping[str, Any], ...] = ()
    warnings: tuple[str, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)
    expressions: Array | None = None
