#!/usr/bin/env python3
"""Real photos of several people, without ground truth.

    python benchmarks/real_photos.py                       all people of the folder
    python benchmarks/real_photos.py --people NAME NAME     two of them
    python benchmarks/real_photos.py --parts halves        only this question
    python benchmarks/real_photos.py --setting modes=0.5   with another default

``--data`` is a folder with one folder of photos a person (four people of Labeled Faces
in the Wild, 35 photos each, 150 pixels).  Three questions, written into ``--out``:

halves    Faces from two disjoint halves of a person's photos: how far apart are they,
          against faces of different people?  Means over several random splits
          (``--splits``), one line per person, and ``halves_map.png``: where on the
          face the halves differ (row 0 = forehead, white = 5 % of the eye distance).
          A similarity aligns corresponding points; the same region for all.  Rows: the
          surface (distance to the closest point, whole face), its 468 landmark points,
          the mean MediaPipe mesh (468 points).
held-out  Landmarks of the other half, with nothing but the pose fitted: distance in %
          of the eye distance, for the face, the template and the mean MediaPipe mesh.
views     Faces from all photos: three views, in clay and with the mean texture.
"""

from __future__ import annotations

import argparse
import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from _compare import (
    area_weights,
    face_parameters,
    held_out_residual,
    landmark_points,
    point_distance,
    pose_only,
    surface_distance,
    within_between,
)
from _meshes import photo_meshes, procrustes_mean, scaled_to_eyes
from _methods import changed_settings
from _sets import ROOT, some_photos
from _table import text_table, write_csv
from bsface.drawing.pictures import encode_jpeg, write_png
from bsface.drawing.render import render_views
from bsface.errors import ReconstructionError
from bsface.files import write_bytes
from bsface.images.colour import to_picture
from bsface.prepare import collect_photos, make_problem
from bsface.problem import PhotoCollection
from bsface.reconstruct import solve
from bsface.settings import Settings
from bsface.surface.alignment import fit_similarity
from bsface.surface.bspline import BSplineSurface
from bsface.surface.template import Template, load_template
from bsface.texture.bake import bake_texture

PHOTOS = ROOT.parent / "shared" / "photos" / "lfw"
#: Texels along a side of the map of differences, and distance of its white.
MAP, BRIGHTEST = 120, 0.05
PARTS = ("halves", "held-out", "views")
HALVES_COLUMNS = (
    ("within", "within %", ".2f"),
    ("within_max", "max", ".2f"),
    ("between", "between %", ".2f"),
    ("between_min", "min", ".2f"),
    ("ratio", "ratio", ".1f"),
    ("matched", "matched", ".0f"),
    ("people", "of", ".0f"),
)
PERSON_COLUMNS = (
    ("within", "within %", ".2f"),
    ("min", "min", ".2f"),
    ("max", "max", ".2f"),
)
HELD_OUT_COLUMNS = (
    ("face", "face %", ".2f"),
    ("template", "template %", ".2f"),
    ("mesh", "mean mesh %", ".2f"),
    ("photos", "photos", ".0f"),
)


@dataclass(frozen=True)
class Half:
    """A face from a part of a person's photos.

    Attributes
    ----------
    surface : BSplineSurface
    mesh : (468, 3) array
        Mean MediaPipe mesh of the same photos, with the same eye distance.
    photos : int array
        Which photos they were.
    """

    surface: BSplineSurface
    mesh: np.ndarray
    photos: np.ndarray


