"""Which triangle each pixel of a picture sees: a z-buffer in NumPy.

The renderer draws with it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .._types import Array


@dataclass(frozen=True)
class Raster:
    """What each pixel of a picture sees.

    Attributes
    ----------
    triangle : (H, W) int array
        Index of the nearest triangle, -1 where there is none.
    barycentric : (H, W, 3) array
        Weights of that triangle's three vertices.
    depth : (H, W) array
        Interpolated depth (larger is nearer), -inf where there is none.
    """

    triangle: npt.NDArray[np.int64]
    barycentric: Array
    depth: Array

    @property
    def covered(self) -> npt.NDArray[np.bool_]:
        """(H, W) bool: pixels that see a triangle."""
        return self.triangle >= 0

    def interpolate(self, values: Array, triangles: npt.NDArray) -> Array:
        """Vertex values (k, ...) brought to the covered pixels, (n, ...)."""
        seen = self.covered
        corner = triangles[self.triangle[seen]]
        weight = self.barycentric[seen]
        picked = np.asarray(values)[corner]
        return np.einsum("nc,nc...->n...", weight, picked)


def rasterize(
    xy: Array, depth: Array, triangles: npt.NDArray, size: tuple[int, int]
) -> Raster:
    """Z-buffer of triangles given in pixels.

    Triangles are grouped by the size of their bounding box and each group is
    tested against its box one pixel offset at a time, for all of its triangles
    at once: no loop over triangles.

    Parameters
    ----------
    xy : (k, 2) array
        Vertices in pixels, x right, y down, pixel centres at integers.
    depth : (k,) array
        Larger is nearer.
    triangles : (t, 3) int array
        Vertex indices, either orientation.
    size : (width, height)

    Returns
    -------
    Raster
    """
    width, height = size
    triangle = np.full(width * height, -1, dtype=np.int64)
    nearest = np.full(width * height, -np.inf)
    barycentric = np.zeros((width * height, 3))

    corners = np.asarray(xy, dtype=float)[triangles]
    low = np.maximum(np.ceil(corners.min(axis=1)), 0.0)
    high = np.minimum(np.floor(corners.max(axis=1)), (width - 1.0, height - 1.0))
    edge1 = corners[:, 1] - corners[:, 0]
    edge2 = corners[:, 2] - corners[:, 0]
    area = edge1[:, 0] * edge2[:, 1] - edge1[:, 1] * edge2[:, 0]
    usable = np.isfinite(corners).all(axis=(1, 2)) & (low <= high).all(axis=1)
    usable &= np.abs(area) > 1e-12
    span = np.where(usable[:, None], high - low, -1.0)
    extent = span.max(axis=1)
    # Weights of the second and third vertex: at the box's first pixel, per pixel.
    per_area = np.divide(1.0, area, out=np.zeros_like(area), where=usable)[:, None]
    slope1 = per_area * np.stack([edge2[:, 1], -edge2[:, 0]], axis=1)
    slope2 = per_area * np.stack([-edge1[:, 1], edge1[:, 0]], axis=1)
    local = low - corners[:, 0]
    first1, first2 = (local * slope1).sum(axis=1), (local * slope2).sum(axis=1)
    vertex_depth = np.asarray(depth, dtype=float)[triangles]

    smaller = -1.0
    while smaller < extent.max(initial=-1.0):
        larger = max(1.0, 2.0 * smaller)
        group = np.flatnonzero((extent > smaller) & (extent <= larger))
        smaller = larger
        if group.size == 0:
            continue
        steps = np.arange(int(larger) + 1)
        # Bound the memory: all offsets of one block of triangles at a time.
        block = max(1, 2_000_000 // steps.size**2)
        offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        for start in range(0, group.size, block):
            part = group[start : start + block]
            w1 = first1[part, None] + slope1[part] @ offsets.T
            w2 = first2[part, None] + slope2[part] @ offsets.T
            # A hair of slack: neighbours must not leave a crack between them.
            inside = (w1 >= -1e-9) & (w2 >= -1e-9) & (w1 + w2 <= 1 + 1e-9)
            for axis in (0, 1):
                inside &= offsets[:, axis] <= span[part, axis, None]
            which, offset = np.nonzero(inside)
            w1, w2 = w1[which, offset], w2[which, offset]
            weight = np.stack([1.0 - w1 - w2, w1, w2], axis=1)
            z = np.einsum("nc,nc->n", weight, vertex_depth[part[which]])
            at = low[part[which]].astype(np.int64) + offsets[offset]
            index = at[:, 1] * width + at[:, 0]
            # The nearest fragment of a pixel is the last after sorting by depth.
            order = np.lexsort((z, index))
            last = order[np.flatnonzero(np.diff(index[order], append=-1))]
            better = last[z[last] > nearest[index[last]]]
            nearest[index[better]] = z[better]
            triangle[index[better]] = part[which[better]]
            barycentric[index[better]] = weight[better]
    return Raster(
        triangle.reshape(height, width),
        barycentric.reshape(height, width, 3),
        nearest.reshape(height, width),
    )
