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
from .camera.camera import Camera
from .compare import Comparison, compare
from .errors import Cancelled, FailureCode, PhotoFailure, ReconstructionError
from .formats import export
from .formats.face_file import load_face as load
from .images.folder import list_photos
from .images.photo import Photo
from .landmarks.landmarks import Landmarks, read_landmarks, write_landmarks
from .problem import Constraint
from .progress import Progress, Step
from .reconstruct import reconstruct
from .report.report import write_report
from .result import PhotoReport, Provenance, Reconstruction
from .rig.arkit import ARKIT_NAMES, arkit_keys
from .settings import Settings
from .surface.bspline import BSplineSurface
from .surface.template import Template, load_template
from .texture.bake import Texture, bake_texture, write_texture
from .texture.detail import Detail, write_displacement, write_normals
from .track import TrackedPhoto, Tracking, track
from .versions import VERSION

# A library says nothing by itself; what it logs is the results' warnings.
logging.getLogger(__name__).addHandler(logging.NullHandler())

__version__ = VERSION

__all__ = [
    "ARKIT_NAMES",
    "BSplineSurface",
    "Camera",
    "Cancelled",
    "Comparison",
    "Constraint",
    "Detail",
    "FailureCode",
    "Landmarks",
    "Photo",
    "PhotoFailure",
    "PhotoReport",
    "Progress",
    "Provenance",
    "Reconstruction",
    "ReconstructionError",
    "Settings",
    "Step",
    "Template",
    "Texture",
    "TrackedPhoto",
    "Tracking",
    "arkit_keys",
    "bake_texture",
    "compare",
    "export",
    "list_photos",
    "load",
    "load_template",
    "read_landmarks",
    "reconstruct",
    "track",
    "write_displacement",
    "write_landmarks",
    "write_normals",
    "write_report",
    "write_texture",
]
