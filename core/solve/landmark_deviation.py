"""How well the landmarks alone fix the surface.

The shape prior given the landmarks is Gaussian again.  Cameras, expressions and the
landmarks' own offsets are not known either, so what they leave open counts.  Size,
place and direction do not: those of a result are a convention (`head_frame`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._types import Array
from ..problem import FaceEstimate, Problem
from ..surface.bspline import BSplineSurface, basis_matrix
from ..surface.prior import ShapePrior
from ..surface.template import Template
from .landmark_system import LandmarkModel, inverse
from .motion import MotionOptions

# Columns of an inverse that are made at a time.
_BATCH = 256


def landmark_deviation(problem: Problem, estimate: FaceEstimate) -> Array:
    """Standard deviation of each control point along its normal, mm, ``(M, N)``.

    Parameters
    ----------
    problem : Problem
    estimate : FaceEstimate
        Of the motion stage.
    """
    seen, prior, surface = problem.landmarks, problem.prior, estimate.surface
    options = MotionOptions.of(problem)
    model = LandmarkModel.of(problem.template, prior, seen, options)
    expressions = estimate.expressions[:, : model.E.shape[2]]
    moved = estimate.landmarks_xyz - model.start
    given = model.linearise(estimate.cameras, moved, expressions).precision
    posterior = inverse(given)
    shape = NormalDisplacement.of(surface, problem.template)
    before, coupling = shape.covariance(prior, seen.uv)
    taken = coupling @ model.precision
    variance = before - (taken * coupling).sum(1)
    variance += ((taken @ posterior) * taken).sum(1)
    deviation = np.sqrt(np.maximum(variance, 0)).reshape(surface.shape)
    if problem.constraint is not None:
        held = np.asarray(problem.constraint.points, bool)
        softness = problem.constraint.softness_mm
        deviation[held] = np.minimum(deviation[held], softness)
    return deviation


@dataclass(frozen=True, eq=False)
class NormalDisplacement:
    """Displacements of control points along their normals, without similarities.

    Attributes
    ----------
    normals : (M*N, 3) array
        Of the surface at the Greville abscissae.
    similarity : (M*N, 7) array
        What shifts, rotations and a change of size do along the normals.
    fit : (7, M*N, 3) array
        The similarity that is closest to a displacement, by least squares over the
        control points of the face.
    """

    normals: Array
    similarity: Array
    fit: Array

    @classmethod
    def of(cls, surface: BSplineSurface, template: Template) -> NormalDisplacement:
        """Those of a surface, with the outline of a template."""
        uv = surface.greville
        normals = surface.normals(*uv.T)
        X = surface.vector
        shifts = np.broadcast_to(np.eye(3)[:, None], (3, *X.shape))
        ways = np.concatenate([shifts, np.cross(shifts, X), X[None]])  # (7, M*N, 3)
        flat = ways.reshape(7, -1)
        weighted = flat * np.repeat(template.inside(uv), 3)
        fit = np.linalg.solve(weighted @ flat.T, weighted)
        similarity = np.einsum("cx,acx->ca", normals, ways)
        return cls(normals, similarity, fit.reshape(ways.shape))

    def covariance(self, prior: ShapePrior, uv: Array) -> tuple[Array, Array]:
        """Prior of these displacements, and their covariance with points.

        Parameters
        ----------
        prior : ShapePrior
            Of the control points in three coordinates.
        uv : (f, 2) array

        Returns
        -------
        variance : (M*N,) array
            mm^2.
        coupling : (M*N, 3 f) array
            With the displacement of the surface at ``uv``, coordinates interleaved.
        """
        T = basis_matrix(prior.shape, *np.asarray(uv, float).T)
        smooth = prior.factor.solve(T.T.toarray())
        modes = np.einsum("cx,kcx->ck", self.normals, prior.modes)
        modes -= self.similarity @ np.einsum("acx,kcx->ak", self.fit, prior.modes)
        variance = (modes**2).sum(1) + _inverse_diagonal(prior)
        coupling = np.empty((len(self.normals), T.shape[0], 3))
        for x, (n, fit) in enumerate(
            zip(self.normals.T, np.moveaxis(self.fit, 2, 0), strict=True)
        ):
            both = prior.factor.solve(fit.T)
            variance -= 2 * n * (self.similarity * both).sum(1)
            variance += ((self.similarity @ (fit @ both)) * self.similarity).sum(1)
            coupling[:, :, x] = n[:, None] * smooth - self.similarity @ (fit @ smooth)
            coupling[:, :, x] += modes @ (T @ prior.modes[:, :, x].T).T
        return variance, coupling.reshape(len(coupling), -1)


def _inverse_diagonal(prior: ShapePrior) -> Array:
    """Variance of the smooth part of each control point, ``(M*N,)``."""
    size = prior.smooth.shape[0]
    out = np.empty(size)
    for start in range(0, size, _BATCH):
        columns = np.arange(start, min(start + _BATCH, size))
        ones = np.zeros((size, len(columns)))
        ones[columns, columns - start] = 1.0
        out[columns] = prior.factor.solve(ones)[columns, columns - start]
    return out
