"""The average head, as quads: what a face is continued to.

It comes from ``core/data/head.npz``, which ``tools/build_head.py`` makes out of the
MakeHuman base mesh. Its skin is stored after one subdivision step; the base quads are
every fourth of them, and one more step makes the densest mesh.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy import sparse

from .._types import Array, Indices
from ..npz_arrays import floats, read_arrays

BUNDLED = Path(__file__).resolve().parents[1] / "data" / "head.npz"
MAX_BYTES = 20_000_000
#: The outline of the face in (u, v): ``|(u - u0) / a|^p + |(v - v0) / b|^p = 1``.
MIDDLE, HALF, POWER = (0.5, 0.465), (0.49, 0.455), 4.0
#: Where the (u, v) square lies in the head's picture: left, top and side.
SQUARE = (1 / 6, 1 / 4, 2 / 3)


@dataclass(frozen=True)
class BaseHead:
    """The average head.

    Attributes
    ----------
    points : (p, 3) array
        Millimetres, in the template's frame.
    quads : (q, 4) int array
        Counter-clockwise seen from outside; open at the lids, the lips and the neck.
    uv : (p, 2) array
        (u, v) of the face; NaN where the head is no face.
    place : (p, 2) array
        Place in the head's picture, v downwards.
    lids : tuple of two int arrays
        Vertices of the lid margins, the subject's right eye first, clockwise as seen
        from the front.
    lip_upper, lip_lower : int arrays
        Vertices of the line between the lips, from the subject's right corner to the
        left one; the corners are in both.
    ears : int array
        Vertices of both ears.
    """

    points: Array
    quads: Indices
    uv: Array
    place: Array
    lids: tuple[Indices, Indices]
    lip_upper: Indices
    lip_lower: Indices
    ears: Indices


def face_region(uv: Array) -> Array:
    """How far (u, v) lie from the middle of the face: 1 on its outline, (...,).

    NaN where ``uv`` is.
    """
    off = np.abs(np.asarray(uv, float) - MIDDLE) / HALF
    return (off**POWER).sum(axis=-1) ** (1 / POWER)


@lru_cache(maxsize=3)
def base_head(density: str = "medium") -> BaseHead:
    """The bundled head.

    Parameters
    ----------
    density : "low", "medium" or "high"
        About 2,900, 11,600 or 46,000 quads.
    """
    with BUNDLED.open("rb") as file:
        a = read_arrays(file, MAX_BYTES)
    loops = {
        name: a[name].astype(np.int64)
        for name in ("lids", "lip_upper", "lip_lower", "ears")
    }
    head = BaseHead(
        points=floats(a, "points", None, 3) * float(a["step_mm"]),
        quads=a["quads"].astype(np.int64),
        uv=floats(a, "uv", None, 2, finite=False),
        place=floats(a, "place", None, 2),
        lids=(loops["lids"][0], loops["lids"][1]),
        lip_upper=loops["lip_upper"],
        lip_lower=loops["lip_lower"],
        ears=loops["ears"],
    )
    return {"low": coarser, "medium": lambda x: x, "high": finer}[density](head)


def coarser(head: BaseHead) -> BaseHead:
    """The base quads: without the vertices of the subdivision step."""
    quads = head.quads[:, 0].reshape(-1, 4)
    count = int(quads.max()) + 1

    def kept(loop: Indices) -> Indices:
        return loop[loop < count]

    return BaseHead(
        points=head.points[:count],
        quads=quads,
        uv=head.uv[:count],
        place=head.place[:count],
        lids=(kept(head.lids[0]), kept(head.lids[1])),
        lip_upper=kept(head.lip_upper),
        lip_lower=kept(head.lip_lower),
        ears=kept(head.ears),
    )


def finer(head: BaseHead) -> BaseHead:
    """One step more of the same subdivision (Catmull and Clark 1978).

    (u, v) and the places in the picture are halved along straight lines.
    """
    quads, count = head.quads, len(head.points)
    sides = np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1).reshape(-1, 2)
    edges, of_side, times = np.unique(
        np.sort(sides, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    faces = np.arange(len(quads))
    to_face = _means(faces.repeat(4), quads.ravel(), (len(quads), count))
    numbers = np.arange(len(edges)).repeat(2)
    to_edge = _means(numbers, edges.ravel(), (len(edges), count))
    beside = _means(of_side, faces.repeat(4), (len(edges), len(quads)))
    around = _means(quads.ravel(), faces.repeat(4), (count, len(quads)))
    rim = times == 1
    spokes = _means(edges.ravel(), numbers, (count, len(edges)))
    rim_ends = edges[rim].ravel(), np.flatnonzero(rim).repeat(2)
    rim_spokes = _means(*rim_ends, (count, len(edges)))

    face = to_face @ head.points
    middle = to_edge @ head.points
    edge = np.where(rim[:, None], middle, (middle + beside @ face) / 2)
    valence = np.bincount(edges.ravel(), minlength=count)[:, None]
    inner = around @ face + 2 * (spokes @ middle) + (valence - 3) * head.points
    at_rim = (head.points + rim_spokes @ middle) / 2
    is_rim = np.bincount(rim_ends[0], minlength=count)[:, None] > 0
    old = np.where(is_rim, at_rim, inner / valence)

    edge_number = count + of_side.reshape(quads.shape)
    face_number = np.broadcast_to((count + len(edges) + faces)[:, None], quads.shape)
    before = np.roll(edge_number, 1, axis=1)
    new = np.stack([quads, edge_number, face_number, before], axis=-1)
    number = {(a, b): count + k for k, (a, b) in enumerate(edges.tolist())}

    def halved(loop: Indices) -> Indices:
        pairs = zip(loop.tolist(), np.roll(loop, -1).tolist(), strict=True)
        between = [number.get((min(p), max(p)), -1) for p in pairs]
        both = np.stack([loop, between], axis=1).ravel()
        return both[both >= 0]

    def spread(values: Array) -> Array:
        return np.concatenate([values, to_edge @ values, to_face @ values])

    ear = np.zeros(count)
    ear[head.ears] = 1.0
    return BaseHead(
        points=np.concatenate([old, edge, face]),
        quads=new.reshape(-1, 4),
        uv=spread(head.uv),
        place=spread(head.place),
        lids=(halved(head.lids[0]), halved(head.lids[1])),
        lip_upper=halved(head.lip_upper),
        lip_lower=halved(head.lip_lower),
        ears=np.flatnonzero(spread(ear) > 0.5),
    )


def _means(rows: Indices, columns: Indices, shape: tuple[int, int]) -> sparse.csr_array:
    """Matrix whose rows are the means of the columns listed for them."""
    share = 1.0 / np.bincount(rows, minlength=shape[0])[rows]
    return sparse.coo_array((share, (rows, columns)), shape=shape).tocsr()
