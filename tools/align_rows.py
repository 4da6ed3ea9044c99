#!/usr/bin/env python3
"""Makes a template whose rows follow brows, lids and lips: an experiment.

    python tools/align_rows.py --source ../shared/template -o aligned.npz
    python tools/align_rows.py --source ../shared/template --shift 0.5 -o down.npz
    python tools/score_templates.py aligned.npz down.npz

The embedding of the face spreads the net evenly and knows nothing of features. Here
each v of it is moved by ``s(u, v)``, a bicubic B-spline that minimises

    bending energy + weight * sum over lines of mean (v + s - row)^2 + HOLD * mean s^2

where a line's ``row`` is the whole row of the net next to it and the last mean is over
the lower nose, whose base lies well as it is and whose nostrils need all the rows they
have, and over the outline. u stays. The net is fitted to the average head again, as in
``tools/build_template.py``; landmarks, regions and modes of the bundled template are
carried along.

``--shift`` moves the inner rows by so many knot spans instead, with no regard to any
feature: how much the accuracy changes then is how much it owes to where the rows lie by
chance.

The bundled template is not made like this: docs/method.md has the figures. A face of
such a template has no ARKit keys, openings or head, whose (u, v) are the bundled one's.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from bsface.surface.bending import bending_matrix
from bsface.surface.bspline import BSplineSurface, basis_matrix
from bsface.surface.template import BUNDLED, load_template
from build_template import (
    BENDING,
    face_patch,
    fit_operator,
    sample_weights,
    skin_map,
    triangle_samples,
    vertex_areas,
)
from feature_rows import Line, feature_lines, part, table
from parametrise import folded
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

#: The row that a line is to lie in, in knot spans of the bundled net from its border.
ROWS = {
    "brow": 8,
    "upper lid": 11,
    "lower lid": 13,
    "upper lip, border": 23,
    "line between the lips": 25,
    "lower lip, border": 27,
}
NET = (40, 42)  # control points of s
STIFF = 1e-6  # of the bending energy of s, over the mean of its diagonal
HOLD, FIXED = 1e-2, 1e3  # weights of nose and outline, and of the square's border
#: How far the nose reaches beyond its wings and its base, in spans.
BESIDE, BELOW = 0.3, 0.2
GRID = (157, 165)  # points at which modes are carried along
NEAR = 4.0  # mm
#: Kinds of membranes of `face_patch`.
FEATURES = {"lids": 1, "lips": 2, "nostrils": 3}

Movement = Callable[[np.ndarray], np.ndarray]


def aligned(lines: list[Line], outline: np.ndarray, spans, weight: float) -> Movement:
    """The movement of (u, v) that brings lines near their rows."""
    by_name = {line.name: line for line in lines}
    wing, base = by_name["wing of the nose"].uv, by_name["base of the nose"].uv
    u = wing[:, 0].min() - BESIDE / spans[0]
    v = wing[:, 1].min(), base[:, 1].max() + BELOW / spans[1]
    square = lattice(np.linspace(0, 1, 60), np.linspace(0, 1, 60))
    border = square[((square == 0) | (square == 1)).any(1)]
    K, size = bending_matrix(NET), NET[0] * NET[1]
    normal = STIFF / K.diagonal().mean() * K + 1e-9 * sparse.eye_array(size)
    for points, hold in (
        (border, FIXED),
        (outline, HOLD),
        (lattice(np.linspace(u, 1 - u, 30), np.linspace(*v, 30)), HOLD),
    ):
        T = basis_matrix(NET, *points.T)
        normal = normal + hold / len(points) * (T.T @ T)
    right = np.zeros(size)
    for name, row in ROWS.items():
        uv = part(by_name[name].uv, (0, 1))
        # The face is mirror symmetric: the other half has the same line.
        uv = np.concatenate([uv, uv * (-1, 1) + (1, 0)])
        T = basis_matrix(NET, *uv.T)
        normal = normal + weight / len(uv) * (T.T @ T)
        right += weight / len(uv) * (T.T @ (row / spans[1] - uv[:, 1]))
    s = splu(sparse.csc_array(normal)).solve(right).reshape(NET)
    s = ((s + s[::-1]) / 2).ravel()
    return along_v(lambda uv: basis_matrix(NET, *uv.T) @ s)


def shifted(spans, by: float) -> Movement:
    """All inner rows moved down by up to ``by`` knot spans, smoothly."""
    return along_v(lambda uv: by / spans[1] * (np.sin(np.pi * uv) ** 2).prod(axis=-1))


def along_v(by: Movement) -> Movement:
    """Movement of (u, v) by a function of them, along v alone."""

    def moved(uv: np.ndarray) -> np.ndarray:
        s = by(np.clip(uv, 0, 1))
        return uv + np.stack([np.zeros_like(s), s], -1)

    return moved


def lattice(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.stack(np.meshgrid(u, v, indexing="ij"), -1).reshape(-1, 2)


def carried(nets: np.ndarray, move: Movement) -> np.ndarray:
    """Nets (k, M, N, 3) that are at ``move(u, v)`` what those given are at (u, v)."""
    k, *shape, _ = nets.shape
    uv = lattice(*(np.linspace(0, 1, n) for n in GRID))
    before = basis_matrix(tuple(shape), *uv.T)
    after = basis_matrix(tuple(shape), *np.clip(move(uv), 0, 1).T)
    values = before @ nets.reshape(k, -1, 3).swapaxes(0, 1).reshape(-1, 3 * k)
    normal = after.T @ after / len(uv) + 1e-9 * bending_matrix(tuple(shape))
    found = splu(sparse.csc_array(normal)).solve(after.T @ values / len(uv))
    left = np.sqrt(((after @ found - values) ** 2).mean() / (values**2).mean())
    print(f"modes carried, all but {left:.2%} of them (root mean square)")
    return found.reshape(-1, k, 3).swapaxes(0, 1).reshape(nets.shape)


def distances(surface: BSplineSurface, points, uv, area, detail) -> str:
    """RMS distance along the normals to points of the average head's skin, mm."""
    off = points - surface.evaluate(*uv.T)
    off = (off * surface.normals(*uv.T)).sum(1)

    def rms(which):
        return np.sqrt(np.average(off[which] ** 2, weights=area[which]))

    found = {"all": rms(np.ones(len(off), bool))}
    for name, away in detail.items():
        found[f"{name} +-{NEAR:.0f}"] = rms(away < NEAR)
    return ", ".join(f"{name} {value:.3f}" for name, value in found.items())


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--source", type=Path, required=True)
    parser.add_argument(
        "--weight", type=float, default=1e-3, help="of the lines; default %(default)s"
    )
    parser.add_argument("--shift", type=float, metavar="SPANS")
    parser.add_argument("-o", "--output", type=Path, required=True)
    a = parser.parse_args()
    template = load_template()
    shape = template.surface.shape
    spans = np.array(shape) - 3
    lines = feature_lines(template)
    if a.shift is None:
        move = aligned(lines, template.outline_uv, spans, a.weight)
    else:
        move = shifted(spans, a.shift)

    head = np.load(a.source / "mean_head.npz", allow_pickle=False)
    caps = np.load(a.source / "uv_param.npz", allow_pickle=False)
    V, tri, kind, patch_uv, _ = face_patch(head, caps)
    S, old_uv, repeat = triangle_samples(patch_uv, tri)
    uv = S @ move(patch_uv)
    weight = sample_weights(V, tri, kind, S, uv, repeat)
    net = (fit_operator(shape, S, uv, weight, BENDING) @ V).reshape(*shape, 3)
    surface = BSplineSurface(net)
    print(f"{folded(move(patch_uv), tri)} triangles of the patch folded")

    skin = (np.repeat(kind, repeat) == 0) & ((uv > 0) & (uv < 1)).all(1)
    points, area = (S @ V)[skin], np.repeat(vertex_areas(V, tri)[0], repeat)[skin]
    detail = {
        name: cKDTree(V[np.unique(tri[kind == k])]).query(points)[0]
        for name, k in FEATURES.items()
    }
    for name, fitted, at in (
        ("bundled", template.surface, old_uv),
        ("this", surface, uv),
    ):
        found = distances(fitted, points, at[skin], area, detail)
        print(f"distance to the average head, mm, {name}: {found}")
    moved = [replace(line, uv=move(part(line.uv, (0, 1)))) for line in lines]
    print(table(surface, moved))

    with np.load(BUNDLED, allow_pickle=False) as z:
        arrays = {k: z[k] for k in z.files}
    arrays["control_points"] = net
    for name in ("identity_modes", "expression_modes"):
        arrays[name] = carried(arrays[name].astype(float), move).astype(np.float16)
    for name in ("landmark_uv", "outline_uv"):
        arrays[name] = np.clip(move(arrays[name]), 0, 1)
    arrays["skin"] = skin_map(move(patch_uv), tri, kind)
    np.savez_compressed(a.output, **arrays)
    load_template(a.output)
    print(f"wrote {a.output}")


if __name__ == "__main__":
    main()
