"""Light that a face casts shadow on itself from: occlusion-aware shading.

``I = rho L . Y(n)`` holds for convex bodies.  Beside the nose, in the eye sockets and
under the chin a part of the sky is hidden, so here the harmonics of the light are
integrated over the directions that a point really sees (precomputed radiance transfer,
Sloan, Kautz and Snyder, SIGGRAPH 2002):

    Y_k(j) = integral of V_j(w) max(0, n_j . w) Y_k(w) dw

which is what `harmonics.basis` is for ``V = 1``, up to a factor for each degree.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import sph_harm_y

from .._types import Array
from ..camera.camera import Camera
from ..surface.bspline import BSplineSurface
from .harmonics import even_directions
from .sampling import occluded

DIRECTIONS = 320
COVER = 111  # side of the grid of surface points that cast shadow
POINTS = 256  # that are shaded at a time
CELL = 2.5  # of the depth maps, mm: wide enough that the grid leaves no holes


@dataclass(frozen=True)
class Transfer:
    """What each point sees of the directions around the head.

    Attributes
    ----------
    directions : (d, 3) array
        Unit vectors, evenly spread.
    light : (d, k) array
        Harmonics of the light in these directions.
    visible : (p, d) float array
        1 where the face does not hide the direction.
    """

    directions: Array
    light: Array
    visible: Array

    def basis(self, normals: Array) -> Array:
        """Shading by each harmonic of the light, ``(p, k)``, for `normals` (p, 3)."""
        out = np.empty((len(normals), self.light.shape[1]))
        for rows in _parts(len(normals)):
            lit = normals[rows] @ self.directions.T
            np.maximum(lit, 0, out=lit)
            lit *= self.visible[rows]
            np.matmul(lit, self.light, out=out[rows])
        return out

    def slopes(self, normals: Array, lights: Array) -> Array:
        """Derivative of the shading by the normal, ``(n, p, 3)``, for lights (n, k)."""
        glow = (self.light @ lights.T)[:, :, None] * self.directions[:, None]
        glow = glow.reshape(len(glow), -1)
        turned = np.empty((len(normals), glow.shape[1]))
        for rows in _parts(len(normals)):
            lit = self.visible[rows] * (normals[rows] @ self.directions.T > 0)
            np.matmul(lit, glow, out=turned[rows])
        return turned.reshape(len(normals), -1, 3).transpose(1, 0, 2)


def _parts(count: int) -> Iterator[slice]:
    """Points at a time: what is made for them stays in the processor's cache."""
    return (slice(i, i + POINTS) for i in range(0, count, POINTS))


def radiance_transfer(
    surface: BSplineSurface, uv: Array, degree: int, shadows: bool = True
) -> Transfer:
    """The sky over points of a surface.

    Parameters
    ----------
    surface : BSplineSurface
    uv : (p, 2) array
    degree : int
        Of the light, which has (degree + 1)^2 harmonics.
    shadows : bool
        False leaves the surface's own shadows out.
    """
    directions = even_directions(DIRECTIONS)
    points = surface.evaluate(*uv.T)
    open_ = np.ones((len(uv), len(directions)))
    if shadows:
        cover = surface.grid(COVER, COVER).reshape(-1, 3)
        for k, R in enumerate(_facing(directions)):
            camera = Camera(R, 1.0, np.zeros(2))
            open_[:, k] = ~occluded(cover, camera, points, CELL)
    return Transfer(directions, light_basis(directions, degree), open_)


def light_basis(directions: Array, degree: int) -> Array:
    """Real spherical harmonics times the solid angle of a direction, ``(d, k)``."""
    x, y, z = directions.T
    theta, phi = np.arccos(np.clip(z, -1, 1)), np.arctan2(y, x)
    columns = []
    for n in range(degree + 1):
        for m in range(-n, n + 1):
            value = sph_harm_y(n, abs(m), theta, phi)
            part = value.imag if m < 0 else value.real
            columns.append(part * (np.sqrt(2) if m else 1.0))
    # unit shading of a full sky from in front: 1 for the constant term
    scale = 4 * np.pi / len(directions) / (np.pi * 0.2821)
    return scale * np.asarray(np.stack(columns, 1), float)


def _facing(directions: Array) -> Array:
    """Rotations (d, 3, 3) whose cameras stand in the directions (d, 3)."""
    up = np.eye(3)[np.abs(directions).argmin(axis=1)]
    x = np.cross(up, directions)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(directions, x), directions], 1)
