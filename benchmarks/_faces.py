"""A reconstructed face as triangles: what is measured and drawn, whatever made it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from _baseline import DepthFace
from bsface.drawing.pictures import colour_map
from bsface.drawing.rasterize import rasterize
from bsface.drawing.render import shaded_view, yaw_rotation
from bsface.drawing.surface_grid import SurfaceGrid, sample_surface
from bsface.surface.bspline import BSplineSurface, grid_triangles
from bsface.surface.template import Template
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Array = NDArray[np.float64]

#: Samples a side of a surface that is measured: about 1.5 mm.
SAMPLES = 121
#: The 68 points begin with the jaw line, which slides with the pose: not used.
JAW = slice(0, 17)


@dataclass(frozen=True)
class Face:
    """A face as a mesh.

    Attributes
    ----------
    points : (k, 3) array
        mm, in the frame of whatever made it.
    triangles : (t, 3) int array
        Measured; counter-clockwise seen from outside.
    landmarks : (68, 3) array
        Start of the alignment; NaN rows where unknown.
    drawn : (s, 3) int array
        The triangles within the outline of the face.
    uv, inside : arrays, optional
        Parameters of the points and picture of the outline (`SurfaceGrid`), by which
        the rim is drawn to the pixel.
    """

    points: Array
    triangles: NDArray[np.int64]
    landmarks: Array
    drawn: NDArray[np.int64]
    uv: Array | None = None
    inside: NDArray[np.bool_] | None = None

    def moved(self, transform: tuple[float, Array, Array]) -> Face:
        """After the similarity ``x -> s R x + t``."""
        s, R, t = transform
        return replace(
            self,
            points=s * self.points @ R.T + t,
            landmarks=s * self.landmarks @ R.T + t,
        )


def surface_face(surface: BSplineSurface, template: Template) -> Face:
    """Mesh of a surface that has the parameters of the template."""
    grid = sample_surface(surface, template, SAMPLES)
    marks = surface.evaluate(*template.landmark_uv[template.schemes["68"]].T)
    marks[JAW] = np.nan
    whole = grid_triangles(SAMPLES, SAMPLES)
    return Face(grid.points, whole, marks, grid.triangles, grid.uv, grid.inside)


def depth_face(found: DepthFace, template: Template) -> Face:
    """Mesh of a depth map; landmarks are the nearest pixels in (u, v)."""
    uv = template.landmark_uv[template.schemes["68"]]
    away, nearest = cKDTree(found.uv).query(uv)
    marks = found.points[nearest].copy()
    marks[JAW] = np.nan
    marks[away > 0.02] = np.nan
    return Face(found.points, found.triangles, marks, found.triangles)


def given_face(path: Path, template: Template) -> Face:
    """The template of the shared folder, whose net is indexed [v, u]."""
    with np.load(path, allow_pickle=False) as z:
        surface = BSplineSurface(z["control_points"].transpose(1, 0, 2))
        uv = z["landmark_uv"][template.schemes["68"]]
    grid = sample_surface(surface, None, SAMPLES)
    marks = surface.evaluate(*uv.T)
    marks[JAW] = np.nan
    return Face(grid.points, grid.triangles, marks, grid.triangles)


def vertex_normals(points: Array, triangles: NDArray[np.int64]) -> Array:
    """Unit normals of a mesh, ``(k, 3)``, weighted by area."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    total = np.stack(
        [
            np.bincount(triangles.ravel(), np.repeat(cross[:, x], 3), len(points))
            for x in range(3)
        ],
        1,
    )
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12)


@dataclass(frozen=True)
class View:
    """Where from a face is seen, the same for all faces of a page.

    Attributes
    ----------
    yaw : float
        Degrees; positive turns the nose to the picture's right.
    centre : (3,) array
        Point in the middle of the picture, mm.
    mm_per_pixel : float
    size : (width, height)
    """

    yaw: float
    centre: Array
    mm_per_pixel: float
    size: tuple[int, int]


def views_of(face: Face, yaws: Sequence[float], height: int = 230) -> list[View]:
    """Views at one scale that hold the whole drawn part of a face."""
    seen = face.points[np.unique(face.drawn)]
    middle = (seen.min(0) + seen.max(0)) / 2
    views = []
    mm_per_pixel = float(np.ptp(seen[:, 1])) / (0.78 * height)
    for yaw in yaws:
        R = yaw_rotation(yaw)
        turned = (seen - middle) @ R.T
        shift = (turned.min(0) + turned.max(0)) / 2 * (1, 0, 0)
        width = int(np.ptp(turned[:, 0]) / mm_per_pixel / 0.8)
        views.append(View(yaw, middle + R.T @ shift, mm_per_pixel, (width, height)))
    return views


def draw(face: Face, view: View) -> NDArray[np.uint8]:
    """Shaded view of a face, (height, width, 3)."""
    grid = SurfaceGrid(
        face.points,
        vertex_normals(face.points, face.drawn),
        np.zeros((len(face.points), 2)) if face.uv is None else face.uv,
        face.drawn,
        face.inside,
    )
    return shaded_view(
        grid,
        yaw_rotation(view.yaw),
        size=view.size,
        mm_per_pixel=view.mm_per_pixel,
        centre=view.centre,
    )


def draw_values(face: Face, values: Array, top: float, view: View) -> Any:
    """View of a number at each vertex as a colour from 0 to ``top``."""
    R = yaw_rotation(view.yaw)
    turned = (face.points - view.centre) @ R.T
    width, height = view.size
    xy = turned[:, :2] * (1, -1) / view.mm_per_pixel
    xy += ((width - 1) / 2, (height - 1) / 2)
    raster = rasterize(xy, turned[:, 2], face.drawn, view.size)
    # Flat colours would hide where on the face they lie.
    facing = (vertex_normals(face.points, face.drawn) @ R.T)[:, 2]
    facing = raster.interpolate(facing, face.drawn)
    colours = colour_map(raster.interpolate(values, face.drawn), 0.0, top, "magma")
    picture = np.full((height, width, 3), 255, np.uint8)
    lit = colours * (0.8 + 0.2 * np.clip(facing, 0, 1))[:, None]
    picture[raster.covered] = np.round(lit)
    return picture
