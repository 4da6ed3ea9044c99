"""Expressions: their displacement of the face, and which one the result has.

Motion gives every photo its own mixture of expression modes.  Where the photos agree,
that mixture is detection noise, and what they share is part of the shape.  Where they
differ, the result is the neutral face: the mean of the photos with the least
expression.  The other photos are seen through their own deformation, and count the less
the larger it is.  The joint refinement measures the expressions again, by the
intensities, and the neutral face is then taken anew.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .._types import Array
from ..problem import FaceEstimate, Problem
from ..surface.alignment import fit_similarity
from ..surface.bspline import BSplineSurface, basis_matrix
from ..surface.template import Template

#: Photos differ in expression if a tenth of them moves the landmarks by more than this
#: (root mean square, mm) against the median; detection noise alone stays below 1.8.
MIXED_MM = 2.2
#: Only photos that see the face within this angle say so, if there are enough of them:
#: of turned faces the landmarks are noisier.
FRONTAL_DEGREES, FEWEST_FRONTAL = 25.0, 5
NEUTRAL_SHARE = 0.25
TRUSTED_MM = 1.5  #: deformation at which a photo counts half
#: Distance at which a point of another expression counts half when faces are aligned.
STILL_MM = 1.0
#: Standard deviation of what two fits of the same face differ by, mm.
DRIFT_MM = 0.5
ROUNDS = 30


def expression_offsets(template: Template, uv: Array, count: int) -> Array:
    """Displacement of surface points by the first expression modes.

    Parameters
    ----------
    template : Template
    uv : (p, 2) array
    count : int
        Number of modes.

    Returns
    -------
    (p, 3, count) array
        mm per standard deviation.
    """
    T = basis_matrix(template.surface.shape, *uv.T)
    offsets = [T @ mode.reshape(-1, 3) for mode in template.expression_modes[:count]]
    return np.stack(offsets, -1) if offsets else np.zeros((len(uv), 3, 0))


def expression_displacements(
    template: Template, expressions: Array, size: float = 1.0
) -> Array:
    """Displacement of the control points in each photo, ``(n, M, N, 3)``.

    Parameters
    ----------
    template : Template
    expressions : (n, k) array
        Coefficients of the first k modes.
    size : float
        How much larger than the template the face is.
    """
    modes = size * template.expression_modes[: expressions.shape[1]]
    return np.einsum("ik,kuvx->iuvx", expressions, modes)


def select_neutral(problem: Problem, estimate: FaceEstimate) -> FaceEstimate:
    """The estimate of the motion stage with the expression that the result has.

    Expressions are zero where the photos share theirs; otherwise they are relative to
    the neutral face.
    """
    e = estimate.expressions
    shared = replace(estimate, expressions=np.zeros_like(e))
    if len(e) < 3 or e.shape[1] == 0:
        return shared
    away = _Size(problem, e.shape[1])(e - np.median(e, 0))
    turned = [camera.yaw_pitch_roll[:2] for camera in estimate.cameras]
    frontal = np.linalg.norm(turned, axis=1) < FRONTAL_DEGREES
    if frontal.sum() >= FEWEST_FRONTAL:
        away = away[frontal]
    if np.quantile(away, 0.9) < MIXED_MM:
        return shared
    return move_to_neutral(problem, estimate)


def move_to_neutral(problem: Problem, estimate: FaceEstimate) -> FaceEstimate:
    """The estimate moved to the neutral face, its expressions relative to that.

    `photo_weights` say how neutral each photo is.  Nothing changes if no photo has an
    expression.
    """
    e = estimate.expressions
    n, k = e.shape
    if not e.any():
        return estimate
    size, scale = _Size(problem, k), problem.prior.expression_scale
    shared = estimate.modes[len(estimate.modes) - k :] * scale
    order = np.argsort(size(e + shared))
    neutral = e[order[: max(2, round(NEUTRAL_SHARE * n))]].mean(0)
    away = e - neutral
    (change,) = expression_displacements(problem.template, neutral[None])
    modes = estimate.modes.copy()
    if scale > 0:
        modes[len(modes) - k :] += neutral / scale
    return replace(
        estimate,
        surface=BSplineSurface(estimate.surface.control_points + change),
        landmarks_xyz=estimate.landmarks_xyz + size.offsets @ neutral,
        expressions=away,
        modes=modes,
        photo_weights=1 / (1 + (size(away) / TRUSTED_MM) ** 2),
    )


class _Size:
    """Root mean square displacement of the landmarks by k expression modes."""

    def __init__(self, problem: Problem, k: int) -> None:
        self.offsets = expression_offsets(problem.template, problem.landmarks.uv, k)
        gram = np.einsum("lxj,lxk->jk", self.offsets, self.offsets)
        self._gram = gram / len(self.offsets)

    def __call__(self, e: Array) -> Array:
        """mm, ``(n,)``, for coefficients (n, k)."""
        squares = np.einsum("ij,jk,ik->i", e, self._gram, e)
        return np.sqrt(np.maximum(squares, 0))


def expression_of(
    surface: BSplineSurface, neutral: BSplineSurface, template: Template
) -> Array:
    """The part of the way from a neutral face to another fit that is expression.

    Two fits of one person differ in size, place and by their errors too. The similarity
    in which most of one face lies on the other is taken out, by reweighting with Cauchy
    weights; of the rest each control point keeps the part ``v / (v + s^2)``, where
    ``v`` is the variance of the template's expressions there and ``s`` that of the
    errors, `DRIFT_MM`: forehead and rim stay where they are.

    Parameters
    ----------
    surface, neutral : BSplineSurface
        With the same net.
    template : Template
        Gives the expression modes; any net.

    Returns
    -------
    (M, N, 3) array
        Displacement of the control points of ``neutral``.
    """
    if surface.shape != neutral.shape:
        raise ValueError(
            f"the nets must have the same size, got {surface.shape} and {neutral.shape}"
        )
    source, target = surface.vector, neutral.vector
    place = fit_similarity(source, target)
    for _ in range(ROUNDS):
        away = np.linalg.norm(place(source) - target, axis=1)
        # From the median down to the final width, or a far start never settles.
        width = max(STILL_MM, float(np.median(away)))
        place = fit_similarity(source, target, 1 / (1 + (away / width) ** 2))
    variance = _expression_variance(template, neutral)
    share = variance / (variance + DRIFT_MM**2)
    return share[..., None] * (place(source) - target).reshape(*neutral.shape, 3)


def _expression_variance(template: Template, surface: BSplineSurface) -> Array:
    """Variance of the expressions where each control point acts, mm^2, ``(M, N)``."""
    # The outermost control points act on the border.
    count = len(template.expression_modes)
    offsets = expression_offsets(template, surface.greville, count)
    return (offsets**2).sum((1, 2)).reshape(surface.shape)
