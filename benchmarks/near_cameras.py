#!/usr/bin/env python3
"""Photos from arm's length, with and without the focal length in their files.

    python benchmarks/near_cameras.py                  four people, all photos and five
    python benchmarks/near_cameras.py --sets ict-a/S1 --counts 10

Each photo of a set is taken again by a camera in the same direction, at 350 to 500 mm:
every pixel of the new photo shows the point of the true mesh that it sees there, or of
a plane behind the head, in the colours of the old photo.  The face keeps its size.
EXIF names the focal length as phones do, in whole millimetres of 35 mm film.  The rows
are photos from where they were taken ("far") and from near, with EXIF read or not.
Written into ``--out``: ``near_cameras.csv`` and the photos.
"""

from __future__ import annotations

import argparse
import json
import logging
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from _faces import surface_face
from _sets import (
    EVAL,
    ROOT,
    each_set,
    find_sets,
    load_measure,
    load_set,
    score,
    some_photos,
)
from _table import text_table, write_csv
from bsface.drawing.rasterize import rasterize
from bsface.images.focal_length import FILM_DIAGONAL_MM
from bsface.prepare import collect_photos, make_problem
from bsface.problem import PhotoCollection
from bsface.reconstruct import solve
from bsface.settings import Settings
from bsface.surface.template import load_template
from numpy.typing import NDArray
from PIL import Image

Array = NDArray[np.float64]

SETS = ["ict-a/S1", "ict-b/S1", "ict-g/S1", "mh-c/S1"]
NEAR_MM = (350.0, 500.0)
BEHIND_MM = 20.0  # the plane, from the middle between the eyes
SHAPE = 4 / 3  # of the new photos, as phones have it
EXIF, FOCAL_IN_35_MM, PIXELS = 0x8769, 41989, (40962, 40963)
COLUMNS = (("mean", "mean %", ".2f"), ("normals", "normals", ".1f"))
LABELS = [("set", "set"), ("photos", "photos"), ("taken", "taken"), ("exif", "EXIF")]


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=EVAL, help="folder of the sets")
    parser.add_argument("--sets", nargs="+", metavar="PERSON/SET", default=SETS)
    parser.add_argument("--counts", nargs="+", type=int, default=[40, 5])
    parser.add_argument("--jobs", type=int, default=1, help="sets at a time")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "near_cameras")
    options = parser.parse_args()
    load_measure(options.data)
    names = find_sets(options.data, options.sets)
    work = partial(
        measured, data=options.data, out=options.out, counts=tuple(options.counts)
    )
    rows: list[dict[str, Any]] = []
    for found in each_set(work, names, options.jobs):
        rows += found
        write_csv(options.out / "near_cameras.csv", rows)
    print(text_table(rows, COLUMNS, LABELS))


def measured(
    name: str, data: Path, out: Path, counts: Sequence[int]
) -> list[dict[str, Any]]:
    """All rows of one set."""
    logging.getLogger("bsface").setLevel(logging.ERROR)
    measure, one = load_measure(data), load_set(data, name)
    settings, rows = Settings(), []
    template = load_template().resampled(settings.control_points)
    for taken in ("far", "near"):
        folder = out / name / taken
        retake(data / name, folder, near=taken == "near")
        collection = collect_photos(folder, settings)
        for count in counts:
            for told in (False, True):
                chosen = chosen_photos(collection, count, told)
                problem = make_problem(chosen, template, settings)
                face = solve(problem)
                found = score(measure, surface_face(face.surface, face.template), one)
                rows.append({"set": name, "photos": len(chosen.photos), "taken": taken})
                rows[-1] |= {"exif": "yes" if told else "no"}
                rows[-1] |= {k: getattr(found, k) for k, _, _ in COLUMNS}
    return rows


def chosen_photos(
    collection: PhotoCollection, count: int, told: bool
) -> PhotoCollection:
    """So many photos of a collection, with the focal length of their files or not."""
    total = len(collection.photos)
    which = np.linspace(0, total - 1, min(count, total)).astype(int)
    found = some_photos(collection, which)
    if told:
        return found
    untold = tuple(replace(photo, focal_px=None) for photo in found.photos)
    return replace(found, photos=untold)


def retake(source: Path, folder: Path, near: bool) -> None:
    """Take all photos of a set again, from near or from where they were taken."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(1)
    with np.load(source / "ground_truth.npz") as truth:
        mesh = truth["vertices"], truth["triangles"]
    listed = json.loads((source / "cameras.json").read_text("utf-8"))["images"]
    for one in listed:
        K, R, t = (np.array(one[k], float) for k in ("K", "R", "t"))
        closer = np.exp(rng.uniform(*np.log(NEAR_MM))) / np.linalg.norm(t)
        pixels = cv2.imread(str(source / one["file"]))[..., ::-1]
        taken = retaken(pixels, mesh, (K, R, t), closer if near else 1.0)
        focal = K[0, 0] * (closer if near else 1.0)
        h, w = taken.shape[:2]
        exif = Image.Exif()
        film = round(focal / math.hypot(w, h) * FILM_DIAGONAL_MM)
        exif.get_ifd(EXIF).update({FOCAL_IN_35_MM: film, PIXELS[0]: w, PIXELS[1]: h})
        path = folder / Path(one["file"]).name
        Image.fromarray(taken).save(path, quality=95, exif=exif.tobytes())


def retaken(
    pixels: NDArray[np.uint8],
    mesh: tuple[Array, NDArray[np.int64]],
    camera: tuple[Array, Array, Array],
    closer: float,
) -> NDArray[np.uint8]:
    """The photo of a camera that is moved to ``closer`` times its distance."""
    (vertices, triangles), (K, R, t) = mesh, camera
    h, w = pixels.shape[0], round(pixels.shape[0] * SHAPE)
    middle = K[:2, 2] + ((w - pixels.shape[1]) / 2, 0)
    focal, shift = closer * K[0, 0], closer * t
    seen = vertices @ R.T + shift
    xy = seen[:, :2] / seen[:, 2:] * focal + middle
    raster = rasterize(xy, -seen[:, 2], triangles, (w, h))
    x, y = np.meshgrid(np.arange(w), np.arange(h))
    depth = np.full((h, w), shift[2] + BEHIND_MM)
    across = [(x - middle[0]) / focal * depth, (y - middle[1]) / focal * depth]
    points = (np.stack([*across, depth], 2) - shift) @ R
    points[raster.covered] = raster.interpolate(vertices, triangles)
    there = points @ R.T + t
    at = (there[..., :2] / there[..., 2:] * K[0, 0] + K[:2, 2]).astype(np.float32)
    found = cv2.remap(
        pixels,
        at[..., 0],
        at[..., 1],
        cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(found, np.uint8)


if __name__ == "__main__":
    main()
