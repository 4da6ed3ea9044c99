"""What the joint system holds besides the intensities and the prior of the shape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from ..._types import Array
from ...camera.camera import PARAMETERS
from ...camera.prior import CameraPrior
from ...landmarks.observations import LandmarkObservations
from ...problem import Constraint, FaceEstimate, Problem
from ...surface.bspline import basis_matrix
from ..landmark_term import facing_weight, landmark_rows
from .options import JointOptions
from .state import DisplacementModel
from .system import BorderedSystem, Term

CAMERA = slice(PARAMETERS)


@dataclass(frozen=True, eq=False)
class LandmarkTerm:
    """Reprojection of the landmarks, which move with the surface.

    Attributes
    ----------
    observations : LandmarkObservations
    offset : (f, 3) array
        From the surface point to the landmark, mm.
    expressions : (f, 3, e) array
        Displacement of the landmarks by each expression mode, mm.
    T : (f, M*N) sparse array
        Basis at the surface points.
    sigma : float
        Standard deviation of a landmark, mm.
    weight : float
        Of the whole term.
    """

    observations: LandmarkObservations
    offset: Array
    expressions: Array
    T: sparse.csr_array
    sigma: float
    weight: float

    def add_to(self, system: BorderedSystem) -> None:
        """Add the reprojection in all photos."""
        state, seen = system.state, self.observations
        surface = state.surface
        X, normals = surface.evaluate(*seen.uv.T), surface.normals(*seen.uv.T)
        along = self.T @ state.model.directions
        upright = sparse.csr_array(self.T.T)
        total, right = np.zeros(len(X)), np.zeros(len(X))
        for i, camera in enumerate(state.cameras):
            weight = self.weight * seen.weight[i] * facing_weight(camera, X, normals)
            Q = X + self.offset + self.expressions @ state.expressions[i]
            r, J, C, w = landmark_rows(camera, Q, seen.pixels[i], weight, self.sigma)
            C = np.concatenate([C, J @ self.expressions], 2)
            J = np.einsum("lxa,la->lx", J, along)
            total += w * (J**2).sum(1)
            right += w * (J * r).sum(1)
            both = w[:, None] * np.einsum("lx,lxa->la", J, C)
            system.add_coupling(i, upright @ both)
            system.add_photo(
                i,
                slice(state.motions),
                np.einsum("lxa,l,lxb->ab", C, w, C),
                np.einsum("lxa,l,lx->a", C, w, r),
            )
        system.add_displacement(
            upright @ sparse.diags_array(total) @ self.T, upright @ right
        )


@dataclass(frozen=True)
class CameraTerm:
    """What is known of the cameras beforehand.

    Attributes
    ----------
    prior : CameraPrior
    focal_px : sequence of n float or None
        Focal length of each photo, pixels; None where it is not known.
    """

    prior: CameraPrior
    focal_px: Sequence[float | None]

    def add_to(self, system: BorderedSystem) -> None:
        """Add the prior of all cameras."""
        for i, camera in enumerate(system.state.cameras):
            known = self.prior.of_photo(self.focal_px[i])
            system.add_photo(i, CAMERA, known.precision(), known.pull(camera))


@dataclass(frozen=True)
class ExpressionTerm:
    """What the motion estimate knows of the expressions.

    Attributes
    ----------
    spread : float
        Standard deviation of a coefficient about its start.
    """

    spread: float

    def add_to(self, system: BorderedSystem) -> None:
        """Add the pull of all expressions."""
        state = system.state
        away = state.model.expressions - state.expressions
        which = slice(PARAMETERS, state.motions)
        for i in range(len(away)):
            precision = np.eye(away.shape[1]) / self.spread**2
            system.add_photo(i, which, precision, away[i] / self.spread**2)


@dataclass(frozen=True)
class LightDamping:
    """A pull of each light to what it is.

    Attributes
    ----------
    precision : float
        Of the step of a coefficient.
    """

    precision: float

    def add_to(self, system: BorderedSystem) -> None:
        """Add the pull of all lights."""
        n, count = system.state.lights.shape
        for i in range(n):
            pull = self.precision * np.eye(count)
            lights = slice(system.state.motions, None)
            system.add_photo(i, lights, pull, np.zeros(count))


@dataclass(frozen=True, eq=False)
class ConstraintTerm:
    """Control points that belong where the template has them.

    Attributes
    ----------
    precision : (M*N,) array
        Inverse variance of their displacement, 1/mm^2; 0 for free ones.
    home : (M*N,) array
        Displacement from the reference that brings them there, mm.
    """

    precision: Array
    home: Array

    @classmethod
    def of(cls, constraint: Constraint, model: DisplacementModel) -> ConstraintTerm:
        """The term of a constraint."""
        away = model.template.surface.vector - model.reference.vector
        return cls(constraint.precision, (away * model.directions).sum(1))

    def add_to(self, system: BorderedSystem) -> None:
        """Add the pull of all held points."""
        away = self.home - system.state.displacement
        precision = sparse.csr_array(sparse.diags_array(self.precision))
        system.add_displacement(precision, self.precision * away)


def default_terms(
    problem: Problem,
    estimate: FaceEstimate,
    model: DisplacementModel,
    options: JointOptions,
) -> list[Term]:
    """Landmarks, cameras, lights and held points of a problem.

    The landmarks keep the offset from the surface that they have in ``estimate``.
    """
    seen = problem.landmarks
    T = basis_matrix(estimate.surface.shape, *seen.uv.T)
    offset = estimate.landmarks_xyz - estimate.surface.evaluate(*seen.uv.T)
    modes = [T @ mode.reshape(-1, 3) for mode in model.expression_modes]
    expressions = np.stack(modes, -1) if modes else np.zeros((*offset.shape, 0))
    prior = CameraPrior(
        options.distance_mm, options.distance_spread, options.camera_damping
    )
    terms: list[Term] = [
        LandmarkTerm(
            seen,
            offset,
            expressions,
            T,
            options.landmark_mm,
            options.landmark_weight,
        ),
        CameraTerm(prior, seen.focal_px),
        ExpressionTerm(options.expression_spread),
        LightDamping(options.light_damping),
    ]
    if problem.constraint is not None:
        terms.append(ConstraintTerm.of(problem.constraint, model))
    return terms
