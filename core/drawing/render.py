"""A small software renderer of surface grids: shaded views.

It serves the report, the benchmarks and the demo where no Blender is at hand.
NumPy; OpenCV only to resample.

Axes: view coordinates are x right, y up, z towards the viewer; pictures are
(H, W, 3) uint8 RGB with row 0 at the top and pixel centres at integers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from .._types import Array
from ..errors import ReconstructionError
from ..progress import CheckCancelled, never_cancelled
from ..surface.bspline import BSplineSurface
from ..surface.template import Template
from .rasterize import rasterize
from .surface_grid import SurfaceGrid, look_up, read_picture, sample_surface

Picture = npt.NDArray[np.uint8]

#: Yaw of the standard views in degrees; positive turns the nose to the
#: picture's right.
VIEWS = {"front": 0.0, "three-quarter": 40.0, "profile": 88.0}


def yaw_rotation(degrees: float, pitch: float = 0.0) -> Array:
    """Rotation that turns the nose to the picture's right (and then down)."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    c, s = np.cos(np.radians(pitch)), np.sin(np.radians(pitch))
    nod = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    return np.asarray(nod @ turn, float)


@dataclass(frozen=True)
class View:
    """What a picture of a sampled surface shows, before it is painted.

    Attributes
    ----------
    size : (width, height)
    supersampling : int
        The pixels are that many times finer.
    uv : (n, 2) array
        Parameters that the covered pixels see.
    brightness : (n, 3) float32 array
        Of a white surface there.
    behind : (n,) bool array
        Pixels that see the inside of the shell.
    rows, columns : (n,) int arrays
        Where the pixels lie.
    """

    size: tuple[int, int]
    supersampling: int
    uv: Array
    brightness: npt.NDArray[np.float32]
    behind: npt.NDArray[np.bool_]
    rows: npt.NDArray[np.int64]
    columns: npt.NDArray[np.int64]

    def painted(
        self,
        colours: npt.NDArray | None = None,
        shading: float = 1.0,
        background: Sequence[int] = (255, 255, 255),
    ) -> Picture:
        """The picture, (height, width, 3) uint8; see `shaded_view`."""
        if colours is None:
            base = np.full((len(self.uv), 3), (0.80, 0.77, 0.74), np.float32)
        else:
            picture = np.asarray(colours)[..., :3]
            base = read_picture(picture, self.uv) / float(np.iinfo(picture.dtype).max)
        lit = base * (1 - shading + shading * self.brightness)
        lit[self.behind] = (0.35, 0.35, 0.37)
        width, height = self.size
        fine = height * self.supersampling, width * self.supersampling, 3
        canvas = np.empty(fine, np.float32)
        canvas[:] = np.asarray(background, np.float32) / 255
        canvas[self.rows, self.columns] = lit
        canvas = cv2.resize(canvas, self.size, interpolation=cv2.INTER_AREA)
        return np.round(np.clip(canvas, 0, 1) * 255).astype(np.uint8)


def look_at(
    grid: SurfaceGrid,
    rotation: Array | None = None,
    *,
    size: tuple[int, int] = (360, 440),
    mm_per_pixel: float | None = None,
    centre: Sequence[float] | Array | None = None,
    supersampling: int = 2,
) -> View:
    """What an orthographic picture of a sampled surface shows; see `shaded_view`."""
    rotation = np.eye(3) if rotation is None else np.asarray(rotation, float)
    used = np.unique(grid.triangles)
    if used.size == 0:
        return View(
            size=size,
            supersampling=supersampling,
            uv=np.zeros((0, 2)),
            brightness=np.zeros((0, 3), np.float32),
            behind=np.zeros(0, bool),
            rows=np.zeros(0, np.int64),
            columns=np.zeros(0, np.int64),
        )
    if centre is None:
        low, high = grid.points[used].min(axis=0), grid.points[used].max(axis=0)
        centre = (low + high) / 2
    view = (grid.points - np.asarray(centre)) @ rotation.T
    if mm_per_pixel is None:
        spread = np.ptp(view[used, :2], axis=0) / (np.asarray(size) * 0.94)
        mm_per_pixel = float(spread.max()) or 1.0
    width, height = size[0] * supersampling, size[1] * supersampling
    scale = supersampling / mm_per_pixel
    xy = view[:, :2] * (scale, -scale) + ((width - 1) / 2, (height - 1) / 2)
    raster = rasterize(xy, view[:, 2], grid.triangles, (width, height))
    known = np.concatenate([grid.uv, grid.normals], axis=1)
    uv, normal = np.split(raster.interpolate(known, grid.triangles), [2], axis=1)
    normal = normal @ rotation.T
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    rows, columns = np.nonzero(raster.covered)
    keep = np.ones(len(uv), bool)
    if grid.inside is not None:
        keep = look_up(grid.inside, uv)
    normal = normal[keep]
    return View(
        size=size,
        supersampling=supersampling,
        uv=uv[keep],
        brightness=_studio(normal).astype(np.float32),
        behind=normal[:, 2] < 0,
        rows=rows[keep],
        columns=columns[keep],
    )


