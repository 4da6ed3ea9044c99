#!/usr/bin/env python3
"""Does the face lie over its photos, seen through the recovered cameras?

    python benchmarks/reprojection.py                 example photos and the real people
    python benchmarks/reprojection.py FOLDER ...      these folders of photos

Medians over all landmarks and photos, in % of the eye distance:

report     landmarks, each with its own offset from the surface, as in the report
as seen    points of the surface, with the expression of each photo
calm       points of the surface as it stands
           (these three against the detected landmarks that the camera sees)
detector   the detected landmarks against the true ones
true       points of the surface against the true landmarks, expression of the photo

The last two only where the true landmarks lie beside the folder (``landmarks_gt.npz``):
68 points, the inner 51, with the median offset of each point over the photos taken out,
because a detector's points and those of the ground truth are defined differently.
"""

from __future__ import annotations

import argparse
import logging
from pathlib import Path

import numpy as np
from _sets import EVAL, ROOT
from _table import text_table, write_csv
from bsface.reconstruct import reconstruct
from bsface.result import Reconstruction
from bsface.texture.views import faces_of

REAL = ROOT.parent / "shared" / "photos" / "lfw"
# The set whose pictures are the examples.
TRUTH = {"examples": EVAL / "mh-c" / "S1"}
# Cosine of the viewing angle below which a landmark is hidden.
SEEN = 0.1
# The contour of the face is no point of the surface.
INNER = slice(17, 68)
LABELS = (("name", "photos of"),)
COLUMNS = (
    ("photos", "used", ".0f"),
    ("report", "report %", ".2f"),
    ("seen", "as seen %", ".2f"),
    ("calm", "calm %", ".2f"),
    ("detector", "detector %", ".2f"),
    ("true", "true %", ".2f"),
)


def away(camera, points, pixels, eye_mm):
    """Way from detected to projected points, % of the eye distance, (f, 2)."""
    return 100 * (camera.project(points) - pixels) / (camera.s * eye_mm)


def against_detections(face: Reconstruction) -> dict[str, float]:
    """Medians over the landmarks that the cameras see."""
    found: dict[str, list] = {"seen": [], "calm": []}
    sure, eye = face.template.landmark_reliable, face.settings.eye_distance_mm
    each = zip(face.cameras, face.landmarks, faces_of(face), strict=True)
    for camera, marks, own in each:
        index = face.template.schemes[marks.scheme]
        used = sure[index] & (marks.weight > 0)
        uv = face.template.landmark_uv[index[used]]
        for name, surface in (("seen", own), ("calm", face.surface)):
            Q = surface.evaluate(*uv.T)
            facing = (camera.toward(Q) * surface.normals(*uv.T)).sum(1)
            d = away(camera, Q, marks.points[used], eye)
            found[name].append(np.linalg.norm(d, axis=1)[facing > SEEN])
    return {name: float(np.median(np.concatenate(d))) for name, d in found.items()}


def against_truth(face: Reconstruction, folder: Path) -> dict[str, float]:
    """Medians against true landmarks, the offset of each point taken out."""
    with np.load(folder / "landmarks_gt.npz") as truth:
        pixels, visible = truth["points2d"], truth["visible"].astype(bool)
    names = sorted(path.name for path in (folder / "images").iterdir())
    rows = [names.index(photo.name) for photo in face.photos]
    uv = face.template.landmark_uv[face.template.schemes["68"]]
    eye = face.settings.eye_distance_mm
    here, detected = [], []
    each = zip(rows, face.cameras, face.landmarks, faces_of(face), strict=True)
    for row, camera, marks, own in each:
        here.append(away(camera, own.evaluate(*uv.T), pixels[row], eye))
        points = marks.points[face.template.schemes["68"]]
        detected.append(100 * (points - pixels[row]) / (camera.s * eye))
    shown = visible[rows][:, INNER]
    medians = {}
    for name, d in (("detector", detected), ("true", here)):
        ways = np.array(d)[:, INNER]
        # np.median over the photos in which the point is visible
        masked = np.where(shown[..., None], ways, np.nan)
        size = np.linalg.norm(ways - np.nanmedian(masked, axis=0), axis=2)
        medians[name] = float(np.median(size[shown]))
    return medians


def row(name: str, photos: Path) -> dict:
    """One line of the table."""
    face = reconstruct(photos)
    pushed = [r.reprojection_pct for r in face.reports if r.status == "used"]
    found = {"name": name, "photos": len(pushed), "report": float(np.median(pushed))}
    found |= against_detections(face)
    truth = TRUTH.get(name, photos.parent)
    if (truth / "landmarks_gt.npz").exists():
        found |= against_truth(face, truth)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "reprojection")
    options = parser.parse_args()
    logging.disable(logging.WARNING)
    sets = {str(path): path for path in options.folders}
    if not sets:
        sets["examples"] = ROOT / "examples" / "photos"
        people = sorted(REAL.iterdir()) if REAL.is_dir() else []
        sets |= {path.name: path for path in people}
    rows = []
    for name, photos in sets.items():
        rows.append(row(name, photos))
        print(f"{name} done", flush=True)
    options.out.mkdir(parents=True, exist_ok=True)
    write_csv(options.out / "reprojection.csv", rows)
    print(text_table(rows, COLUMNS, LABELS))


if __name__ == "__main__":
    main()
