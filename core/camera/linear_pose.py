"""Pose from landmarks by a linear fit and an SVD (section 2.3.1).

``q = s R Q + t``: the best affine map of the 3D points to the picture is a linear least
squares problem; the nearest scaled rotation to its 2 x 3 matrix ``A = U diag(d) V^T``
is ``R = U V^T`` (two rows, the third is their cross product) with ``s = mean(d)``.  It
needs no start and no iteration, and is exact for exact data.  Perspective is not
modelled: the cameras that come out have ``kappa = 0``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .._types import Array
from ..errors import PhotoFailure
from .camera import Camera

# An affine map has 8 unknowns, so 4 points; one more makes a residual.
MINIMUM_POINTS = 5
# Points whose smallest extent is below this part of the largest count as a plane, of
# which two poses have the same picture.
FLATNESS_LIMIT = 1e-3
# Standard deviation, in pixels, below which all landmarks are at one place.
EXTENT_LIMIT_PX = 0.1


def linear_pose(
    q: Array,
    Q: Array,
    weights: Array | None = None,
    principal: Sequence[float] = (0.0, 0.0),
    name: str = "photo",
) -> Camera | PhotoFailure:
    """Scaled orthographic camera that sees ``Q`` at ``q``.

    Parameters
    ----------
    q : (f, 2) array
        Landmarks, pixels of the original photo, y down; rows that are not finite are
        left out.
    Q : (f, 3) array
        The same points on the head, mm.
    weights : (f,) array, optional
        Weight of each point, 0 leaves it out.
    principal : (2,)
        Principal point in pixels; ``t`` of the camera counts from there.
    name : str
        The photo, for the sentence of a failure.

    Returns
    -------
    Camera or PhotoFailure
        The falsy failure when fewer than `MINIMUM_POINTS` points are there or they lie
        in a plane.
    """
    q, Q = np.asarray(q, float), np.asarray(Q, float)
    w = np.ones(len(q)) if weights is None else np.array(weights, float)
    w = np.where(np.isfinite(q).all(1) & np.isfinite(Q).all(1), w, 0.0)
    used = w > 0
    if used.sum() < MINIMUM_POINTS:
        return PhotoFailure(
            name,
            "implausible",
            f"{name}: only {int(used.sum())} landmarks are usable and a pose needs "
            f"{MINIMUM_POINTS}; mark more of them or leave the photo out.",
        )
    q, Q, w = q[used], Q[used], w[used] / w[used].sum()
    q_mean, Q_mean = w @ q, w @ Q
    root = np.sqrt(w)[:, None]
    # y up, as in the camera's axes.
    left = root * (Q - Q_mean)
    right = root * (q - q_mean) * np.array([1.0, -1.0])
    extent = np.linalg.svd(left, compute_uv=False)
    if extent[2] < FLATNESS_LIMIT * extent[0]:
        return PhotoFailure(
            name,
            "implausible",
            f"{name}: the usable landmarks lie in a plane, which leaves the pose open; "
            "mark landmarks of several parts of the face.",
        )
    affine = np.linalg.lstsq(left, right, rcond=None)[0].T
    U, d, Vt = np.linalg.svd(affine, full_matrices=False)
    two = U @ Vt
    R = np.vstack([two, np.cross(two[0], two[1])])
    s = float(d.mean())
    if s * extent[0] < EXTENT_LIMIT_PX:
        return PhotoFailure(
            name,
            "implausible",
            f"{name}: all landmarks are at one place; mark them again.",
        )
    t = q_mean - s * np.array([1.0, -1.0]) * (two @ Q_mean)
    principal_xy = np.asarray(principal, float)
    return Camera(R=R, s=s, t=t - principal_xy, principal=principal_xy)
