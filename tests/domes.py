"""A shaded dome and what cameras see of it, by formula: exact at any place."""

import functools
from dataclasses import dataclass

import numpy as np
import reference
from bsface.camera.camera import Camera
from bsface.photometry import harmonics
from bsface.surface.bspline import BSplineSurface
from joint_waves import SHAPE


class Formula:
    """A picture whose gradient is taken numerically."""

    def read(self, xy):
        slope = reference.numerical_derivative(lambda e: self.value(xy + e), 2, 1e-3)
        return self.value(xy)[:, None], slope[:, None], np.ones(len(xy), bool)

    def around(self, xy, margin):
        return self


@dataclass(frozen=True)
class PictureOfADome(Formula):
    """What a frontal camera sees of a shaded dome of one colour."""

    camera: Camera
    light: np.ndarray

    def value(self, xy):
        x, y = ((xy - self.camera.principal) / self.camera.s).T
        u, v = np.clip([(x + 70) / 140, (90 + y) / 190], 0, 1)
        return harmonics.basis(dome().normals(u, v)) @ self.light


@functools.cache
def dome():
    """x and y as on the plane, z a paraboloid: known normals, known parameters."""
    corners = {(0, 0): (-70, 90, 0), (1, 0): (140, 0, 200), (2, 0): (0, 0, -200)}
    more = {(0, 1): (0, -190, 220), (0, 2): (0, 0, -220)}
    return BSplineSurface(reference.polynomial_control_points(SHAPE, corners | more))


def bumped(surface, height):
    """The surface with a bump in its middle, too narrow to be taken for a light."""
    b = surface.control_points.copy()
    b[SHAPE[0] // 2, SHAPE[1] // 2, 2] += height
    return BSplineSurface(b)


def relief(surface, truth, uv):
    """Size of what is left of the error in z without its smooth part, mm.

    Photos leave a smooth part open: it belongs to cameras, lights and albedo.
    """
    error = (surface.evaluate(*uv.T) - truth.evaluate(*uv.T))[:, 2]
    u, v = uv.T
    smooth = np.stack([u**i * v**j for i in range(4) for j in range(4 - i)], 1)
    rest = error - smooth @ np.linalg.lstsq(smooth, error, rcond=None)[0]
    return np.sqrt((rest**2).mean())
