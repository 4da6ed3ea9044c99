"""What the normal map is worth: normals against the truth, and photos left out.

    python benchmarks/detail.py [SETS ...] [--photos N ...] [--data DIR] [-o out/detail]

Reconstructs each set (by default all of DIR) from N photos each (0 is all of them)
and measures its detail. Prints the mean
angle between the normals and those of the ground truth, over its area, without and with
the map. Then every fourth photo is left out of the detail, and the fine band of what
they show, their light and the albedo of the other photos taken out, is compared with
the map's: root mean square of the relative difference, without and with it. Surface,
cameras and lights know all photos. Writes ``detail.csv``.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
from _faces import surface_face
from _sets import EVAL, FaceSet, find_sets, load_measure, load_set, score
from _table import write_csv
from bsface import Reconstruction, list_photos, reconstruct
from bsface.progress import never_cancelled
from bsface.texture.blend import measured_places
from bsface.texture.delit import DelitPhotos, delit_photos
from bsface.texture.detail import Detail
from bsface.texture.detail_measurement import PhotoDetail, measure_detail
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Array = NDArray[np.float64]

#: Samples a side among which the surface point of a vertex of the truth is looked for.
SAMPLES = 801
#: Larger differences are hair, highlights and shadows: they count as this one.
LARGEST = 0.15


@dataclass(frozen=True)
class TrueNormals:
    """Normals of the truth at parameters of the surface.

    Attributes
    ----------
    uv : (k, 2) array
    normals : (k, 3) array
        In the frame of the surface.
    areas : (k,) array
        Sum 1.
    """

    uv: Array
    normals: Array
    areas: Array


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("sets", nargs="*")
    options.add_argument("--photos", type=int, nargs="+", default=[0], metavar="N")
    options.add_argument("--data", type=Path, default=EVAL)
    options.add_argument("-o", "--output", type=Path, default=Path("out/detail"))
    given = options.parse_args()
    measure = load_measure(given.data)
    rows = []
    for count, name in product(given.photos, find_sets(given.data, given.sets)):
        of = load_set(given.data, name)
        face = reconstruct(spread(list_photos(of.photos), count))
        row = {"set": name, "photos": len(face.photos), **compare(measure, of, face)}
        print(
            f"{name:<10} {len(face.photos):3d} photos  normals {row['flat']:.3f} -> "
            f"{row['bent']:.3f} degrees  left-out photos {row['left_flat']:.4f} -> "
            f"{row['left_bent']:.4f} ({row['left_gain']:+.2f} %)",
            flush=True,
        )
        rows.append(row)
        write_csv(given.output / "detail.csv", rows)


def spread(photos: Sequence[Path], count: int) -> list[Path]:
    """So many photos, evenly spread over all."""
    if not count or count >= len(photos):
        return list(photos)
    return [photos[k * len(photos) // count] for k in range(count)]


def compare(measure: ModuleType, of: FaceSet, face: Reconstruction) -> dict[str, float]:
    """Errors of the normals, and of photos left out, without and with the map."""
    truth = true_normals(measure, of, face)
    delit = delit_photos(face, None, lambda part: None)
    detail = measure_detail(face, delit, measured_places(delit.weight), never_cancelled)
    bent = bent_normals(face, detail, truth.uv)
    flat = face.surface.normals(*truth.uv.T)
    without, with_map = left_out(face, delit)
    return {
        "flat": float(truth.areas @ degrees(flat, truth.normals)),
        "bent": float(truth.areas @ degrees(bent, truth.normals)),
        "left_flat": without,
        "left_bent": with_map,
        "left_gain": 100 * (with_map / without - 1),
        "height": float(detail.displacement[detail.displacement != 0].std()),
    }


def true_normals(measure: ModuleType, of: FaceSet, face: Reconstruction) -> TrueNormals:
    """Of the truth's vertices that count, brought to the face's frame."""
    found = score(measure, surface_face(face.surface, face.template), of)
    scale, R, t = found.transform
    counts = np.asarray(of.truth["mask"], bool)
    points = np.asarray(of.truth["vertices"], float)
    triangles = np.asarray(of.truth["triangles"], int)
    normals = measure.vertex_normals(points, triangles)[counts] @ R
    _, nearest = cKDTree(face.surface.grid(SAMPLES, SAMPLES).reshape(-1, 3)).query(
        (points[counts] - t) @ R / scale
    )
    uv = np.stack([nearest // SAMPLES, nearest % SAMPLES], axis=1) / (SAMPLES - 1)
    return TrueNormals(uv, normals, of.areas()[counts])


def bent_normals(face: Reconstruction, detail: Detail, uv: Array) -> Array:
    """Normals of the surface as the map turns them, ``(k, 3)``."""
    at = (uv * detail.size - 0.5).astype(np.float32)[None]
    found = cv2.remap(
        detail.normals, at, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )[0]
    normal = face.surface.normals(*uv.T)
    tangent = face.surface.evaluate(*uv.T, du=1)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    frame = np.stack([tangent, np.cross(normal, tangent), normal], axis=1)
    turned = np.einsum("kc,kcx->kx", found.astype(float), frame)
    return turned / np.linalg.norm(turned, axis=1, keepdims=True)


def left_out(face: Reconstruction, delit: DelitPhotos) -> tuple[float, float]:
    """Difference in photos that the detail does not know, without and with the map."""
    left = np.arange(len(delit.views)) % 4 == 1
    known = replace(delit, weight=np.where(left[:, None, None], 0, delit.weight))
    detail = measure_detail(face, known, measured_places(known.weight), never_cancelled)
    z_v, z_u = (detail.size * g for g in np.gradient(detail.displacement))
    slopes = np.stack([z_u, z_v], axis=-1)
    seen = PhotoDetail.of(face, delit)
    total, without, with_map = 0.0, 0.0, 0.0
    for start in range(0, seen.size, 64):
        rows = slice(start, start + 64)
        d, h, weight = seen.rows(rows)
        shaded = np.einsum("nrsk,rsk->nrs", h, slopes[rows])
        part = np.where(left[:, None, None], 0, weight)
        enough = part.sum(axis=0) > 0
        part = part / np.maximum(part.sum(axis=0), 1e-12)
        flat = d - (part * d).sum(axis=0)
        bent = flat - (shaded - (part * shaded).sum(axis=0))
        counts = weight[left] * (enough & (detail.displacement[rows] != 0))
        total += counts.sum()
        without += (counts * np.minimum(np.abs(flat[left]), LARGEST) ** 2).sum()
        with_map += (counts * np.minimum(np.abs(bent[left]), LARGEST) ** 2).sum()
    if not total:  # too few photos for any detail
        return float("nan"), float("nan")
    return float(np.sqrt(without / total)), float(np.sqrt(with_map / total))


def degrees(a: Array, b: Array) -> Array:
    """Angles between unit vectors (k, 3)."""
    return np.rad2deg(np.arccos(np.clip((a * b).sum(axis=1), -1, 1)))


if __name__ == "__main__":
    main()
