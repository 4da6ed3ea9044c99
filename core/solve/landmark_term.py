"""Reprojection of landmarks, linearised and robust: one term for all solvers.

A landmark counts by the detector's confidence, by how far its place on the face is
turned to the camera, and by a Cauchy weight of its residual.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._types import Array
from ..camera.camera import Camera

#: Scale of the Cauchy weight, in standard deviations.
ROBUST = 3.0
# Cosine of the viewing angle at which a landmark starts to count, and the width of the
# rise to full weight.
_GRAZING, _RISE = 0.1, 0.3


class LandmarkRows(NamedTuple):
    """Linearised residuals of the landmarks of one photo, mm at the head.

    Attributes
    ----------
    residual : (f, 2) array
        Observed minus projected.
    by_point : (f, 2, 3) array
        Derivative of the projection by the 3D point.
    by_camera : (f, 2, 7) array
        Derivative of the projection by the parameters of `Camera.moved`.
    weight : (f,) array
        Robust inverse variance, 1/mm^2.
    """

    residual: Array
    by_point: Array
    by_camera: Array
    weight: Array

    @property
    def distance(self) -> Array:
        """Length of each residual, mm, ``(f,)``."""
        return np.sqrt((self.residual**2).sum(1))


def facing_weight(camera: Camera, points: Array, normals: Array) -> Array:
    """0 for points (f, 3) turned away from the camera, 1 for those turned to it."""
    cosine = (camera.toward(points) * normals).sum(1)
    return np.clip((cosine - _GRAZING) / _RISE, 0, 1)


def landmark_rows(
    camera: Camera,
    points: Array,
    pixels: Array,
    weight: Array,
    sigma: Array | float,
) -> LandmarkRows:
    """Rows of the landmarks of one photo.

    Parameters
    ----------
    camera : Camera
    points : (f, 3) array
        Where the landmarks are, in the axes of the head, mm.
    pixels : (f, 2) array
        Where they were seen.
    weight : (f,) array
        Of each landmark, `facing_weight` included.
    sigma : (f,) array or float
        Standard deviation of a landmark, mm.
    """
    projected, J, C = camera.jacobians(points)
    r = (pixels - projected) / camera.s
    w = weight / sigma**2
    w = w / (1 + (r**2).sum(1) / (ROBUST * sigma) ** 2)
    return LandmarkRows(r, J / camera.s, C / camera.s, w)
