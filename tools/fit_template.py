#!/usr/bin/env python3
"""Makes a template out of a head mesh of one's own.

    python tools/fit_template.py HEAD.obj LANDMARKS.json -o my_template.npz
    python -m bsface PHOTOS --template my_template.npz -o face.npz

``HEAD.obj``: vertices and faces in any unit, y up, face towards +z, any position;
scans and sculpts alike, with or without eyes and inner mouth.  ``LANDMARKS.json``: a
list of 68 points [x, y, z] on the mesh in iBUG order, null for those that are not
known; the 17 points of the jaw line are not used.

The bundled template is fitted to the mesh: similarity by the landmarks, then closest
points along the normals under the prior of faces, with less and less pull of the
landmarks.  Landmark places, modes and outline come along, so the file works wherever
the bundled template does.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from core.surface.alignment import fit_similarity  # noqa: E402
from core.surface.bspline import BSplineSurface, basis_matrix  # noqa: E402
from core.surface.edited import edited_template  # noqa: E402
from core.surface.prior import shape_prior  # noqa: E402
from core.surface.template import BUNDLED, Template, load_template  # noqa: E402

GRID = 80
ROUNDS = 10
SMOOTH_MM, SMOOTH_LENGTH = 2.0, 0.05
POINT_MM = 0.3  # standard deviation of a closest point
LANDMARK_MM = 1.5


def read_obj(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) and triangles (m, 3) of an OBJ file; polygons become fans."""
    vertices, triangles = [], []
    for number, line in enumerate(path.read_text("utf-8", "replace").splitlines(), 1):
        words = line.split()
        try:
            if words[:1] == ["v"]:
                x, y, z = (float(w) for w in words[1:4])
                vertices.append((x, y, z))
            elif words[:1] == ["f"]:
                corner = [int(w.split("/")[0]) for w in words[1:]]
                corner = [c - 1 if c > 0 else len(vertices) + c for c in corner]
                for k in range(1, len(corner) - 1):
                    triangles.append((corner[0], corner[k], corner[k + 1]))
        except ValueError:
            sys.exit(f"{path}, line {number}: not a vertex or face; export it again.")
    V, tri = np.array(vertices, float).reshape(-1, 3), np.array(triangles, int)
    if len(V) < 100 or not len(tri) or tri.max() >= len(V) or not np.isfinite(V).all():
        sys.exit(f"{path} holds no usable mesh; export vertices and faces as OBJ.")
    return V, tri


def read_landmarks(path: Path) -> np.ndarray:
    """(68, 3) points, NaN where unknown."""
    try:
        rows = json.loads(path.read_text("utf-8"))
        points = [[np.nan] * 3 if r is None else [float(x) for x in r] for r in rows]
        out = np.array(points, float)
    except (ValueError, TypeError) as error:
        sys.exit(f"{path} is no list of 68 points [x, y, z] or null ({error}).")
    if out.shape != (68, 3):
        sys.exit(f"{path} must hold 68 points of 3 numbers, not {out.shape}.")
    return out


def cloud(V: np.ndarray, tri: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points inside all triangles, and their unit normals."""
    p = V[tri]
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    mix = np.array([[1, 1, 1], [4, 1, 1], [1, 4, 1], [1, 1, 4]]) / [[3], [6], [6], [6]]
    return np.concatenate([mix @ q for q in p]), np.repeat(normal, len(mix), axis=0)


def fit(V: np.ndarray, tri: np.ndarray, marks: np.ndarray, base: Template):
    """The bundled template's surface, in its own frame, bent onto the mesh.

    Returns the surface and the root mean square distance of its skin, mm.
    """
    index = base.schemes["68"]
    known = np.isfinite(marks).all(1) & (np.arange(68) >= 17)
    mark_uv = base.landmark_uv[index[known]]
    place = fit_similarity(marks[known], base.surface.evaluate(*mark_uv.T))
    points, normals = cloud(place(V), tri)
    target = place(marks[known])
    tree = cKDTree(points)
    prior = shape_prior(base, 1.0, 1.0, SMOOTH_MM, SMOOTH_LENGTH)
    shape, b_t = base.surface.shape, base.surface.vector
    x = (np.arange(GRID) + 0.5) / GRID
    uv = np.stack(np.meshgrid(x, x, indexing="ij"), -1).reshape(-1, 2)
    uv = uv[base.is_skin(uv)]
    eye = sparse.eye_array(3)
    T = sparse.kron(basis_matrix(shape, *uv.T), eye).tocsr()
    L = sparse.kron(basis_matrix(shape, *mark_uv.T), eye).tocsr()
    Q = sparse.kron(prior.smooth, eye).tocsc()
    modes = prior.modes.reshape(len(prior.modes), -1).T
    d, a = np.zeros(b_t.size), np.zeros(modes.shape[1])
    surface, residual = base.surface, np.zeros(1)
    for turn in range(ROUNDS):
        here, outward = surface.evaluate(*uv.T), surface.normals(*uv.T)
        distance, nearest = tree.query(here)
        n = normals[nearest]
        near = distance < 2.5 + 12 * 0.7**turn
        w = np.where(near & ((n * outward).sum(1) > 0.5), 1 / POINT_MM**2 / 50, 0.0)
        residual = ((points[nearest] - here) * n).sum(1)
        rows = np.repeat(np.arange(len(uv)), 3)
        along = sparse.csr_array((n.ravel(), (rows, np.arange(3 * len(uv))))) @ T
        pull = 0.6**turn / LANDMARK_MM**2
        off = (target - surface.evaluate(*mark_uv.T)).ravel()
        H = along.T @ sparse.diags_array(w) @ along + pull * (L.T @ L)
        g = along.T @ (w * residual) + pull * (L.T @ off)
        HM = H @ modes
        solve = splu(sparse.csc_array(H + Q), permc_spec="MMD_AT_PLUS_A").solve
        Z = solve(np.column_stack([HM, g - Q @ d]))
        corner = modes.T @ HM + np.eye(len(a)) - HM.T @ Z[:, :-1]
        da = np.linalg.solve(corner, modes.T @ g - a - HM.T @ Z[:, -1])
        d, a = d + Z[:, -1] - Z[:, :-1] @ da, a + da
        moved = b_t + (d + modes @ a).reshape(-1, 3)
        surface = BSplineSurface(moved.reshape(*shape, 3))
        residual = residual[w > 0]
    return surface, float(np.sqrt(np.mean(residual**2)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("mesh", type=Path)
    parser.add_argument("landmarks", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    args = parser.parse_args()
    for path in (args.mesh, args.landmarks):
        if not path.is_file():
            sys.exit(f"{path} is not there.")
    V, tri = read_obj(args.mesh)
    marks = read_landmarks(args.landmarks)
    if np.isfinite(marks[17:]).all(1).sum() < 6:
        sys.exit(f"{args.landmarks} must know at least 6 points besides the jaw line.")
    base = load_template()
    surface, rms = fit(V, tri, marks, base)
    made = edited_template(surface, base)
    with np.load(BUNDLED, allow_pickle=False) as z:
        arrays = {k: z[k] for k in z.files}
    arrays["control_points"] = made.surface.control_points
    arrays["landmark_xyz"] = made.landmark_xyz
    arrays["eye_centres"] = made.eye_centres
    temporary = args.output.with_name("." + args.output.name + ".part.npz")
    np.savez_compressed(temporary, **arrays)
    load_template(temporary)
    os.replace(temporary, args.output)
    print(f"wrote {args.output}; distance to the mesh {rms:.2f} mm (root mean square)")


if __name__ == "__main__":
    main()
