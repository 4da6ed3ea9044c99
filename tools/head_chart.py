"""Where each vertex of the head lies in the head's picture; for ``build_head.py``."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from parametrise import mean_value_weights
from scipy import sparse
from scipy.sparse.linalg import splu

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from core.rig.base_head import HALF, MIDDLE, POWER, face_region  # noqa: E402

INSET = 0.004  # of the neck's edge from the border of the picture
ROUNDS = 4  # of evening out the stretch of the picture


def superellipse(angle: np.ndarray, half, power: float) -> np.ndarray:
    """Points of ``|x / a|^p + |y / b|^p = 1`` on rays from its middle."""
    ray = np.stack([np.sin(angle), -np.cos(angle)], 1)
    return ray / ((np.abs(ray) / half) ** power).sum(1, keepdims=True) ** (1 / power)


def chart(vertices, quads, uv, rim, square) -> tuple[np.ndarray, np.ndarray]:
    """Places on the head's picture, v downwards, of the half with x >= 0.

    Without its face the half is a strip: from the face to the neck's edge one way, from
    the midline over the head to that under the chin the other way. It is laid on a
    rectangle by mean-value weights, with the stretch evened out as in
    `parametrise.embed`; the rectangle is bent around the face, between its outline and
    the border of the picture.

    Parameters
    ----------
    vertices : (p, 3) array
        Mirror symmetric, mm.
    quads : (q, 4) int array
    uv : (p, 2) array
        NaN where the head is no face.
    rim : (k,) int array
        The neck's edge.
    square : (left, top, side)
        Where the (u, v) square lies.

    Returns
    -------
    place : (p, 2) array
        NaN in the other half and in the nostrils.
    inner : (p,) bool array
        The vertices of the nostrils, for `fill_pits`.
    """
    corner, side = np.array(square[:2]), square[2]
    place = corner + side * uv
    known = face_region(uv) <= 1
    inner_middle, inner_half = corner + side * np.array(MIDDLE), side * np.array(HALF)
    angle = np.arctan2(
        *(np.where(known[:, None], place - inner_middle, 0.0) * (1, -1)).T
    )
    strip = np.stack([face_region(np.where(known[:, None], uv, MIDDLE)) - 1, angle], 1)
    half = quads[(vertices[quads, 0] > -1e-6).all(1)]
    middle = np.abs(vertices[:, 0]) < 1e-6
    under = middle & (vertices[:, 1] < 0) & (vertices[:, 2] > -60)
    strip[middle & ~known, 1] = 0.0
    strip[under & ~known, 1] = np.pi
    strip[rim, 0] = 1.0
    # Nostrils are holes of the face that are filled like everything else.
    inner = pits(quads, known, len(vertices))
    tri = np.concatenate([half[:, :3], half[:, [0, 2, 3]]])
    outer = tri[~inner[tri].any(1) & ~known[tri].all(1)]
    there = np.zeros(len(vertices), bool)
    there[outer] = True
    fix_t = known | np.isin(np.arange(len(vertices)), rim)
    p = vertices[outer]
    area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1) / 2
    corners, count = outer.ravel(), len(vertices)
    around = np.maximum(np.bincount(corners, np.repeat(area, 3), count), 1e-9)
    weights, scale = mean_value_weights(vertices, outer), np.ones(count)
    for _ in range(ROUNDS + 1):
        W = weights @ sparse.diags_array(1 / scale)
        A = sparse.csr_array(sparse.diags_array(np.asarray(W.sum(1)).ravel()) - W)
        for column, fixed in ((0, fix_t), (1, known | middle)):
            free = np.flatnonzero(there & ~fixed)
            held = np.flatnonzero(there & fixed)
            solve = splu(sparse.csc_array(A[free][:, free])).solve
            strip[free, column] = solve(-(A[free][:, held] @ strip[held, column]))
        t, angle = strip[:, :1], strip[:, 1]
        near = inner_middle + superellipse(angle, inner_half, POWER)
        far = 0.5 + superellipse(angle, 0.5 - INSET, 8)
        laid = near + t * (far - near)
        place[there & ~known] = laid[there & ~known]
        q = place[outer]
        e1, e2 = q[:, 1] - q[:, 0], q[:, 2] - q[:, 0]
        flat = np.abs(e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0]) / 2
        stretch = np.sqrt(area / np.maximum(flat, 1e-12))
        sigma = np.bincount(corners, np.repeat(area * stretch, 3), count) / around
        sigma = np.where(there, sigma / np.median(sigma[there]), 1.0)
        scale *= np.clip(sigma, 0.3, 3.0) ** 0.6
    return place, inner


def pits(quads, known, count) -> np.ndarray:
    """Vertices of the nostrils: not of the face, but with the face all around."""
    edges = np.concatenate([quads[:, [k, (k + 1) % 4]] for k in range(4)])
    edges = edges[~known[edges].any(1)]
    graph = sparse.coo_array((np.ones(len(edges)), edges.T), shape=(count, count))
    label = sparse.csgraph.connected_components(graph)[1]
    outside = np.bincount(label[~known]).argmax()
    return ~known & (label != outside)


def fill_pits(place, quads, vertices, inner) -> None:
    """Lay the nostrils into their holes of the picture."""
    tri = np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])
    tri = tri[inner[tri].any(1)]
    W = mean_value_weights(vertices, tri)
    A = sparse.csr_array(sparse.diags_array(np.asarray(W.sum(1)).ravel()) - W)
    free, held = np.flatnonzero(inner), np.setdiff1d(np.unique(tri), inner.nonzero())
    solve = splu(sparse.csc_array(A[free][:, free])).solve
    place[free] = solve(-(A[free][:, held] @ place[held]))
