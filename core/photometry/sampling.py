"""Photos resampled on the surface: the matrix ``M`` (n x p) and what each photo sees.

Section 2.2.1 clips the photos to a frontal view; here they are read at the projections
of surface points ``F(u_j, v_j)``, with the surface's own self-occlusion, and with the
derivative of the intensity, which the joint refinement needs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from .._types import Array
from ..camera.camera import Camera
from ..images.photo import Photo, Window, pixels_in
from ..images.remap import interpolate
from ..surface.bspline import BSplineSurface, basis_matrix, unit_normals

#: A point is hidden when another part of the surface is this much nearer, mm.
DEPTH_MARGIN = 4.0
CELL = 1.5  # side of a depth cell, mm
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
_NEIGHBOURS = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]], float)


@dataclass(frozen=True)
class IntensityField:
    """A smoothed photo that can be read anywhere.

    Attributes
    ----------
    maps : (h, w, c) float32 array
        Linear intensity of the channels.
    window : Window
        In the original photo.
    """

    maps: NDArray[np.float32]
    window: Window

    def around(self, xy: Array, margin: float) -> IntensityField:
        """The part about places (p, 2), with a margin; pixels of the original."""
        low, high = xy.min(0) - margin, xy.max(0) + margin
        h, w, _ = self.maps.shape
        corners = pixels_in(self.window, np.stack([low, high]))
        x0, y0 = np.clip(np.floor(corners[0]), 0, (w - 1, h - 1)).astype(int)
        x1, y1 = np.clip(np.ceil(corners[1]) + 1, (x0 + 1, y0 + 1), (w, h)).astype(int)
        left, top, scale = self.window
        window = (left + x0 / scale, top + y0 / scale, scale)
        return IntensityField(self.maps[y0:y1, x0:x1].copy(), window)

    def read(self, xy: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Intensity, gradient and whether the photo covers the place.

        Parameters
        ----------
        xy : (p, 2) array
            Pixels of the original photo.

        Returns
        -------
        value : (p, c) array
        gradient : (p, c, 2) array
            Per pixel of the original.
        inside : (p,) bool array
        """
        at = pixels_in(self.window, xy)
        h, w, _ = self.maps.shape
        inside = ((at > 0.5) & (at < (w - 1.5, h - 1.5))).all(1)
        # Differences of neighbours, as a picture of the slopes would hold them; that
        # would take twice the memory of the intensity.
        found = interpolate(self.maps, at + _NEIGHBOURS[:, None])
        across = np.stack([found[1] - found[2], found[3] - found[4]], -1)
        return found[0], self.window[2] / 2 * across, inside


def smooth_photo(
    photo: Photo, camera: Camera, blur_mm: float, colour: bool = False
) -> IntensityField:
    """Photo smoothed by a Gaussian of ``blur_mm`` at the head, as linear intensity.

    Parameters
    ----------
    photo : Photo
    camera : Camera
        Its `s` says how many pixels a millimetre has.
    blur_mm : float
        Standard deviation of the Gaussian.
    colour : bool
        Three channels instead of the luminance.
    """
    image = photo.linear()
    if not colour:
        image = (image @ LUMINANCE)[..., None]
    x0, y0, scale = photo.window
    sigma = blur_mm * camera.s * scale
    shrink = int(min(sigma / 1.5, min(image.shape[:2]) / 2))
    if shrink > 1:
        # With dsize empty both axes shrink by exactly this factor; a size would be
        # rounded and shift the picture by up to half a pixel of the small one.
        small = cv2.resize(
            image, None, fx=1 / shrink, fy=1 / shrink, interpolation=cv2.INTER_AREA
        )
        image = small.reshape(*small.shape[:2], -1)
        scale, sigma = scale / shrink, sigma / shrink
    if sigma > 0.3:
        image = cv2.GaussianBlur(image, (0, 0), sigma).reshape(image.shape)
    return IntensityField(image.astype(np.float32), (x0, y0, scale))


def occluded(
    cover: Array, camera: Camera, points: Array, cell_mm: float = CELL
) -> NDArray[np.bool_]:
    """Which of ``points`` (p, 3) a surface hides from the camera, ``(p,)``.

    A depth map is filled by ``cover``, dense points of the surface, (c, 3); a point is
    hidden if its cell holds something nearer by more than `DEPTH_MARGIN`.
    """
    cell = cell_mm * camera.s
    both = points if points is cover else np.concatenate([cover, points])
    *at, depth = camera.rows(both)
    column, row = (np.floor(x / cell).astype(np.int64) for x in at)
    column -= column.min()
    key = (row - row.min()) * (column.max() + 1) + column
    nearest = np.full(key.max() + 1, -np.inf)
    np.maximum.at(nearest, key[: len(cover)], depth[: len(cover)])
    asked = slice(len(both) - len(points), None)
    return nearest[key[asked]] > depth[asked] + DEPTH_MARGIN


def view_weights(
    surface: BSplineSurface | Sequence[BSplineSurface],
    cameras: Sequence[Camera],
    uv: Array,
    grazing: float = 0.25,
) -> Array:
    """How well each photo sees each point: cosine of the viewing angle, 0 if hidden.

    Parameters
    ----------
    surface : BSplineSurface, or a sequence of n
        One for all photos, or each photo's own; nets of one size.
    cameras : sequence of n Camera
    uv : (p, 2) array
    grazing : float
        Cosine below which a point counts as not seen.

    Returns
    -------
    (n, p) array
    """
    out = np.zeros((len(cameras), len(uv)))
    faces = [surface] if isinstance(surface, BSplineSurface) else surface
    (u, v), shape = uv.T, faces[0].shape
    T, T_u, T_v = (basis_matrix(shape, u, v, *k) for k in ((0, 0), (1, 0), (0, 1)))
    points = normals = cover = np.zeros((0, 3))
    for i, camera in enumerate(cameras):
        if i < len(faces):
            b = faces[i].vector
            points, normals = T @ b, unit_normals(T_u @ b, T_v @ b)
            cover = faces[i].grid(161, 161).reshape(-1, 3)
        cosine = (camera.toward(points) * normals).sum(1)
        seen = (cosine > grazing) & ~occluded(cover, camera, points)
        out[i] = np.where(seen, cosine, 0.0)
    return out
