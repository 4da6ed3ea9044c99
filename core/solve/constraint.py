"""Going on from a surface that a person has edited.

The edited net becomes the template ``b_t`` of the next run, and control points that the
person placed can be held: softly, as observations with a standard deviation, or hard.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from ..surface.bending import bending_matrix, mass_matrix
from ..surface.bspline import BSplineSurface, basis_matrix
from ..surface.template import Template
from .alignment import eye_centres, fit_similarity

Array = NDArray[np.float64]

#: Standard deviation of a point that is held hard, mm.
HARD_MM = 1e-3
#: Distance at which a point of another expression counts half when faces are aligned.
STILL_MM = 1.0
#: Standard deviation of what two fits of the same face differ by, mm.
DRIFT_MM = 0.5
ROUNDS = 30


@dataclass(frozen=True)
class Constraint:
    """Control points of the template that a run has to keep.

    Attributes
    ----------
    points : (M, N) bool array
        Of the template's net.
    softness_mm : float
        Standard deviation of their places; 0 holds them hard.
    """

    points: NDArray[np.bool_]
    softness_mm: float = 0.0

    @property
    def weight(self) -> Array:
        """Inverse variance of each control point, 1/mm^2, ``(M*N,)``; 0 = free."""
        return self.points.ravel() / max(self.softness_mm, HARD_MM) ** 2


def edited_template(surface: BSplineSurface, base: Template) -> Template:
    """The template with an edited face in place of its own.

    The face is brought to the size and place of the template by its landmarks; the
    free landmark points keep their offset from the surface.

    Parameters
    ----------
    surface : BSplineSurface
        A result, edited; any size of net.
    base : Template
        Gives everything else; resampled to the net of ``surface``.
    """
    base = base.resampled(surface.shape)
    uv = base.landmark_uv
    there = base.surface.evaluate(*uv.T)
    sure = base.landmark_reliable
    place = fit_similarity(surface.evaluate(*uv[sure].T), there[sure])
    moved = surface.transformed(place.scale, place.R, place.t)
    return replace(
        base,
        surface=moved,
        landmark_xyz=base.landmark_xyz + moved.evaluate(*uv.T) - there,
        eye_centres=eye_centres(moved, base),
    )


def hold(
    surface: BSplineSurface,
    target: ArrayLike,
    held: ArrayLike,
    softness_mm: float = 0.0,
    smooth_mm: float = 1.0,
    smooth_length: float = 0.12,
) -> BSplineSurface:
    """The surface moved smoothly so that some control points are where they belong.

    The displacement ``d`` has the smooth prior of the shape (`surface.prior`) and is
    observed at the held points: ``(Q + D / s^2) d = D r / s^2``, with ``D`` their
    selection, ``r`` the way to their targets and ``s`` the softness.

    Parameters
    ----------
    surface : BSplineSurface
    target : (M, N, 3) array
        Where the control points belong, mm; only the held ones count.
    held : (M, N) bool array
    softness_mm : float
        Standard deviation of the held points; 0 holds them hard.
    smooth_mm, smooth_length : float
        Standard deviation and correlation length of the displacement, as in `Settings`.
    """
    held = np.asarray(held, bool)
    if held.shape != surface.shape or np.shape(target) != (*surface.shape, 3):
        raise ValueError(
            f"held points must have the shape of the net {surface.shape}, got "
            f"{held.shape} and {np.shape(target)}"
        )
    if not held.any():
        return surface
    shape = surface.shape
    Q = bending_matrix(shape) + smooth_length**-4 * mass_matrix(shape)
    middle = basis_matrix(shape, [0.5], [0.5]).toarray()[0]
    variance = middle @ splu(sparse.csc_array(Q)).solve(middle)
    weight = Constraint(held, softness_mm).weight
    r = (np.asarray(target, float) - surface.control_points).reshape(-1, 3)
    A = Q * (variance / smooth_mm**2) + sparse.diags_array(weight)
    d = splu(sparse.csc_array(A)).solve(weight[:, None] * r)
    return BSplineSurface(surface.control_points + d.reshape(*shape, 3))


def expression_of(
    surface: BSplineSurface, neutral: BSplineSurface, template: Template
) -> Array:
    """What of the way from a calm face to another fit of it is expression.

    Two fits of one person differ in size, place and by their errors too. The similarity
    in which most of one face lies on the other is taken out, by reweighting with Cauchy
    weights; of the rest each control point keeps the part ``v / (v + s^2)``, where
    ``v`` is the variance of the template's expressions there and ``s`` that of the
    errors, `DRIFT_MM`: forehead and rim stay where they are.

    Parameters
    ----------
    surface, calm : BSplineSurface
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
    variance = _expression_variance(template, neutral.shape)
    share = variance / (variance + DRIFT_MM**2)
    return share[..., None] * (place(source) - target).reshape(*neutral.shape, 3)


def _expression_variance(template: Template, shape: tuple[int, int]) -> Array:
    """Variance of the expressions where each control point of a net acts, mm^2."""
    # The outermost control points act on the border.
    u, v = (np.clip((np.arange(n) - 1) / (n - 3), 0, 1) for n in shape)
    at = np.stack(np.meshgrid(u, v, indexing="ij"), -1).reshape(-1, 2)
    T = basis_matrix(template.surface.shape, *at.T)
    found = np.zeros(len(at))
    for mode in template.expression_modes:
        found += ((T @ mode.reshape(-1, 3)) ** 2).sum(1)
    return found.reshape(shape)
