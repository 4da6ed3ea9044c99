#!/usr/bin/env python3
"""Builds ``core/data/head.npz``: the average head that a face is continued to.

    python tools/build_head.py --source ../shared/template --output core/data

What goes in: the average MakeHuman head with its parametrisation (``--source``, as for
``tools/build_template.py``), the lids and lips of ``core/data/arkit.npz``, and which
vertices MakeHuman's targets of the ears move (wheel as in ``tools/build_template.py``).
All CC0.

What comes out, per vertex of the head's quads:

* its place, mm;
* (u, v) where it lies on the face patch, NaN elsewhere; lids and lips are laid on the
  curves that the ARKit keys know;
* its place on the head's picture: the face's (u, v) square, scaled, and around it a
  discrete harmonic map of the rest, with the neck's edge on the border of the picture.

The neck is cut along the lowest closed edge loop of the base mesh, so its edge is even.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
from build_template import (
    WHEEL,
    Morphs,
    face_patch,
    fetch_targets,
    sample_identities,
)
from parametrise import folded, mean_value_weights
from scipy import sparse
from scipy.sparse.linalg import splu

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
from core.rig.base_head import (  # noqa: E402
    HALF,
    MIDDLE,
    POWER,
    SQUARE,
    base_head,
    face_region,
)

STEP = 0.01  # mm: places are stored in these steps
INSET = 0.004  # of the neck's edge from the border of the picture
WHOLE = 0.9  # a vertex of the ear moves by this share of the ear's movement
ROUNDS = 4  # of evening out the stretch of the picture


def quads_of(triangles: np.ndarray, base: np.ndarray) -> np.ndarray:
    """(4 k, 4) quads of one subdivision step, four after four of a base quad.

    Each begins at its corner of the base quad; then an edge point, the face point and
    an edge point.
    """
    pieces = defaultdict(list)
    for x, y in zip(triangles[::2].tolist(), triangles[1::2].tolist(), strict=True):
        (own,) = set(x) - set(y)
        (other,) = set(y) - set(x)
        i = x.index(own)
        quad = [own, x[(i + 1) % 3], other, x[(i + 2) % 3]]
        corner = [base[k] >= 0 for k in quad].index(True)
        quad = quad[corner:] + quad[:corner]
        pieces[quad[2]].append(quad)
    result = []
    for four in pieces.values():
        if len(four) == 4:  # others are cut by the border of the source
            after = {quad[3]: quad for quad in four}
            for _ in range(4):
                result.append(four[0])
                four[0] = after[four[0][1]]
    return np.array(result)


def components(quads: np.ndarray, count: int, barrier: np.ndarray) -> np.ndarray:
    """Number of the piece of each quad when the mesh is cut along vertices."""
    open_ = np.setdiff1d(np.arange(count), barrier)
    keep = np.isin(quads, open_)
    row = np.repeat(np.arange(len(quads)), 4)[keep.ravel()]
    incidence = sparse.coo_array(
        (np.ones(len(row)), (row, quads.ravel()[keep.ravel()])),
        shape=(len(quads), count),
    ).tocsr()
    return sparse.csgraph.connected_components(incidence @ incidence.T)[1]


def neck_loop(quads: np.ndarray, vertices: np.ndarray) -> list[int]:
    """The lowest closed edge loop across the neck, of base quads."""
    neighbours, around = defaultdict(set), defaultdict(list)
    for quad in quads.tolist():
        for k in range(4):
            a, b = quad[k], quad[(k + 1) % 4]
            neighbours[a].add(b)
            neighbours[b].add(a)
            around[a].append(set(quad))
    low = [v for v in neighbours if abs(vertices[v, 0]) < 1e-3 and vertices[v, 1] < -90]
    for start in sorted(low, key=lambda v: vertices[v, 1]):
        aside = [v for v in neighbours[start] if vertices[v, 0] > 1e-3]
        loop = [start, *aside[:1]]
        while len(loop) > 1 and len(loop) < 200:
            a, b = loop[-2:]
            beside = set().union(*(quad for quad in around[b] if a in quad))
            on = [v for v in neighbours[b] if v not in beside]
            if len(neighbours[b]) != 4 or len(on) != 1:
                break
            if on[0] == start:
                return loop
            loop.append(on[0])
    sys.exit("no closed edge loop at the neck")


def head_quads(head) -> np.ndarray:
    """Skin from the neck's edge upwards, with nostrils, without eyes and mouth."""
    vertices = head["vertices"].astype(float)
    quads = quads_of(head["triangles"], head["base_vertex_index"])
    loops = [head["loop_lip"], head["loop_eyelid_left"], head["loop_eyelid_right"]]
    loop = neck_loop(quads[:, 0].reshape(-1, 4), vertices)
    edges = {frozenset(p) for p in zip(loop, loop[1:] + loop[:1], strict=True)}
    between = defaultdict(set)
    for quad in quads.tolist():
        between[quad[1]].add(quad[0])
        between[quad[3]].add(quad[0])
    middle = [v for v, ends in between.items() if frozenset(ends) in edges]
    piece = components(
        quads, len(vertices), np.concatenate([*loops, np.array([*loop, *middle])])
    )
    nose = np.argmax(np.where(head["skin_face"], vertices[:, 2], -np.inf))
    return quads[piece == piece[(quads == nose).any(axis=1).argmax()]]


