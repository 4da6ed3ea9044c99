"""Going on from a surface that a person has edited.

The edited net becomes the template ``b_t`` of the next run, and control points that the
person placed can be held: softly, as observations with a standard deviation, or hard.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from ..surface.bending import bending_matrix, mass_matrix
from ..surface.bspline import BSplineSurface, basis_matrix
from ..surface.template import Template
from .frame import eye_centres, fit_similarity

Array = NDArray[np.float64]

#: Standard deviation of a point that is held hard, mm.
HARD_MM = 1e-3


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
    weight = held.ravel() / max(softness_mm, HARD_MM) ** 2
    r = (np.asarray(target, float) - surface.control_points).reshape(-1, 3)
    A = Q * (variance / smooth_mm**2) + sparse.diags_array(weight)
    d = splu(sparse.csc_array(A)).solve(weight[:, None] * r)
    return BSplineSurface(surface.control_points + d.reshape(*shape, 3))
