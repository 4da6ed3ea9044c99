"""The unknowns of the joint refinement, and how a step changes them.

The face is a reference surface plus a displacement of its control points along fixed
directions, the reference's normals: ``b = b_0 + (d + D a) n`` with the smooth part
``d`` and the coefficients ``a`` of the prior's modes.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..._types import Array
from ...camera.camera import PARAMETERS, Camera
from ...problem import FaceEstimate, Problem
from ...surface.bspline import BSplineSurface
from ...surface.prior import ShapePrior
from ...surface.template import Template


@dataclass(frozen=True, eq=False)
class DisplacementModel:
    """The face as a function of a displacement along the normals of a reference.

    Attributes
    ----------
    template : Template
    prior : ShapePrior
        Of the whole displacement from the template.
    reference : BSplineSurface
    directions : (M*N, 3) array
        In which control points move: normals of the reference at their Greville
        abscissae.
    D : (M*N, k) array
        Displacement by the prior's modes.
    smooth, modes : (M*N,), (k,) arrays
        What the reference has of the two parts already, counted from the template.
    expression_modes : (e, M, N, 3) array
        Displacement of the control points by each expression; e = 0 if all photos show
        the same.
    expressions : (n, e) array
        Coefficients that the photos start with.
    """

    template: Template
    prior: ShapePrior
    reference: BSplineSurface
    directions: Array
    D: Array
    smooth: Array
    modes: Array
    expression_modes: Array
    expressions: Array

    @classmethod
    def about(cls, problem: Problem, estimate: FaceEstimate) -> DisplacementModel:
        """The model whose reference is the surface of an estimate."""
        reference, prior = estimate.surface, problem.prior
        directions = reference.normals(*reference.greville.T)
        e = estimate.expressions
        e = e if e.any() else e[:, :0]
        return cls(
            problem.template,
            prior,
            reference,
            directions,
            np.einsum("kbx,bx->bk", prior.modes, directions),
            (estimate.smooth * directions).sum(1),
            estimate.modes,
            problem.template.expression_modes[: e.shape[1]],
            e,
        )

    def surface(self, displacement: Array) -> BSplineSurface:
        """The surface displaced by ``(M*N,)`` millimetres."""
        moved = displacement[:, None] * self.directions
        moved = moved.reshape(*self.reference.shape, 3)
        return BSplineSurface(self.reference.control_points + moved)

    @property
    def mixed(self) -> bool:
        """Whether the photos differ in expression."""
        return len(self.expression_modes) > 0


class Step(NamedTuple):
    """A Gauss-Newton step.

    Attributes
    ----------
    smooth, modes : (M*N,), (k,) arrays
        Of the smooth displacement, mm, and of the coefficients of the modes.
    photos : (n, 7 + e + q) array
        Of the camera (`Camera.moved`), the expression and the light of each photo.
    """

    smooth: Array
    modes: Array
    photos: Array


@dataclass(frozen=True, eq=False)
class State:
    """The unknowns.

    Attributes
    ----------
    model : DisplacementModel
    smooth, modes : (M*N,), (k,) arrays
        Counted from the reference of the model.
    cameras : tuple of n Camera
    expressions : (n, e) array
        Of the photos.
    lights : (n, q) array
        Harmonics of the light of each photo; zero while nothing is known.
    albedo : (p,) array
        At the samples of the level; empty before the first.
    """

    model: DisplacementModel
    smooth: Array
    modes: Array
    cameras: tuple[Camera, ...]
    expressions: Array
    lights: Array
    albedo: Array = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def start(cls, model: DisplacementModel, cameras: tuple[Camera, ...]) -> State:
        """The reference itself, with lights that are not known yet."""
        return cls(
            model,
            np.zeros(len(model.D)),
            np.zeros(model.D.shape[1]),
            tuple(cameras),
            model.expressions,
            np.zeros((len(cameras), 0)),
        )

    @property
    def displacement(self) -> Array:
        """Of the control points along their directions, mm, ``(M*N,)``."""
        return self.smooth + self.model.D @ self.modes

    @cached_property
    def surface(self) -> BSplineSurface:
        """The face."""
        return self.model.surface(self.displacement)

    @property
    def faces(self) -> BSplineSurface | list[BSplineSurface]:
        """The face as it is in each photo; itself if all photos share it."""
        if not self.model.mixed:
            return self.surface
        b = self.surface.control_points
        moved = np.tensordot(self.expressions, self.model.expression_modes, 1)
        return [BSplineSurface(b + e) for e in moved]

    @property
    def motions(self) -> int:
        """Number of parameters of a photo's camera and expression, 7 + e."""
        return PARAMETERS + self.expressions.shape[1]

    def at_level(self, samples: int, degree: int) -> State:
        """The same face with lights of a degree, and nothing known of the albedo."""
        more = max((degree + 1) ** 2 - self.lights.shape[1], 0)
        lights = np.pad(self.lights, ((0, 0), (0, more)))
        return replace(self, lights=lights, albedo=np.ones(samples))

    def retract(self, step: Step, damping: float = 1.0) -> State:
        """The state after a step, or after a part of it.

        Parameters of the photos that the step leaves out stay as they are.
        """
        k = self.motions
        missing = k + self.lights.shape[1] - step.photos.shape[1]
        photos = np.pad(damping * step.photos, ((0, 0), (0, missing)))
        cameras = tuple(
            camera.moved(y)
            for camera, y in zip(self.cameras, photos[:, :PARAMETERS], strict=True)
        )
        return replace(
            self,
            smooth=self.smooth + damping * step.smooth,
            modes=self.modes + damping * step.modes,
            cameras=cameras,
            expressions=self.expressions + photos[:, PARAMETERS:k],
            lights=self.lights + photos[:, k:],
        )
