"""Normal equations of the landmarks: 3D displacements, each photo eliminated.

The unknowns are the displacements of the landmarks from the template, a camera and an
expression for each photo.  Camera and expression of a photo touch no other photo's, so
they are eliminated one photo at a time (Schur complement).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve, solve_triangular

from .._types import Array
from ..camera.camera import DISTANCE, Camera
from ..camera.prior import CameraPrior
from ..gram import gram
from ..landmarks.observations import LandmarkObservations
from ..progress import CheckCancelled, never_cancelled
from ..surface.bspline import basis_matrix
from ..surface.prior import ShapePrior
from ..surface.template import Template
from .expression import expression_offsets
from .landmark_term import LandmarkRows, facing_weight, landmark_rows

if TYPE_CHECKING:
    from .motion import MotionOptions

# Photos that are eliminated at a time.
_BATCH = 16
# Largest step of a camera: radians, relative change of scale and of distance.
_LARGEST_STEP = 1.0
_ROTATION_SCALE_DISTANCE = [0, 1, 2, 3, DISTANCE]


@dataclass(frozen=True, eq=False)
class LandmarkModel:
    """What is known of f landmarks in n photos, whatever the estimate.

    Attributes
    ----------
    landmarks : LandmarkObservations
    start, normals : (f, 3) arrays
        Landmarks and normals of the template.
    precision : (3f, 3f) array
        Of the displacement of the landmarks before any photo, with the offsets that
        the detector gives them, 1/mm^2.
    E : (f, 3, k) array
        Displacement by each expression mode, mm.
    sigma : (f,) array
        Standard deviation of a landmark in one photo, mm.
    camera : CameraPrior
    """

    landmarks: LandmarkObservations
    start: Array
    normals: Array
    precision: Array
    E: Array
    sigma: Array
    camera: CameraPrior

    @classmethod
    def of(
        cls,
        template: Template,
        prior: ShapePrior,
        landmarks: LandmarkObservations,
        options: MotionOptions,
    ) -> LandmarkModel:
        """The model of a prior and of options."""
        uv = landmarks.uv
        covariance = prior.displacement_covariance(
            uv, basis_matrix(template.surface.shape, *uv.T)
        )
        covariance += options.offset_mm**2 * np.eye(len(covariance))
        count = len(template.expression_modes) if options.expression > 0 else 0
        return cls(
            landmarks,
            template.landmark_xyz[landmarks.index],
            template.surface.normals(*uv.T),
            inverse(covariance),
            options.expression * expression_offsets(template, uv, count),
            options.sigma(template, landmarks.index),
            options.camera,
        )

    def linearise(
        self,
        cameras: Sequence[Camera],
        m: Array,
        e: Array,
        check_cancelled: CheckCancelled = never_cancelled,
    ) -> LandmarkSystem:
        """Normal equations of the displacements, the photos eliminated.

        Parameters
        ----------
        cameras : sequence of n Camera
        m : (f, 3) array
            Displacements of the landmarks, mm.
        e : (n, k) array
            Expressions.
        check_cancelled : callable
            Called once per photo.
        """
        n = len(cameras)
        H, g = self.precision.copy(), -(self.precision @ m.ravel())
        blocks, halves = [], []
        squares = weights = 0.0
        for i, camera in enumerate(cameras):
            check_cancelled()
            Q = self.start + m + self.E @ e[i]
            weight = self.landmarks.weight[i] * facing_weight(camera, Q, self.normals)
            pixels = self.landmarks.pixels[i]
            rows = landmark_rows(camera, Q, pixels, weight, self.sigma)
            known = self.camera.of_photo(self.landmarks.focal_px[i])
            hold = block_diag(known.precision(), np.eye(e.shape[1]))
            pull = np.concatenate([known.pull(camera), -e[i]])
            block = _photo_block(rows, self.E, hold, pull)
            halves.append(block.eliminate_from(H, g, rows))
            blocks.append(block)
            if len(halves) == _BATCH or i + 1 == n:
                H -= gram(np.concatenate(halves))
                halves.clear()
            squares += float((rows.weight * rows.distance**2).sum())
            weights += float(rows.weight.sum())
        H += 1e-9 * np.eye(len(H))
        return LandmarkSystem(
            H, g, blocks, float(np.sqrt(squares / max(weights, 1e-30)))
        )


class LandmarkSystem(NamedTuple):
    """Normal equations of the displacements of f landmarks.

    Attributes
    ----------
    precision : (3f, 3f) array
        Given all photos, 1/mm^2.
    right : (3f,) array
    blocks : list of n
        What was eliminated.
    residual : float
        Root mean square distance of the landmarks in the photos, mm at the head.
    """

    precision: Array
    right: Array
    blocks: list[_PhotoBlock]
    residual: float


class _PhotoBlock(NamedTuple):
    """Normal equations of one photo's camera and expression (q = 7 + k unknowns)."""

    factor: Array  # lower Cholesky factor of the photo's own block, (q, q)
    B: Array  # (3f, q) coupling with the landmarks
    b: Array  # (q,) right side

    def eliminate_from(self, H: Array, g: Array, rows: LandmarkRows) -> Array:
        """Add the photo to the landmarks' system (3f unknowns), itself eliminated.

        Returns the (q, 3f) array whose gram is still to be taken from ``H``: those of
        many photos in one product are faster.
        """
        J, w = rows.by_point, rows.weight
        D = np.einsum("lxa,l,lxb->lab", J, w, J)
        at = 3 * np.arange(len(w))
        for x in range(3):
            for y in range(3):
                H[at + x, at + y] += D[:, x, y]
        g += np.einsum("lxa,l,lx->la", J, w, rows.residual).ravel()
        g -= self.B @ cho_solve((self.factor, True), self.b)
        return solve_triangular(self.factor, self.B.T, lower=True)

    def back_substitute(self, dm: Array) -> Array:
        """Step of the photo's unknowns for the landmarks' step, ``(q,)``."""
        step = cho_solve((self.factor, True), self.b - self.B.T @ dm)
        # Landmarks that form no face send a camera far away, where nothing brings it
        # back; a step of a usual camera is a tenth of that.
        largest = np.abs(step[_ROTATION_SCALE_DISTANCE]).max()
        return step / max(1.0, largest / _LARGEST_STEP)


def _photo_block(rows: LandmarkRows, E: Array, hold: Array, pull: Array) -> _PhotoBlock:
    """Block of one photo; ``hold`` (q, q) and ``pull`` (q,) are its unknowns' prior."""
    w, J = rows.weight, rows.by_point
    own = np.concatenate([rows.by_camera, J @ E], 2)
    weighted = w[:, None, None] * own
    q = own.shape[2]
    A = own.reshape(-1, q).T @ weighted.reshape(-1, q) + hold
    b = rows.residual.ravel() @ weighted.reshape(-1, q) + pull
    B = np.matmul(J.transpose(0, 2, 1), weighted).reshape(-1, q)
    return _PhotoBlock(np.linalg.cholesky(A), B, b)


def inverse(covariance: Array) -> Array:
    """Inverse of a small dense covariance, by its Cholesky factor."""
    return cho_solve(cho_factor(covariance), np.eye(len(covariance)))
