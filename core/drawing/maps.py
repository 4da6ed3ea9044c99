"""Maps over (u, v): the six of the paper's figure 1, residual, confidence.

All are arrays with row 0 at v = 0 (the forehead) and column 0 at u = 0.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator

from .._types import Array
from ..photometry.lighting import PhotometricEvidence
from ..surface.bspline import BSplineSurface, basis_matrix
from ..threads import one_blas_thread

#: Name -> order of the derivative by u and v.
DERIVATIVES = {
    "z": (0, 0),
    "z_u": (1, 0),
    "z_v": (0, 1),
    "z_uu": (2, 0),
    "z_vv": (0, 2),
    "z_uv": (1, 1),
}


def _centres(size: int) -> tuple[Array, Array]:
    at = (np.arange(size) + 0.5) / size
    u, v = np.meshgrid(at, at)
    return u, v


def derivative_maps(surface: BSplineSurface, size: int = 160) -> dict[str, Array]:
    """z of the surface and its partial derivatives (the paper's Fig. 1).

    Returns
    -------
    dict of (size, size) arrays
        Keys of `DERIVATIVES`; mm, per unit of u and v.
    """
    u, v = _centres(size)
    return {
        name: surface.evaluate(u, v, du=du, dv=dv)[..., 2]
        for name, (du, dv) in DERIVATIVES.items()
    }


def confidence_map(confidence: Array, size: int = 160) -> Array:
    """Standard deviation at control points spread over the surface, (size, size)."""
    u, v = _centres(size)
    shape = (confidence.shape[0], confidence.shape[1])
    weights = basis_matrix(shape, u.ravel(), v.ravel())
    return (weights @ np.asarray(confidence, float).ravel()).reshape(size, size)


# Delaunay's thousands of systems of two equations: threads only wait for each other.
@one_blas_thread()
def residual_map(
    photometric: PhotometricEvidence | None, size: int = 160
) -> Array | None:
    """Robust mean over photos of the relative intensity residual, (size, size).

    None when the evidence has no residuals; NaN outside of its samples.
    """
    if photometric is None or not np.size(photometric.residual):
        return None
    residual = photometric.residual
    # Robust weights: a cast shadow in one photo is no fault of the surface.
    weight = np.asarray(photometric.weights, float)
    total = weight.sum(axis=0)
    known = total > 0
    size_of = np.abs(np.where(weight > 0, residual, 0))
    mean = (weight * size_of).sum(axis=0) / np.maximum(total, 1e-12)
    if known.sum() < 4:
        return None
    uv = np.asarray(photometric.uv)[known]
    u, v = _centres(size)
    spread = LinearNDInterpolator(uv, mean[known])(u, v)
    # Nothing beyond the neighbourhood of a sample: eyes and mouth stay empty.
    nearest = NearestNDInterpolator(uv, np.arange(len(uv)))(u, v).astype(int)
    far = np.hypot(u - uv[nearest, 0], v - uv[nearest, 1])
    spread[far > 2.5 / np.sqrt(len(uv))] = np.nan
    return spread
