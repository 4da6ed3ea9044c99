"""Photos of one person in, a B-spline surface of the face out.

Conventions
-----------
Axes: x to the right of the picture (the subject's left), y up, z toward the camera;
millimetres; origin midway between the eye centres.
Parameters: (u, v) in the unit square, u to the right, v **down**.
Control points: ``b[i, j]`` with first index u, second v; knots ``0 .. M+3`` and
``0 .. N+3``, valid interval ``[3, M] x [3, N]``.
Pixels: of the photo as it is seen (after its EXIF turn), x right, y down, centres at
integers.
"""

import logging

from . import _start as _start  # first: before what takes long to import
from .errors import Cancelled, PhotoFailure, ReconstructionError
from .progress import Progress, Step
from .reconstruct import reconstruct
from .result import PhotoReport, Reconstruction
from .settings import Settings
from .surface.bspline import BSplineSurface
from .surface.template import Template, load_template
from .track import TrackedPhoto, Tracking, track

# A library says nothing by itself; what it logs is the results' warnings.
logging.getLogger(__name__).addHandler(logging.NullHandler())

__version__ = "0.1.0"

__all__ = [
    "BSplineSurface",
    "Cancelled",
    "PhotoFailure",
    "PhotoReport",
    "Progress",
    "Reconstruction",
    "ReconstructionError",
    "Settings",
    "Step",
    "Template",
    "TrackedPhoto",
    "Tracking",
    "load_template",
    "reconstruct",
    "track",
]