def on_curve(points: np.ndarray, curve: np.ndarray) -> np.ndarray:
    """Nearest points of an open polygon."""
    a, b = curve[:-1], curve[1:]
    step = b - a
    t = ((points[:, None] - a) * step).sum(2) / (step**2).sum(1)
    foot = a + np.clip(t, 0, 1)[..., None] * step
    best = ((points[:, None] - foot) ** 2).sum(2).argmin(1)
    return foot[np.arange(len(points)), best]


def from_right(loop: np.ndarray, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Upper and lower half of a loop of vertices, u rising, corners in both."""
    loop = np.roll(loop, -uv[loop, 0].argmin())
    last = uv[loop, 0].argmax()
    one, two = loop[: last + 1], np.append(loop[last:], loop[0])[::-1]
    return (one, two) if uv[one, 1].mean() < uv[two, 1].mean() else (two, one)


def length_share(points: np.ndarray) -> np.ndarray:
    """How far along its polygon each point lies, 0 to 1."""
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.append(0, np.cumsum(step)) / step.sum()


def superellipse(angle: np.ndarray, half, power: float) -> np.ndarray:
    """Points of ``|x / a|^p + |y / b|^p = 1`` on rays from its middle."""
    ray = np.stack([np.sin(angle), -np.cos(angle)], 1)
    return ray / ((np.abs(ray) / half) ** power).sum(1, keepdims=True) ** (1 / power)


def chart(vertices, quads, uv, rim, square) -> np.ndarray:
    """Places on the head's picture, v downwards, of a mirror symmetric head.

    The half with x >= 0 without its face is a strip: from the face to the neck's edge
    one way, from the midline over the head to that under the chin the other way. It
    is laid on the rectangle of `to_square` by mean-value weights, with the stretch
    evened out as in `parametrise.embed`.
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


def build(source: Path, targets: Path | None) -> dict[str, np.ndarray]:
    from core.rig.arkit import face_units, lid_slit
    from core.rig.grid import along

    head = np.load(source / "mean_head.npz", allow_pickle=False)
    param = np.load(source / "uv_param.npz", allow_pickle=False)
    V = head["vertices"].astype(float)
    quads = head_quads(head)
    _, patch, kind, patch_uv, _ = face_patch(head, param)
    uv = np.full((len(V), 2), np.nan)
    used = np.unique(patch[kind == 0])
    used = used[used < len(V)]
    inside = ((patch_uv[used] > 0) & (patch_uv[used] < 1)).all(1)
    uv[used[inside]] = patch_uv[used[inside]]
    # The head is mirror symmetric; so are its corners of eyes and mouth.
    uv = (uv + (uv[head["mirror"]] * (-1, 1) + (1, 0))) / 2
    units = face_units()
    banks = []
    for side, lids in zip(("right", "left"), units.lids_uv, strict=True):
        halves = from_right(head[f"loop_eyelid_{side}"], uv)
        for half, curve in zip(halves, vars(lid_slit(lids)).values(), strict=True):
            uv[half] = on_curve(uv[half], curve)
        banks.append(halves)
    lips = from_right(head["loop_lip"], uv)
    for half in lips:
        share = length_share(uv[half])
        uv[half] = along(units.lips_uv, (share + 1 - share[::-1]) / 2)
    uv = (uv + (uv[head["mirror"]] * (-1, 1) + (1, 0))) / 2

    order = np.unique(quads)
    new = np.full(len(V), -1)
    new[order] = np.arange(len(order))
    quads, uv, points = new[quads], uv[order], V[order]
    corner = quads[:, 0].reshape(-1, 4)
    assert corner.max() + 1 == len(np.unique(corner)), "base vertices come first"
    edges = np.concatenate([quads[:, [k, (k + 1) % 4]] for k in range(4)])
    there = set(map(tuple, edges.tolist()))
    after = {b: a for a, b in there if (b, a) not in there}
    start = min(after, key=lambda v: points[v, 1])
    rim = [start]
    while after[rim[-1]] != start:
        rim.append(after[rim[-1]])
    if points[rim[1], 0] < 0:
        rim = [rim[0], *rim[:0:-1]]
    mirror = new[head["mirror"][order]]
    points = (points + points[mirror] * (-1, 1, 1)) / 2
    place, inner = chart(points, quads, uv, np.array(rim), SQUARE)
    left = points[:, 0] > -1e-6
    place[~left] = place[mirror[~left]] * (-1, 1) + (1, 0)
    fill_pits(place, quads, points, inner)
    tri = np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])
    print(f"picture: {folded(place, tri)} of {len(tri)} triangles folded")
    ears = ear_vertices(quads, head["base_vertex_index"][order], fetch_targets(targets))
    print(
        f"{len(points)} vertices, {len(quads)} quads, {np.isfinite(uv[:, 0]).sum()}"
        f" on the face, edge of {len(rim)}, ears {len(ears)}"
    )
    return {
        "step_mm": np.array(STEP),
        "points": np.round(points / STEP).astype(np.int16),
        "quads": quads.astype(np.uint16),
        "uv": uv.astype(np.float32),
        "place": place.astype(np.float32),
        "lids": new[[np.append(a, b[-2:0:-1]) for a, b in banks]].astype(np.uint16),
        "lip_upper": new[lips[0]].astype(np.uint16),
        "lip_lower": new[lips[1]].astype(np.uint16),
        "ears": ears.astype(np.uint16),
    }