def main() -> None:
    """Run the command line."""
    options = arguments()
    # What the photos cannot tell is said for one face, not for every row of a table.
    logging.getLogger("bsface").setLevel(logging.ERROR)
    settings = changed_settings(options.setting)
    template = load_template().resampled(settings.control_points)
    people = {}
    for name in options.people or sorted(
        p.name for p in options.data.iterdir() if p.is_dir()
    ):
        started = time.perf_counter()
        try:
            collection = collect_photos(options.data / name, settings)
        except ReconstructionError as error:
            raise SystemExit(str(error)) from None
        people[name] = collection
        total = len(collection.photos) + len(collection.failures)
        print(
            f"{name}: {len(collection.photos)} of {total} photos can be used, "
            f"landmarks {time.perf_counter() - started:.0f} s",
            flush=True,
        )
        for failure in collection.failures:
            print(f"  {failure.reason}")
    if {"halves", "held-out"} & set(options.parts):
        splits = [
            {
                name: halves(collection, template, settings, options.seed + k)
                for name, collection in people.items()
            }
            for k in range(options.splits)
        ]
        if "halves" in options.parts:
            report_halves(splits, template, settings, options.out)
        if "held-out" in options.parts:
            report_held_out(people, splits[0], template, settings, options.out)
    if "views" in options.parts:
        for name, collection in people.items():
            views(name, collection, template, settings, options.out)


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=PHOTOS, help="folder of people")
    parser.add_argument("--people", nargs="+", metavar="NAME")
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--seed", type=int, default=0, help="of the first split")
    parser.add_argument("--splits", type=int, default=4, help="for the halves")
    parser.add_argument("--setting", action="append", default=[], metavar="NAME=VALUE")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "real_photos")
    options = parser.parse_args()
    if options.splits < 1:
        parser.error("--splits must be at least 1.")
    if not options.data.is_dir():
        parser.error(f"{options.data} is no folder; name one with --data.")
    return options


def halves(
    collection: PhotoCollection, template: Template, settings: Settings, seed: int
) -> tuple[Half, Half]:
    """Faces from two disjoint random halves of the photos."""
    order = np.random.default_rng(seed).permutation(len(collection.photos))
    meshes = photo_meshes(collection)
    found = []
    for part in (np.sort(order[::2]), np.sort(order[1::2])):
        some = some_photos(collection, part)
        surface = solve(make_problem(some, template, settings)).surface
        mesh = procrustes_mean(meshes[part])
        mesh = scaled_to_eyes(mesh, template, settings.eye_distance_mm)
        found.append(Half(surface, mesh, part))
    return found[0], found[1]


def report_halves(
    splits: Sequence[dict[str, tuple[Half, Half]]],
    template: Template,
    settings: Settings,
    out: Path,
) -> None:
    """Print and write the distances within and between people, means over splits."""
    eye = settings.eye_distance_mm
    uv = face_parameters(template)
    marks = template.landmark_uv
    whole = partial(surface_distance, uv=uv, eye_distance=eye)
    points = partial(point_distance, eye_distance=eye)
    rows = []
    for name, distance in (
        ("face, to the closest point", lambda a, b: whole(a.surface, b.surface)),
        (
            "face, 468 points",
            lambda a, b: points(
                a.surface.evaluate(*marks.T), b.surface.evaluate(*marks.T)
            ),
        ),
        ("mean MediaPipe mesh, 468 points", lambda a, b: points(a.mesh, b.mesh)),
    ):
        found = []
        for pairs in splits:
            first, second = zip(*pairs.values(), strict=True)
            found.append(within_between(first, second, distance))
        row: dict[str, object] = {"what": name}
        row |= {key: float(np.mean([one[key] for one in found])) for key in found[0]}
        row["ratio"] = float(row["between"]) / float(row["within"])
        rows.append(row)
    print(f"\nhalves of {len(splits)} splits, distance in % of the eye distance")
    print(text_table(rows, HALVES_COLUMNS, [("what", "")]))
    write_csv(out / "halves.csv", rows)
    people = []
    for name in splits[0]:
        own = [whole(*(half.surface for half in pairs[name])) for pairs in splits]
        people.append(
            {"person": name, "within": np.mean(own), "max": max(own), "min": min(own)}
        )
    print("\neach person's halves, to the closest point, over the splits")
    print(text_table(people, PERSON_COLUMNS, [("person", "person")]))
    write_csv(out / "halves_people.csv", people)
    every = [pair for pairs in splits for pair in pairs.values()]
    write_png(out / "halves_map.png", _map_of_differences(every, template, eye))


