#!/usr/bin/env python3
"""What is lost when the light hardly differs between the photos?

    python benchmarks/one_light.py
    python benchmarks/one_light.py --sets mh-c/S1 --photos 8

No set has one light.  So of each set those photos are taken whose main light, as the
renderer had it, comes from directions that are most alike: seen from the head (as on a
walk round the sitter), or from the camera (as where the sitter turns the head).  Beside
them stand as many photos with lights as different as possible.

light     mean angle of the main lights from the middle one, degrees
spread    second singular value of the intensities, which the warning goes by
warned    whether the result says that the light hardly differs
motion    mean error of the stage before shading, % of the eye distance
error     mean error of the result, and that of its normals in degrees
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from _faces import surface_face
from _sets import EVAL, ROOT, find_sets, load_measure, load_set, score
from _table import text_table, write_csv
from bsface.reconstruct import reconstruct
from bsface.surface.template import load_template

COLUMNS = (
    ("light", "light deg", ".0f"),
    ("spread", "spread", ".3f"),
    ("warned", "warned", ""),
    ("motion", "motion %", ".2f"),
    ("error", "error %", ".2f"),
    ("normal", "normals deg", ".1f"),
)
SEEN_FROM = {
    "alike from the head": "direction",
    "alike from the camera": "direction_camera",
}


def main() -> None:
    """Run the command line."""
    p = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    p.add_argument("--data", type=Path, default=EVAL)
    p.add_argument("--sets", nargs="+", default=["ict-a/S1", "ict-b/S1", "mh-c/S1"])
    p.add_argument("--photos", type=int, default=12)
    p.add_argument("--out", type=Path, default=ROOT / "out" / "one_light")
    options = p.parse_args()
    measure = load_measure(options.data)
    rows = []
    for name in find_sets(options.data, options.sets):
        given = load_set(options.data, name)
        for kind, chosen in subsets(options.data / name, options.photos).items():
            photos = [options.data / name / file for file in chosen.files]
            row: dict[str, object] = {
                "set": name,
                "photos": kind,
                "light": chosen.angle,
            }
            for method in ("motion", "joint"):
                found = reconstruct(photos, method=method)
                face = surface_face(found.surface, load_template())
                result = score(measure, face, given)
                row |= {"motion": result.mean} if method == "motion" else {}
            row |= {"error": result.mean, "normal": result.normals}
            row["warned"] = (
                "yes" if any("light" in said for said in found.warnings) else "no"
            )
            row["spread"] = float(found.photometric.singular_values[1])
            rows.append(row)
            print(row, flush=True)
    print(text_table(rows, COLUMNS, [("set", "set"), ("photos", "photos")]))
    write_csv(options.out / "one_light.csv", rows)


class Chosen:
    """Some photos of a set: their files, and how alike their lights are."""

    def __init__(self, files: list[str], directions: np.ndarray) -> None:
        self.files = files
        self.angle = float(angles(directions).mean(axis=1).min())


def subsets(folder: Path, count: int) -> dict[str, Chosen]:
    """Photos with like and with unlike lights."""
    images = json.loads((folder / "lights.json").read_text())["images"]
    files = [image["file"] for image in images]
    found = {}
    for kind, key in SEEN_FROM.items():
        main = main_lights(images, key)
        away = angles(main)
        nearest = np.argsort(away, axis=1, kind="stable")[:, :count]
        middle = np.take_along_axis(away, nearest, axis=1).mean(axis=1).argmin()
        some = np.sort(nearest[middle])
        found[kind] = Chosen([files[i] for i in some], main[some])
    main = main_lights(images, "direction")
    away = angles(main)
    some = [int(away.mean(axis=1).argmax())]
    while len(some) < count:
        some.append(int(away[some].min(axis=0).argmax()))
    some.sort()
    found["as different as possible"] = Chosen([files[i] for i in some], main[some])
    return found


def main_lights(images: list[dict], key: str) -> np.ndarray:
    """Unit vectors toward the mean of all lamps of each photo, (n, 3)."""
    lights = np.array(
        [
            sum(np.multiply(lamp["irradiance"], lamp[key]) for lamp in image["lights"])
            for image in images
        ]
    )
    return lights / np.linalg.norm(lights, axis=1, keepdims=True)


def angles(directions: np.ndarray) -> np.ndarray:
    """Between all pairs, degrees."""
    return np.degrees(np.arccos(np.clip(directions @ directions.T, -1, 1)))


if __name__ == "__main__":
    main()
