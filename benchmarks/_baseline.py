"""The method that the paper compares with: photometric stereo and integrated depth.

After Kemelmacher-Shlizerman and Seitz, "Face reconstruction in the wild", ICCV 2011
([30] of the paper): photos are turned to the front by the template, ``M = LS`` is
factorised by a rank-4 SVD with a choice of photos at each pixel and the ambiguity
resolved by the template (`solve.paper.photometric`), and the normals are integrated to
a depth map over the frontal picture,

    min_z  sum  (n_z (z_right - z) / d + n_x)^2 + (n_z (z_up - z) / d + n_y)^2
           + boundary_weight * sum_boundary (z - z_t)^2 / d^2
           + ridge * sum (z - z_t)^2 / d^2 ,

``d`` the pixel size.  What the depth map cannot hold (sides that face away, undercuts)
is missing from the result, and its low frequencies are those of accumulated normal
errors: this is what the B-spline surface and its landmarks are there to repair.

The size of a pixel and the weights are ours; the paper that compares gives none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from bsface.errors import ReconstructionError
from bsface.solve.least_squares import Block, ridge, solve_least_squares
from bsface.solve.paper.photometric import photometric_svd
from bsface.surface.bspline import BSplineSurface, grid_parameters
from numpy.typing import NDArray
from scipy import ndimage, sparse

Array = NDArray[np.float64]

# Pixels whose template normal is this much turned away from the front are left out:
# their slope cannot be integrated and no photo shows them well.
MINIMUM_NZ = 0.15


@dataclass(frozen=True)
class FrontalGrid:
    """Pixels of the frontal picture of a surface.

    Parameters
    ----------
    index : (rows, columns) int array
        Number of each pixel's point, -1 where the face is not.  Rows run down.
    uv : (p, 2) array
        Surface point seen in each pixel.
    points : (p, 3) array
        That point, mm.
    spacing : float
        Pixel size, mm.
    """

    index: NDArray[np.int64]
    uv: Array
    points: Array
    spacing: float


@dataclass(frozen=True)
class DepthFace:
    """Result of `baseline`.

    Parameters
    ----------
    points : (p, 3) array
        One a pixel, mm; x and y are those of the frontal grid.
    triangles : (t, 3) int array
        Counter-clockwise seen from the front.
    normals : (p, 3) array
        From photometric stereo.
    albedo : (p,) array
    uv : (p, 2) array
        Points of the template that the pixels came from.
    """

    points: Array
    triangles: NDArray[np.int64]
    normals: Array
    albedo: Array
    uv: Array


def baseline(
    surface: BSplineSurface,
    sample: Callable[[Array], tuple[Array, Array]],
    *,
    inside: Callable[[Array], NDArray[np.bool_]] | None = None,
    spacing: float = 1.5,
    tolerance: float = 0.15,
    boundary_weight: float = 0.01,
) -> DepthFace:
    """Depth map of a face by photometric stereo with a template.

    Parameters
    ----------
    surface : BSplineSurface
        The template.
    sample : (uv) -> (M, weights)
        Intensities and visibility, (n, p) each, of all photos at the surface points
        ``uv`` (p, 2); the photos turned to the front.
    inside : (uv) -> bool array, optional
        Which surface points belong to the face, as `Template.inside`.
    spacing : float
        Pixel size, mm.
    tolerance : float
        Of the choice of photos, see `photometric_svd`.
    boundary_weight : float
        How much the template's depth counts on the border of the map.  Weak, as in
        [30]: it sets the mean depth and tilt, not the shape.

    Returns
    -------
    DepthFace
    """
    grid = frontal_grid(surface, spacing, inside)
    M, weights = sample(grid.uv)
    template_normals = surface.normals(*grid.uv.T)
    result = photometric_svd(M, weights, template_normals, tolerance=tolerance)
    z = integrate(
        result.normals, grid.index, grid.points[:, 2], spacing, boundary_weight
    )
    points = np.column_stack([grid.points[:, :2], z])
    triangles = depth_triangles(grid.index)
    return DepthFace(points, triangles, result.normals, result.albedo, grid.uv)


def frontal_grid(
    surface: BSplineSurface,
    spacing: float,
    inside: Callable[[Array], NDArray[np.bool_]] | None = None,
) -> FrontalGrid:
    """The surface points that an orthographic camera in front sees in its pixels.

    The nearest of all points of a dense parameter grid in each pixel is the start; a
    few Newton steps on ``F_xy(u, v) = (x, y)`` bring it to the pixel's centre.

    Parameters
    ----------
    surface : BSplineSurface
    spacing : float
        Pixel size, mm.
    inside : (uv) -> bool array, optional
    """
    if not spacing > 0:
        raise ValueError(f"spacing must be positive, got {spacing}")
    rough = surface.grid(40, 40)
    longest = max(
        np.linalg.norm(np.diff(rough, axis=axis), axis=2).sum(axis).max()
        for axis in (0, 1)
    )
    # Two samples a pixel, so that no pixel of the face stays empty.
    count = int(np.clip(2 * longest / spacing, 60, 900))
    uv = np.stack(grid_parameters(count, count), 1)
    if inside is not None:
        uv = uv[inside(uv)]
    if len(uv) == 0:
        raise ReconstructionError(
            "The outline of the template contains no surface point; check the template."
        )
    xyz = surface.evaluate(*uv.T)
    left, bottom = xyz[:, 0].min(), xyz[:, 1].min()
    column = np.round((xyz[:, 0] - left) / spacing).astype(np.int64)
    row = np.round((xyz[:, 1] - bottom) / spacing).astype(np.int64)
    shape = (row.max() + 1, column.max() + 1)
    # The last write wins: sorted by depth that is the point nearest to the camera.
    order = np.argsort(xyz[:, 2], kind="stable")
    front = np.full(shape, -1)
    front[row[order], column[order]] = order
    rows, columns = np.nonzero(front >= 0)
    start = front[rows, columns]
    target = np.stack([left + columns * spacing, bottom + rows * spacing], 1)
    found = uv[start]
    for _ in range(6):
        r = target - surface.evaluate(*found.T)[:, :2]
        fu = surface.evaluate(*found.T, du=1)[:, :2]
        fv = surface.evaluate(*found.T, dv=1)[:, :2]
        det = fu[:, 0] * fv[:, 1] - fu[:, 1] * fv[:, 0]
        det = np.where(np.abs(det) < 1e-9, np.inf, det)
        move = (
            np.stack(
                [
                    r[:, 0] * fv[:, 1] - r[:, 1] * fv[:, 0],
                    fu[:, 0] * r[:, 1] - fu[:, 1] * r[:, 0],
                ],
                1,
            )
            / det[:, None]
        )
        found = np.clip(found + np.clip(move, -0.02, 0.02), 0, 1)
    points = surface.evaluate(*found.T)
    good = (
        (np.linalg.norm(points[:, :2] - target, axis=1) < 0.01 * spacing)
        & (surface.normals(*found.T)[:, 2] > MINIMUM_NZ)
        # Newton must not slip to a layer behind the visible one.
        & (points[:, 2] > xyz[start, 2] - 4 * spacing)
    )
    if inside is not None:
        good &= inside(found)
    index = np.full(shape, -1)
    index[rows[good], columns[good]] = np.arange(int(good.sum()))
    # Rows so far run up; the picture's run down.
    index, kept = _largest_part(index[::-1])
    return FrontalGrid(index, found[good][kept], points[good][kept], spacing)


def integrate(
    normals: Array,
    index: NDArray[np.int64],
    template_depth: Array,
    spacing: float,
    boundary_weight: float = 0.01,
    ridge_weight: float = 1e-6,
) -> Array:
    """Depth from normals by sparse least squares.

    Parameters
    ----------
    normals : (p, 3) array
        Outward unit normals.
    index : (rows, columns) int array
        Pixels, as in `FrontalGrid`.
    template_depth : (p,) array
        mm; on the border with ``boundary_weight``, elsewhere with ``ridge_weight``,
        which only decides what no normal does.
    spacing : float
        Pixel size, mm.
    boundary_weight, ridge_weight : float

    Returns
    -------
    (p,) array
        Depth, mm.
    """
    p = len(normals)
    blocks = []
    # x grows with the column, y against the row.
    pairs = (
        (index[:, :-1], index[:, 1:], 0),
        (index[1:, :], index[:-1, :], 1),
    )
    for first, second, axis in pairs:
        both = (first >= 0) & (second >= 0)
        a, b = first[both], second[both]
        # The slope between two pixels is that of their mean normal; multiplied by n_z
        # there is no division where the face turns away.
        n = (normals[a] + normals[b]) / 2
        k = np.arange(len(a))
        difference = sparse.csr_array(
            (
                np.concatenate([n[:, 2], -n[:, 2]]),
                (np.concatenate([k, k]), np.concatenate([b, a])),
            ),
            shape=(len(a), p),
        )
        blocks.append(Block(difference, -n[:, axis] * spacing))
    border = boundary(index)
    select = sparse.csr_array(
        (np.ones(len(border)), (np.arange(len(border)), border)), shape=(len(border), p)
    )
    blocks.append(Block(select, template_depth[border], boundary_weight))
    blocks.append(ridge(p, ridge_weight, template_depth))
    return solve_least_squares(blocks).x


def boundary(index: NDArray[np.int64]) -> NDArray[np.int64]:
    """Points whose pixel has a neighbour (of 4) outside the face."""
    face = index >= 0
    inner = np.asarray(ndimage.binary_erosion(face, border_value=0), bool)
    return index[face & ~inner]


def depth_triangles(index: NDArray[np.int64]) -> NDArray[np.int64]:
    """Two triangles for each square of four pixels of the face, (t, 3)."""
    a, b = index[:-1, :-1], index[:-1, 1:]
    c, d = index[1:, :-1], index[1:, 1:]
    # Rows run down: a b above c d, so a c d and a d b turn left seen from the front.
    t = np.concatenate([np.stack(x, -1).reshape(-1, 3) for x in ((a, c, d), (a, d, b))])
    return t[(t >= 0).all(1)]


def _largest_part(
    index: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Renumbered pixels of the largest connected part, and which points they were."""
    if not (index >= 0).any():
        raise ReconstructionError(
            "No pixel of the frontal picture sees the template; its outward side must "
            "face +z."
        )
    label = np.zeros(index.shape, np.int64)
    ndimage.label(index >= 0, output=label)
    largest = 1 + int(np.argmax(np.bincount(label.ravel())[1:]))
    part = label == largest
    kept = index[part]
    result = np.full(index.shape, -1)
    result[part] = np.arange(len(kept))
    return result, kept