def _map_of_differences(
    pairs: Sequence[tuple[Half, Half]], template: Template, eye_distance: float
) -> np.ndarray:
    """Mean distance of the halves over (u, v), grey, ``(MAP, MAP)`` uint8."""
    at = (np.arange(MAP) + 0.5) / MAP
    v, u = np.meshgrid(at, at, indexing="ij")
    uv = np.stack([u.ravel(), v.ravel()], 1)
    inside = template.inside(uv)
    uv = uv[inside]
    total = np.zeros(len(uv))
    for a, b in pairs:
        points, others = a.surface.evaluate(*uv.T), b.surface.evaluate(*uv.T)
        move = fit_similarity(points, others, area_weights(b.surface, uv))
        total += b.surface.closest_point(move(points))[1] / eye_distance
    grey = np.zeros(MAP * MAP)
    grey[inside] = np.clip(total / len(pairs) / BRIGHTEST, 0, 1)
    return np.round(255 * grey).astype(np.uint8).reshape(MAP, MAP)


def report_held_out(
    people: dict[str, PhotoCollection],
    pairs: dict[str, tuple[Half, Half]],
    template: Template,
    settings: Settings,
    out: Path,
) -> None:
    """Print and write the landmark distances in photos that were not used."""
    rows = []
    for name, (a, b) in pairs.items():
        collection = people[name]
        found: dict[str, list[float]] = {"face": [], "template": [], "mesh": []}
        for half, other in ((a, b), (b, a)):
            faces = {
                "face": landmark_points(half.surface, template),
                "template": template.landmark_xyz,
                "mesh": half.mesh,
            }
            for i in other.photos:
                one = held_out_photo(faces, collection, int(i), template, settings)
                for key, value in one.items():
                    found[key].append(value)
        row: dict[str, object] = {"person": name}
        row |= {key: float(np.mean(values)) for key, values in found.items()}
        rows.append(row | {"photos": len(found["face"])})
    print("\nlandmarks of photos not used, distance in % of the eye distance")
    print(text_table(rows, HELD_OUT_COLUMNS, [("person", "person")]))
    write_csv(out / "held_out.csv", rows)


def held_out_photo(
    faces: dict[str, np.ndarray],
    collection: PhotoCollection,
    i: int,
    template: Template,
    settings: Settings,
) -> dict[str, float]:
    """Distance of each face in one photo, on the same landmarks for all."""
    marks, size = collection.landmarks[i], collection.photos[i].size
    weight = marks.weight * template.landmark_reliable
    start = pose_only(template.landmark_xyz, marks, size, weight, settings.distance_mm)
    # What is turned away is the network's guess.
    normals = template.surface.normals(*template.landmark_uv.T)
    facing = (start.toward(template.landmark_xyz) * normals).sum(1)
    weight = weight * np.clip((facing - 0.1) / 0.3, 0, 1)
    eye = start.s * template.eye_distance
    return {
        key: held_out_residual(Q, marks, size, weight, eye, settings.distance_mm)
        for key, Q in faces.items()
    }


def views(
    name: str,
    collection: PhotoCollection,
    template: Template,
    settings: Settings,
    out: Path,
) -> None:
    """Write three views of a person, in clay above and with the mean texture below."""
    started = time.perf_counter()
    result = solve(make_problem(collection, template, settings))
    texture = bake_texture(result, 1024)
    picture = to_picture(texture.mean)
    clay = render_views(result.surface, template)
    skin = render_views(result.surface, template, colours=picture, shading=0.0)
    path = write_bytes(out / f"{name}.jpg", encode_jpeg(np.concatenate([clay, skin])))
    seconds = time.perf_counter() - started
    print(f"{name}: {len(result.photos)} photos, {seconds:.0f} s: {path}", flush=True)


if __name__ == "__main__":
    main()
