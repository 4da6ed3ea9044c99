"""What each photo sees of the surface, on a grid over (u, v).

For every photo: where each texel lies in it, how well it is seen there (angle,
occlusion, resolution, border of the picture), and its colours.
Pictures over (u, v) have row 0 at v = 0, and texel (row, column) of a picture of size S
stands for u = (column + 1/2) / S, v = (row + 1/2) / S.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from .._types import Array
from ..camera.camera import Camera
from ..images.photo import Photo
from ..photometry.sampling import occluded
from ..result import Reconstruction
from ..solve.expression import expression_displacements
from ..surface.alignment import relative_size
from ..surface.bspline import BSplineSurface, dense_basis, unit_normals

Picture = npt.NDArray[np.float32]

#: Cosine of the viewing angle at which a photo starts to count.
GRAZING = 0.12
#: Side of a depth cell, mm: the texels of a coarse picture fill them.
CELL = 0.8


@dataclass(frozen=True)
class SurfaceMaps:
    """A surface sampled at the texel centres of a square picture.

    Attributes
    ----------
    points, normals : (S, S, 3) arrays
        Row v, column u.
    """

    points: Array
    normals: Array

    @property
    def size(self) -> int:
        """Texels along each side."""
        return self.points.shape[0]


@dataclass(frozen=True)
class View:
    """One photo on the texel grid.

    Attributes
    ----------
    xy : (S, S, 2) float32 array
        Pixels of the photo's cut-out.
    weight : (S, S) float32 array
        0 where the photo does not see the texel; smooth.
    resolution : float
        Pixels of the cut-out along one unit of u or v, where the photo sees best.
    """

    xy: Picture
    weight: Picture
    resolution: float


def texel_centres(size: int) -> Array:
    """Parameters of the texel centres along one side, (size,)."""
    return (np.arange(size) + 0.5) / size


def surface_maps(surface: BSplineSurface, size: int) -> SurfaceMaps:
    """Points and normals at the texel centres."""
    at = texel_centres(size)

    def evaluate(du: int, dv: int) -> Array:
        along_u = dense_basis(surface.shape[0], at, du)
        along_v = dense_basis(surface.shape[1], at, dv)
        # (row v, column u, xyz); three small products instead of one sparse matrix
        # with 16 entries a texel.
        half = np.einsum("pm,mnc->pnc", along_u, surface.control_points)
        return np.einsum("qn,pnc->qpc", along_v, half, optimize=True)

    return SurfaceMaps(evaluate(0, 0), unit_normals(evaluate(1, 0), evaluate(0, 1)))


def view_photo(maps: SurfaceMaps, photo: Photo, camera: Camera) -> View:
    """Where and how well a photo sees each texel.

    Parameters
    ----------
    maps : SurfaceMaps
        Of the face as it is in this photo.
    photo : Photo
    camera : Camera

    Returns
    -------
    View
    """
    xy = photo.to_window(camera.project(maps.points)).astype(np.float32)
    toward = camera.toward(maps.points)
    facing = np.einsum("...c,...c->...", toward, maps.normals)
    weight = np.clip((facing - GRAZING) / (0.6 - GRAZING), 0, 1)
    # Smooth rise, and a preference for frontal views beyond it.
    weight = weight**2 * (3 - 2 * weight) * np.maximum(facing, 0)

    # Pixels per texel in the worse direction decide about sharpness.
    along_u = np.gradient(xy, axis=1)
    along_v = np.gradient(xy, axis=0)
    area = np.abs(along_u[..., 0] * along_v[..., 1] - along_u[..., 1] * along_v[..., 0])
    weight = weight * np.sqrt(np.maximum(area, 0))

    height, width = photo.pixels.shape[:2]
    border = np.minimum(
        np.minimum(xy[..., 0], width - 1 - xy[..., 0]),
        np.minimum(xy[..., 1], height - 1 - xy[..., 1]),
    )
    weight = weight * np.clip(border / (0.02 * max(width, height)), 0, 1)
    points = maps.points.reshape(-1, 3)
    hidden = occluded(points, camera, points, CELL).reshape(facing.shape)
    visible = (~hidden).astype(np.float32)
    # Step back from the rim of what is hidden (poses are never exact), softly.
    reach = 2 * max(1, round(maps.size / 100)) + 1
    visible = cv2.erode(visible, np.ones((reach, reach), np.uint8))
    soft = cv2.GaussianBlur(visible, (0, 0), reach / 2)
    weight = weight * np.clip(2 * soft - 1, 0, 1)
    seen = weight > 0.2 * weight.max(initial=1e-12)
    resolution = maps.size * float(np.sqrt(np.median(area[seen]))) if seen.any() else 0
    return View(xy, weight.astype(np.float32), resolution)


def sample(photo_linear: Picture, xy: Picture) -> Picture:
    """Colours (S, T, 3) of a picture at pixels ``xy`` (S, T, 2)."""
    found = cv2.remap(
        photo_linear,
        np.ascontiguousarray(xy[..., 0]),
        np.ascontiguousarray(xy[..., 1]),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(found, np.float32)


def channel_mean(colours: Array | Picture) -> Picture:
    """Mean over the channels of (..., 3); NumPy's own is slow over an axis of three."""
    return np.asarray(colours @ np.full(3, 1 / 3, colours.dtype))