def shaded_view(
    grid: SurfaceGrid,
    rotation: Array | None = None,
    *,
    size: tuple[int, int] = (360, 440),
    colours: npt.NDArray | None = None,
    shading: float = 1.0,
    mm_per_pixel: float | None = None,
    centre: Sequence[float] | None = None,
    background: Sequence[int] = (255, 255, 255),
    supersampling: int = 2,
) -> Picture:
    """One orthographic picture of a sampled surface.

    Parameters
    ----------
    grid : SurfaceGrid
    rotation : (3, 3) array, optional
        Head to view; the frontal view by default.
    size : (width, height)
    colours : (r, c, 3) uint8 array, optional
        Picture over (u, v), row 0 at v = 0: a texture or a colour map; clay
        grey by default.
    shading : float
        0 draws the colours flat, 1 fully shaded.
    mm_per_pixel : float, optional
        Scale; by default the surface fills the picture.
    centre : (3,) array, optional
        Point of the head in the middle of the picture, mm.
    background : (3,) uint8
    supersampling : int
        Pictures are drawn this many times larger and averaged.

    Returns
    -------
    (height, width, 3) uint8 array
    """
    view = look_at(
        grid,
        rotation,
        size=size,
        mm_per_pixel=mm_per_pixel,
        centre=centre,
        supersampling=supersampling,
    )
    return view.painted(colours, shading, background)


def _studio(normal: Array) -> Array:
    """Brightness (n, 3) of a white surface: key, fill, rim and a little sky."""
    total = np.full((len(normal), 3), 0.10)
    for direction, colour in (
        ((-0.45, 0.55, 0.70), (0.80, 0.78, 0.75)),
        ((0.80, 0.05, 0.45), (0.17, 0.18, 0.21)),
        ((0.10, 0.95, -0.20), (0.10, 0.10, 0.11)),
    ):
        unit = np.asarray(direction) / np.linalg.norm(direction)
        total += np.maximum(normal @ unit, 0.0)[:, None] * np.asarray(colour)
    half = np.array([-0.45, 0.55, 1.70])
    half /= np.linalg.norm(half)
    total += 0.10 * (np.maximum(normal @ half, 0.0) ** 25)[:, None]
    # Softer than the screen's own gamma: plain Lambert looks too dark in half-shade.
    return np.minimum(total, 1.15) ** (1 / 1.6)


def view_rotation(view: str | float | Array) -> Array:
    """Rotation of a named view, of a yaw in degrees, or the matrix itself."""
    if isinstance(view, str):
        if view not in VIEWS:
            raise ValueError(f"view must be one of {sorted(VIEWS)}, got {view!r}")
        return yaw_rotation(VIEWS[view])
    if np.ndim(view) == 0:
        return yaw_rotation(float(view))  # type: ignore[arg-type]
    return np.asarray(view, float)


def face_views(
    surface: BSplineSurface,
    template: Template | None = None,
    *,
    views: Sequence[str | float] = ("front", "three-quarter", "profile"),
    height: int = 440,
    resolution: int = 220,
    check_cancelled: CheckCancelled = never_cancelled,
) -> tuple[View, ...]:
    """Views of a face at one scale, to be painted as often as one likes.

    Parameters
    ----------
    surface : BSplineSurface
    template : Template, optional
        Trims to the face.
    views : sequence of names of :data:`VIEWS` or yaws in degrees
    height : int
        Pixels.
    resolution : int
        Samples along u and v.
    check_cancelled : callable, optional
        Called before each view.
    """
    grid = sample_surface(surface, template, resolution)
    points = grid.points[np.unique(grid.triangles)]
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    rotations = [view_rotation(view) for view in views]
    turned = [(points - middle) @ rotation.T for rotation in rotations]
    if not min(max(np.ptp(p[:, k]) for p in turned) for k in (0, 1)) > 0:
        raise ReconstructionError(
            "The surface is collapsed to a point or a line and cannot be drawn; give a "
            "face."
        )
    mm_per_pixel = max(np.ptp(p[:, 1]) for p in turned) / (0.94 * height)
    found = []
    for rotation, p in zip(rotations, turned, strict=True):
        check_cancelled()
        shift = (p.min(axis=0) + p.max(axis=0)) / 2
        found.append(
            look_at(
                grid,
                rotation,
                size=(int(np.ceil(np.ptp(p[:, 0]) / mm_per_pixel / 0.94)), height),
                mm_per_pixel=mm_per_pixel,
                centre=middle + rotation.T @ (shift * (1, 1, 0)),
            )
        )
    return tuple(found)


def side_by_side(
    views: Sequence[View],
    colours: npt.NDArray | None = None,
    shading: float = 1.0,
    background: Sequence[int] = (255, 255, 255),
) -> Picture:
    """Views painted alike, in one picture; see `shaded_view`."""
    pictures = [view.painted(colours, shading, background) for view in views]
    return np.concatenate(pictures, axis=1)


def render_views(
    surface: BSplineSurface,
    template: Template | None = None,
    *,
    height: int = 440,
    colours: npt.NDArray | None = None,
    shading: float = 1.0,
    background: Sequence[int] = (255, 255, 255),
) -> Picture:
    """Front, three-quarter view and profile of a face, side by side at one scale.

    Parameters
    ----------
    surface : BSplineSurface
    template : Template, optional
        Trims to the face.
    height : int
        Pixels.
    colours, shading, background
        As in `shaded_view`.

    Returns
    -------
    (height, W, 3) uint8 array
    """
    views = face_views(surface, template, height=height)
    return side_by_side(views, colours, shading, background)
