"""A B-spline surface sampled on a grid for drawing, and pictures over its (u, v).

NumPy; OpenCV only to fill the outline and to resample.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from .._types import Array
from ..surface.bspline import BSplineSurface, grid_parameters, grid_triangles
from ..surface.template import Template


@dataclass(frozen=True)
class SurfaceGrid:
    """A surface sampled for drawing.

    Attributes
    ----------
    points, normals : (k, 3) arrays
    uv : (k, 2) array
    triangles : (t, 3) int array
        Counter-clockwise seen from outside; those outside the face are gone.
    inside : (r, r) bool array or None
        Picture of the outline, ``inside[row of v, column of u]``.
    """

    points: Array
    normals: Array
    uv: Array
    triangles: npt.NDArray[np.int64]
    inside: npt.NDArray[np.bool_] | None


def outline_picture(
    template: Template, resolution: int = 1024
) -> npt.NDArray[np.bool_]:
    """The template's outline as a picture, ``[row of v, column of u]``.

    Pixel (row, column) stands for uv = (column + 0.5, row + 0.5) / resolution.
    """
    picture = np.zeros((resolution, resolution), np.uint8)
    corner = np.asarray(template.outline_uv) * resolution - 0.5
    # Four fractional bits: a polygon at sub-pixel accuracy.
    cv2.fillPoly(picture, [np.round(corner * 16).astype(np.int32)], (1,), shift=4)
    return picture.astype(bool)


def sample_surface(
    surface: BSplineSurface,
    template: Template | None = None,
    resolution: int | tuple[int, int] = 200,
) -> SurfaceGrid:
    """Sample a surface on a regular grid, trimmed to the template's outline.

    Parameters
    ----------
    surface : BSplineSurface
    template : Template, optional
        Its outline trims; without it the whole (u, v) square is drawn.
    resolution : int or (nu, nv)
        Samples along u and v.
    """
    nu, nv = resolution if isinstance(resolution, tuple) else (resolution, resolution)
    u, v = grid_parameters(nu, nv)
    points = np.asarray(surface.evaluate(u, v), float)
    normals = np.asarray(surface.normals(u, v), float)
    uv = np.stack([u, v], axis=1)
    triangles = grid_triangles(nu, nv)
    inside = None
    if template is not None:
        inside = outline_picture(template)
        # Keep a rim of one cell; the picture cuts it per pixel.
        size = inside.shape[0]
        reach = 2 * int(np.ceil(size / min(nu, nv))) + 1
        wide = cv2.dilate(inside.astype(np.uint8), np.ones((reach, reach), np.uint8))
        triangles = triangles[look_up(wide, uv)[triangles].all(axis=1)]
    return SurfaceGrid(points, normals, uv, triangles, inside)


def look_up(picture: np.ndarray, uv: Array) -> np.ndarray:
    """Nearest pixel of a (u, v) picture (row 0 at v = 0) at (n, 2) parameters."""
    height, width = picture.shape[:2]
    column = np.clip((uv[..., 0] * width).astype(int), 0, width - 1)
    row = np.clip((uv[..., 1] * height).astype(int), 0, height - 1)
    return picture[row, column]


def read_picture(picture: np.ndarray, uv: Array) -> npt.NDArray[np.float32]:
    """Bilinear values (n, channels) of a (u, v) picture at (n, 2) parameters."""
    # remap takes pictures of fewer than 32768 rows and columns: fold the list.
    width = 4096
    count = max(1, -(-len(uv) // width)) * width
    at = np.zeros((count, 2), np.float32)
    at[: len(uv)] = uv * (picture.shape[1], picture.shape[0]) - 0.5
    found = cv2.remap(
        np.ascontiguousarray(picture, np.float32),
        np.ascontiguousarray(at[:, 0].reshape(-1, width)),
        np.ascontiguousarray(at[:, 1].reshape(-1, width)),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(found.reshape(count, -1)[: len(uv)], np.float32)