def prefiltered(photo: Photo, view: View, size: int) -> Picture:
    """The photo, blurred to what ``size`` texels along a side can hold.

    Sampling more pixels than there are texels would alias.
    """
    picture = photo.linear()
    excess = view.resolution / size
    if excess > 1.2:
        sigma = 0.45 * np.sqrt(excess**2 - 1)
        picture = cv2.GaussianBlur(picture, (0, 0), float(sigma))
    return np.asarray(picture, np.float32)


def resized(picture: np.ndarray, size: int, rows: slice | None = None) -> Picture:
    """A (u, v) picture brought to ``size`` texels a side, or some rows of that.

    Texel centres of both sizes refer to the same parameters; beyond the outermost
    centres it continues linearly, so that positions stay exact up to the border.
    """
    old = picture.shape[0]
    at = (texel_centres(size) * old - 0.5).astype(np.float32)
    down = at[rows or slice(0, size)]
    # Only the rows between which these lie.
    first = int(np.clip(np.floor(down[0]), 0, max(old - 2, 0)))
    last = int(np.clip(np.floor(down[-1]) + 1, first + 1, max(old - 1, 1)))
    padded = _extended(np.asarray(picture[first : last + 1], np.float32))
    x, y = np.meshgrid(at + 1, down - (first - 1))
    return np.asarray(cv2.remap(padded, x, y, cv2.INTER_LINEAR), np.float32)


def _extended(picture: Picture) -> Picture:
    """One texel more on every side, by linear continuation."""
    wide = np.concatenate(
        [2 * picture[:1] - picture[1:2], picture, 2 * picture[-1:] - picture[-2:-1]]
    )
    left = 2 * wide[:, :1] - wide[:, 1:2]
    right = 2 * wide[:, -1:] - wide[:, -2:-1]
    return np.ascontiguousarray(np.concatenate([left, wide, right], axis=1))


def faces_of(reconstruction: Reconstruction) -> list[BSplineSurface]:
    """The face as it is in each used photo, with the expression that it has there."""
    neutral = reconstruction.surface
    template, expressions = reconstruction.template, reconstruction.expressions
    if not np.any(expressions):
        return [neutral] * len(reconstruction.photos)
    size = relative_size(neutral, template)
    moves = expression_displacements(template, expressions, size)
    return [BSplineSurface(neutral.control_points + move) for move in moves]


def view_photos(reconstruction: Reconstruction, size: int) -> Iterator[View]:
    """`view_photo` for every photo, each on the face with its own expression."""
    surface = maps = None
    for face, photo, camera in zip(
        faces_of(reconstruction),
        reconstruction.photos,
        reconstruction.cameras,
        strict=True,
    ):
        if maps is None or face is not surface:
            surface, maps = face, surface_maps(face, size)
        yield view_photo(maps, photo, camera)
