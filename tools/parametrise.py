"""Maps the face part of a head mesh to the unit square without folds.

The face is the part of the mesh that an azimuthal-equidistant map about a point inside
the head sends into a rectangle of angles.  The boundary keeps that map; the inside is a
mean-value embedding (Floater 2003: no triangle folds, because the boundary is convex),
re-solved a few times with weights that even out the stretch (Yoshizawa et al. 2004),
finer where the face has detail.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

CENTRE = np.array([0.0, -25.0, -45.0])  # mm, inside the head behind the nose
RECTANGLE = (-97.0, 97.0, -88.0, 58.0)  # degrees: left, right, below, above
# To the ears and down to the throat: photos see it, and a surface that ends at the
# chin cannot be
# aligned with one that does not.


def azimuthal(points: np.ndarray) -> np.ndarray:
    """Angles (degrees) about `CENTRE`, equidistant from the +z axis, (n, 2)."""
    q = points - CENTRE
    theta = np.degrees(np.arctan2(np.hypot(q[:, 0], q[:, 1]), q[:, 2]))
    phi = np.arctan2(q[:, 1], q[:, 0])
    return theta[:, None] * np.stack([np.cos(phi), np.sin(phi)], 1)


def clip(angles, triangles, arrays, rectangle=RECTANGLE):
    """Cut a mesh along the four lines of a rectangle in the plane of ``angles``.

    ``arrays`` are per-vertex values that are interpolated along.  Returns angles,
    triangles, arrays and the index of the triangle that each one is a part of.
    """
    owner = np.arange(len(triangles))
    for axis, limit, sign in (
        (0, rectangle[0], 1), (0, rectangle[1], -1),
        (1, rectangle[2], 1), (1, rectangle[3], -1),
    ):  # fmt: skip
        side = sign * (angles[:, axis] - limit)
        inside = side >= 0
        made: dict[tuple[int, int], int] = {}
        new_angles, new_rows = [], [[] for _ in arrays]
        out, out_owner = [], []

        def cut(
            a,
            b,
            side=side,
            made=made,
            new=new_angles,
            rows=new_rows,
            arr=arrays,
            angles=angles,
        ):
            key = (min(a, b), max(a, b))
            if key not in made:
                w = side[a] / (side[a] - side[b])
                made[key] = len(angles) + len(new)
                new.append((1 - w) * angles[a] + w * angles[b])
                for r, x in zip(rows, arr, strict=True):
                    r.append((1 - w) * x[a] + w * x[b])
            return made[key]  # fmt: skip

        for tri, own in zip(triangles, owner, strict=True):
            polygon = []
            for k in range(3):
                a, b = tri[k], tri[(k + 1) % 3]
                if inside[a]:
                    polygon.append(a)
                if inside[a] != inside[b]:
                    polygon.append(cut(a, b))
            for k in range(1, len(polygon) - 1):
                out.append((polygon[0], polygon[k], polygon[k + 1]))
                out_owner.append(own)
        if new_angles:
            angles = np.concatenate([angles, new_angles])
            arrays = [
                np.concatenate([x, r]) for x, r in zip(arrays, new_rows, strict=True)
            ]
        triangles, owner = np.array(out), np.array(out_owner)
    return angles, triangles, arrays, owner


def largest_component(triangles, count, seed):
    """Triangles that hang together with vertex ``seed``, as a mask."""
    e = triangles[:, [0, 1, 2, 0]]
    A = sparse.coo_array(
        (np.ones(3 * len(e)), (e[:, :3].ravel(), e[:, 1:].ravel())),
        shape=(count, count),
    )
    _, label = sparse.csgraph.connected_components(A, directed=False)
    return label[triangles[:, 0]] == label[seed]


def boundary_vertices(triangles) -> np.ndarray:
    """Vertices on edges that only one triangle has."""
    e = np.sort(
        np.concatenate([triangles[:, k] for k in ([0, 1], [1, 2], [2, 0])]),
        axis=1,
    )
    edge, times = np.unique(e, axis=0, return_counts=True)
    return np.unique(edge[times == 1])


def mean_value_weights(vertices, triangles) -> sparse.csr_array:
    """Floater's weights ``(tan(a/2) + tan(b/2)) / |x_i - x_j|`` of directed edges."""
    rows, columns, data = [], [], []
    for k in range(3):
        i, j, m = (triangles[:, (k + x) % 3] for x in range(3))
        a, b = vertices[j] - vertices[i], vertices[m] - vertices[i]
        la, lb = np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)
        cosine = (a * b).sum(1) / np.maximum(la * lb, 1e-12)
        half = np.sqrt((1 - cosine).clip(1e-9) / (1 + cosine).clip(1e-9))
        rows += [i, i]
        columns += [j, m]
        data += [half / np.maximum(la, 1e-4), half / np.maximum(lb, 1e-4)]
    n = len(vertices)
    at = (np.concatenate(rows), np.concatenate(columns))
    return sparse.csr_array(
        sparse.coo_array((np.concatenate(data), at), shape=(n, n)).tocsr()
    )


def embed(vertices, triangles, angles, focus=None, rounds=3, rectangle=RECTANGLE):
    """(u, v) in the unit square, v down; ``focus`` > 1 asks for a finer net there."""
    left, right, below, above = rectangle
    uv = np.stack(
        [
            (angles[:, 0] - left) / (right - left),
            (above - angles[:, 1]) / (above - below),
        ],
        1,
    )
    border = boundary_vertices(triangles)
    free = np.setdiff1d(np.unique(triangles), border)
    weights = mean_value_weights(vertices, triangles)
    focus = np.ones(len(vertices)) if focus is None else focus
    p = vertices[triangles]
    area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1) / 2
    around = np.maximum(np.bincount(triangles.ravel(), np.repeat(area, 3)), 1e-9)
    scale = np.ones(len(vertices))
    for _ in range(rounds + 1):
        W = weights @ sparse.diags_array(1 / scale)
        A = sparse.csr_array(sparse.diags_array(np.asarray(W.sum(1)).ravel()) - W)
        solve = splu(sparse.csc_array(A[free][:, free])).solve
        uv[free] = solve(-(A[free][:, border] @ uv[border]))
        q = uv[triangles]
        e1, e2 = q[:, 1] - q[:, 0], q[:, 2] - q[:, 0]
        flat = np.abs(e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0]) / 2
        stretch = np.sqrt(area / np.maximum(flat, 1e-12))
        sigma = np.bincount(triangles.ravel(), np.repeat(area * stretch, 3)) / around
        sigma = np.pad(sigma, (0, len(vertices) - len(sigma)), constant_values=1.0)
        sigma = sigma / np.median(sigma[np.unique(triangles)]) * focus
        scale *= np.clip(sigma, 0.3, 3.0) ** 0.6
    # vertices that no triangle of the face has keep their angles
    return uv


def folded(uv, triangles) -> int:
    """Number of triangles with the wrong orientation in (u, v)."""
    q = uv[triangles]
    e1, e2 = q[:, 1] - q[:, 0], q[:, 2] - q[:, 0]
    signed = e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0]
    return int(min((signed > 0).sum(), (signed < 0).sum()))