def ear_vertices(quads, base, targets) -> np.ndarray:
    """Vertices of the ears: what MakeHuman's targets move as a whole with them."""
    moved = np.zeros(len(base), bool)
    for name in ("ears/l-ear-trans-up", "ears/r-ear-trans-up"):
        index, vector = targets[name]
        far = np.linalg.norm(vector, axis=1)
        moved |= np.isin(base, index[far > WHOLE * far.max()])
    share = moved.astype(float)
    # A point of the subdivision step is of the ear when the corners around it are.
    for column in (1, 3, 2):
        total = np.bincount(quads[:, column], share[quads[:, 0]], len(base))
        count = np.bincount(quads[:, column], minlength=len(base))
        moved |= (base < 0) & (total > 0.99 * count) & (count > 0)
    return np.flatnonzero(moved)


def measure(source: Path, targets: Path | None, count: int) -> None:
    """Print how far heads lie from those that random MakeHuman identities have.

    Each is continued from its own face in the part that is sure and its rim.
    """
    from core.rig.continuation import Continuation
    from core.rig.head import SHAPE_REACH, SURE, surface_weight
    from core.surface.alignment import fit_similarity

    head = np.load(source / "mean_head.npz", allow_pickle=False)
    quads = head_quads(head)
    order, new = np.unique(quads), np.full(len(head["vertices"]), -1)
    new[order] = np.arange(len(order))
    tri = new[np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])]
    morphs = Morphs(fetch_targets(targets), head["base_vertex_index"][order], tri)
    base = base_head()
    region = face_region(base.uv)
    weight = surface_weight(region)
    sure, seen = region <= SURE, region <= 1
    rest = np.isnan(region) & (np.arange(len(region))[:, None] != base.ears).all(1)
    rest &= (base.points[:, 2] < 0) | (np.abs(base.points[:, 0]) > 20)  # no nostrils
    places = {
        "rim": seen & ~sure,
        "ears": ~rest & ~seen & (base.points[:, 2] < 0),
        "scalp": rest & (base.points[:, 1] > -60),
        "neck": rest & (base.points[:, 1] <= -60),
    }
    ways = {"similarity only": None}
    for reach in sorted({SHAPE_REACH / 4, SHAPE_REACH / 2, SHAPE_REACH, 320.0}):
        ways[f"reach {reach:.0f} mm"] = Continuation(
            base.points, base.quads, weight, reach
        )
    squares = {way: {place: [] for place in places} for way in ways}
    rng = np.random.default_rng(5)
    for moved in sample_identities(morphs, rng, count):
        true = base.points + moved
        placed = fit_similarity(base.points[sure], true[sure])
        back = (true - placed.t) @ placed.R / placed.scale - base.points
        for way, carry in ways.items():
            given = np.where(seen[:, None], back, 0.0)
            made = base.points + (0.0 if carry is None else carry(given))
            off = ((placed(made) - true) ** 2).sum(axis=1)
            for place, where in places.items():
                squares[way][place].append(off[where].mean())
    print(f"RMS distance in mm, {count} random identities")
    print(f"{'':18}" + "".join(f"{place:>8}" for place in places))
    for way, found in squares.items():
        row = "".join(f"{np.sqrt(np.mean(x)):8.1f}" for x in found.values())
        print(f"{way:18}{row}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--source", type=Path, required=True)
    parser.add_argument("--targets", type=Path, help=f"a copy of {WHEEL}")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "core/data")
    parser.add_argument(
        "--measure", type=int, metavar="N", help="compare with N random heads instead"
    )
    a = parser.parse_args()
    if a.measure:
        return measure(a.source, a.targets, a.measure)
    arrays = build(a.source, a.targets)
    np.savez_compressed(a.output / "head.npz", **arrays)
    size = (a.output / "head.npz").stat().st_size
    print(f"wrote {a.output / 'head.npz'} ({size / 1024:.0f} KiB)")


if __name__ == "__main__":
    main()
