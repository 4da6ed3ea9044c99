"""Which expression the result has when the photos do not share one.

The bundle adjustment gives every photo its own mixture of expression modes.  Where the
photos agree, that mixture is detection noise, and what they share is part of the shape.
Where they differ, the result is the calm face: the mean of the photos with the least
expression; the other photos are seen through their own deformation, and count the less
the larger it is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..surface.bspline import BSplineSurface, basis_matrix
from ..surface.template import Template
from .motion import Bundle, LandmarkObservations

Array = NDArray[np.float64]

#: Photos differ in expression if a tenth of them moves the landmarks by more than this
#: (root mean square, mm) against the median; detection noise alone stays below 1.6.
MIXED_MM = 2.5
CALM_SHARE = 0.25
TRUSTED_MM = 1.5  #: deformation at which a photo counts half


def select_neutral(
    bundle: Bundle, template: Template, seen: LandmarkObservations
) -> tuple[Bundle, Array]:
    """Decide on rigid or mixed expressions.

    Parameters
    ----------
    bundle : Bundle
    template : Template
    seen : Observations

    Returns
    -------
    bundle : Bundle
        ``expressions`` relative to its surface: zero for photos that share their
        expression, otherwise the deviation from the calm face.
    weights : (n,) array
        Of the photos, 1 = calm.
    """
    e = bundle.expressions
    n, k = e.shape
    if n < 3 or k == 0:
        return replace(bundle, expressions=np.zeros_like(e)), np.ones(n)
    modes = template.expression_modes[:k].reshape(k, -1, 3)
    expression_offsets = landmark_expression_offsets(template, seen, k)
    gram = np.einsum("lxj,lxk->jk", expression_offsets, expression_offsets) / len(
        expression_offsets
    )
    size = lambda x: np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", x, gram, x), 0))  # noqa: E731
    if np.quantile(size(e - np.median(e, 0)), 0.9) < MIXED_MM:
        return replace(bundle, expressions=np.zeros_like(e)), np.ones(n)
    shared = bundle.modes[len(bundle.modes) - k :] * bundle.expression_scale
    neutral = np.argsort(size(e + shared))[: max(2, round(CALM_SHARE * n))]
    rest = e[neutral].mean(0)
    away = e - rest
    change = np.einsum("k,kbx->bx", rest, modes)
    surface = BSplineSurface(
        bundle.surface.control_points + change.reshape(*bundle.surface.shape, 3)
    )
    weights = 1 / (1 + (size(away) / TRUSTED_MM) ** 2)
    moved = replace(
        bundle,
        surface=surface,
        structure=bundle.structure + expression_offsets @ rest,
        expressions=away,
    )
    if bundle.expression_scale > 0:
        coefficients = bundle.modes.copy()
        coefficients[len(coefficients) - k :] += rest / bundle.expression_scale
        moved = replace(moved, modes=coefficients)
    return moved, weights


def landmark_expression_offsets(
    template: Template, seen: LandmarkObservations, count: int
) -> Array:
    """Displacement of each landmark by the first expression modes, (f, 3, count)."""
    T = basis_matrix(template.surface.shape, *template.landmark_uv[seen.index].T)
    modes = template.expression_modes[:count].reshape(count, T.shape[1], 3)
    return np.einsum("lb,kbx->lxk", T.toarray(), modes)
