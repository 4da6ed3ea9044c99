"""A known face in a photo: pose and expression from landmarks, the identity fixed.

The paper names this as its future work.  The unknowns of a photo are its camera and a
mixture of the template's expression modes, a low-rank offset of the control points; the
face itself stays as it was reconstructed.  Landmarks sit a little elsewhere on every
face; where they sit on this one is learnt from the photos that it was made of.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from .._types import Array, Indices
from ..camera.camera import PARAMETERS, Camera
from ..camera.linear_pose import linear_pose
from ..camera.prior import CameraPrior
from ..errors import PhotoFailure
from ..landmarks.observations import LandmarkObservations
from ..surface.alignment import relative_size
from ..surface.bspline import BSplineSurface, basis_matrix
from ..surface.template import Template
from .expression import expression_displacements, expression_offsets
from .landmark_term import facing_weight, landmark_rows
from .motion import MotionOptions

ITERATIONS = 40
SETTLED = 1e-5  # step of all parameters, in their own units, after which it ends
_ROUNDS = 5  # of the robust fit of the landmarks' places


@dataclass(frozen=True)
class KnownFace:
    """A face that can be looked for.

    Attributes
    ----------
    surface : BSplineSurface
    index : (f,) int array
        Which of the template's 468 landmarks are used.
    landmarks_xyz : (f, 3) array
        Where they sit on this face, mm.
    normals : (f, 3) array
        Normals of the surface there.
    offsets : (f, 3, k) array
        Their displacement by one standard deviation of each expression mode.
    modes : (k, M, N, 3) array
        The modes themselves, in the size of this face.
    sigma : (f,) array
        Standard deviation of the detections, mm.
    """

    surface: BSplineSurface
    index: Indices
    landmarks_xyz: Array
    normals: Array
    offsets: Array
    modes: Array
    sigma: Array

    def with_expression(self, expression: Array) -> BSplineSurface:
        """The surface under a mixture of expression modes."""
        moved = np.einsum("k,kuvx->uvx", expression, self.modes)
        return BSplineSurface(self.surface.control_points + moved)


@dataclass(frozen=True)
class PoseExpression:
    """What one photo says of a known face.

    Attributes
    ----------
    camera : Camera
    expression : (k,) array
        Coefficients of the expression modes, relative to the face as it was
        reconstructed; standard deviations.
    residual_mm : float
        Median distance between landmarks and their projection, mm at the head.
    iterations : int
        Gauss-Newton steps.
    """

    camera: Camera
    expression: Array
    residual_mm: float
    iterations: int


@dataclass(frozen=True)
class PhotoLandmarks:
    """The landmarks of one photo of a known face, in the order of its ``index``.

    Attributes
    ----------
    pixels, weight : (f, 2), (f,) arrays
    principal : (2,) array
        Principal point, pixels.
    name : str
        The photo, for messages.
    focal_px : float or None
        Its focal length, pixels; None if it is not known.
    """

    pixels: Array
    weight: Array
    principal: Array
    name: str = "photo"
    focal_px: float | None = None


@dataclass(frozen=True)
class SourcePhotos:
    """The photos that a face was made of: they tell where its landmarks sit.

    Attributes
    ----------
    cameras : sequence of n Camera
    landmarks : LandmarkObservations
    expressions : (n, k) array or None
        Mixture of the expression modes in each photo.
    """

    cameras: Sequence[Camera]
    landmarks: LandmarkObservations
    expressions: Array | None = None


def known_face(
    surface: BSplineSurface,
    template: Template,
    options: MotionOptions | None = None,
    source: SourcePhotos | None = None,
) -> KnownFace:
    """Make a face ready to be looked for.

    Parameters
    ----------
    surface : BSplineSurface
    template : Template
        With the surface's number of control points.
    options : MotionOptions, optional
        Standard deviations.
    source : SourcePhotos, optional
        Without them the landmarks sit as on the template.
    """
    options = options or MotionOptions()
    if source is None:
        index = np.asarray(np.flatnonzero(template.landmark_reliable), np.int64)
    else:
        index = source.landmarks.index
    uv = template.landmark_uv[index]
    size = relative_size(surface, template)
    raised = template.landmark_xyz[index] - template.surface.evaluate(*uv.T)
    modes = options.expression * size * template.expression_modes
    offsets = options.expression * size * expression_offsets(template, uv, len(modes))
    face = KnownFace(
        surface=surface,
        index=index,
        landmarks_xyz=surface.evaluate(*uv.T) + size * raised,
        normals=surface.normals(*uv.T),
        offsets=offsets,
        modes=modes,
        sigma=size * options.sigma(template, index),
    )
    if source is None or not len(source.cameras):
        return face
    marks = personalise_landmarks(face, template, source, size * options.offset_mm)
    return KnownFace(**{**face.__dict__, "landmarks_xyz": marks})


def personalise_landmarks(
    face: KnownFace, template: Template, source: SourcePhotos, offset_mm: float
) -> Array:
    """Landmarks where the photos saw them, held near where the template has them.

    Parameters
    ----------
    face : KnownFace
        With its landmarks as on the template.
    template : Template
    source : SourcePhotos
    offset_mm : float
        Standard deviation of a landmark's place between faces.

    Returns
    -------
    (f, 3) array
        mm.
    """
    start, marks = face.landmarks_xyz, face.landmarks_xyz.copy()
    seen, n = source.landmarks, len(source.cameras)
    away = np.zeros((n, *marks.shape))
    if source.expressions is not None and np.any(source.expressions):
        size = relative_size(face.surface, template)
        T = basis_matrix(face.surface.shape, *template.landmark_uv[face.index].T)
        moved = expression_displacements(template, source.expressions, size)
        away = np.stack([T @ d.reshape(-1, 3) for d in moved])
    for _ in range(_ROUNDS):
        A = np.tile(np.eye(3) / offset_mm**2, (len(marks), 1, 1))
        b = (start - marks) / offset_mm**2
        for i, camera in enumerate(source.cameras):
            weight = seen.weight[i] * facing_weight(camera, marks, face.normals)
            rows = landmark_rows(
                camera, marks + away[i], seen.pixels[i], weight, face.sigma
            )
            A += np.einsum("lxa,l,lxb->lab", rows.by_point, rows.weight, rows.by_point)
            b += np.einsum("lxa,l,lx->la", rows.by_point, rows.weight, rows.residual)
        marks = marks + np.linalg.solve(A, b[..., None])[..., 0]
    return marks


def estimate_pose_expression(
    face: KnownFace, photo: PhotoLandmarks, prior: CameraPrior | None = None
) -> PoseExpression | PhotoFailure:
    """Camera and expression of one photo of a known face.

    Robust Gauss-Newton on the landmarks, from the linear pose of section 2.3.1.

    Parameters
    ----------
    face : KnownFace
    photo : PhotoLandmarks
    prior : CameraPrior, optional
    """
    prior = (prior or CameraPrior()).of_photo(photo.focal_px)
    x, y = photo.principal
    start = linear_pose(
        photo.pixels, face.landmarks_xyz, photo.weight, (float(x), float(y)), photo.name
    )
    if not isinstance(start, Camera):
        return start
    camera = replace(start, kappa=prior.kappa(start.s))
    k = face.offsets.shape[2]
    e = np.zeros(k)
    hold = block_diag(prior.precision(), np.eye(k))
    iterations = 0
    while iterations < ITERATIONS:
        iterations += 1
        A, b = pose_equations(face, camera, e, photo)
        A += hold
        b += np.concatenate([prior.pull(camera), -e])
        step = np.linalg.solve(A, b)
        camera, e = camera.moved(step[:PARAMETERS]), e + step[PARAMETERS:]
        if np.abs(step).max() < SETTLED:
            break
    return PoseExpression(camera, e, residual_mm(face, camera, e, photo), iterations)


def pose_equations(
    face: KnownFace, camera: Camera, e: Array, photo: PhotoLandmarks
) -> tuple[Array, Array]:
    """Gauss-Newton block of camera and expression from the landmarks.

    Returns
    -------
    A, b : (7 + k, 7 + k), (7 + k,) arrays
    """
    Q = face.landmarks_xyz + face.offsets @ e
    weight = photo.weight * facing_weight(camera, Q, face.normals)
    rows = landmark_rows(camera, Q, photo.pixels, weight, face.sigma)
    own = np.concatenate([rows.by_camera, rows.by_point @ face.offsets], 2)
    A = np.einsum("lxa,l,lxb->ab", own, rows.weight, own)
    return A, np.einsum("lxa,l,lx->a", own, rows.weight, rows.residual)


def residual_mm(
    face: KnownFace, camera: Camera, e: Array, photo: PhotoLandmarks
) -> float:
    """Median distance of the known landmarks from their projection, mm at the head."""
    Q = face.landmarks_xyz + face.offsets @ e
    away = np.linalg.norm(camera.project(Q) - photo.pixels, axis=1)[photo.weight > 0]
    return float(np.median(away)) / camera.s if len(away) else 0.0
