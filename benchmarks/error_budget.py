#!/usr/bin/env python3
"""Error budget: what each cause costs, one part replaced by the truth at a time.

    python benchmarks/error_budget.py                      three sets, all rows
    python benchmarks/error_budget.py --sets ict-a/S1 --rows "true cameras"
    python benchmarks/error_budget.py --setting iterations=2    quick look

The rest of the program runs as it always does, with the same landmarks.  Light and
albedo of the renderer are not those of the model: what stands in for them is the light
and the albedo that the model finds on the true face.  Written into ``--out``:
``error_budget.csv``.
"""

from __future__ import annotations

import argparse
import logging
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from _faces import surface_face
from _methods import changed_settings
from _parts import estimated_surface
from _sets import EVAL, ROOT, each_set, find_sets, load_measure, load_set, score
from _table import averages, text_table, write_csv
from _true_light import HeldShading
from _truth import (
    Truth,
    fit_truth,
    true_cameras,
    true_landmarks,
    true_template,
)
from bsface.camera.camera import Camera
from bsface.prepare import collect_photos, make_problem
from bsface.problem import FaceEstimate, PhotoCollection, Problem
from bsface.progress import never_cancelled
from bsface.settings import Settings
from bsface.solve.joint.method import joint
from bsface.solve.joint.options import JointOptions
from bsface.solve.joint.refine import JointParts
from bsface.surface.bspline import BSplineSurface
from bsface.surface.prior import shape_prior
from bsface.surface.template import Template, load_template
from bsface.threads import one_blas_thread

SETS = ["ict-a/S1", "ict-b/S1", "mh-c/S1"]
CAMERAS, LANDMARKS, START, MEAN = "cameras", "landmarks", "start", "mean"
LIGHTS, ALBEDO = "lights", "albedo"
FLOOR, DEFAULT = "representation floor", "default"
#: Row -> parts that are true in it, factor on the width of the prior.
ROWS: dict[str, tuple[frozenset[str], float]] = {
    DEFAULT: (frozenset(), 1.0),
    "true cameras": (frozenset({CAMERAS}), 1.0),
    "true landmarks": (frozenset({LANDMARKS}), 1.0),
    "true lights": (frozenset({LIGHTS}), 1.0),
    "true albedo": (frozenset({ALBEDO}), 1.0),
    "true start": (frozenset({START}), 1.0),
    "prior mean at the truth": (frozenset({MEAN}), 1.0),
    "wide prior": (frozenset(), 2.0),
    "narrow prior": (frozenset(), 0.5),
    "all of these true": (
        frozenset({CAMERAS, LANDMARKS, LIGHTS, ALBEDO, MEAN}),
        1.0,
    ),
    FLOOR: (frozenset(), 1.0),
}
NUMBERS = ("mean", "median", "rms", "p90", "normals")
COLUMNS = (
    ("mean", "mean %", ".2f"),
    ("change", "change", "+.2f"),
    ("rms", "RMS %", ".2f"),
    ("normals", "normals", ".1f"),
    ("turn", "change", "+.1f"),
    ("seconds", "s", ".0f"),
)


def main() -> None:
    """Run the command line."""
    options = arguments()
    load_measure(options.data)
    wanted = options.sets or (SETS if options.data == EVAL else None)
    names = find_sets(options.data, wanted)
    unknown = sorted(set(options.rows) - set(ROWS))
    if unknown:
        raise SystemExit(f"no row {', '.join(unknown)}: {', '.join(ROWS)}.")
    work = partial(
        budget,
        data=options.data,
        settings=changed_settings(options.setting),
        wanted=tuple(options.rows),
    )
    rows: list[dict[str, Any]] = []
    for found in each_set(work, names, options.jobs):
        rows += found
        write_csv(options.out / "error_budget.csv", rows)
    print("\n" + text_table(with_changes(rows), COLUMNS, [("row", "row")]))
    print(f"\nmean over {', '.join(names)}; written: {options.out}/error_budget.csv")


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=EVAL, help="folder of the sets")
    parser.add_argument("--sets", nargs="+", metavar="PERSON/SET")
    parser.add_argument("--rows", nargs="+", metavar="ROW", default=list(ROWS))
    parser.add_argument("--setting", action="append", default=[], metavar="NAME=VALUE")
    parser.add_argument("--jobs", type=int, default=1, help="sets at a time")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "error_budget")
    return parser.parse_args()


def budget(
    name: str, data: Path, settings: Settings, wanted: Sequence[str]
) -> list[dict[str, Any]]:
    """All rows of one set."""
    logging.getLogger("bsface").setLevel(logging.ERROR)
    measure, one = load_measure(data), load_set(data, name)
    template = load_template().resampled(settings.control_points)
    collection = collect_photos(one.photos, settings)
    # A wide, short-ranged prior: the fit is to have all the detail that the net can.
    loose = shape_prior(template, settings.modes, settings.expression_modes, 2.0, 0.05)
    truth = fit_truth(measure, one, template, loose)
    cameras = true_cameras(data / name, [p.name for p in collection.photos], truth)
    rows = []
    for row in wanted:
        true, width = ROWS[row]
        started = time.perf_counter()
        if row == FLOOR:
            surface = truth.surface
        else:
            changed = widened(settings, width)
            surface = replaced(true, collection, template, truth, cameras, changed)
        seconds = time.perf_counter() - started
        found = score(measure, surface_face(surface, template), one)
        rows.append({"set": name, "row": row})
        rows[-1] |= {k: getattr(found, k) for k in NUMBERS}
        if row != FLOOR:
            rows[-1]["seconds"] = seconds
        print(
            f"{name}, {row}: mean {found.mean:.2f} %, normals {found.normals:.1f} "
            f"degrees, {seconds:.0f} s",
            flush=True,
        )
    return rows


def widened(settings: Settings, width: float) -> Settings:
    """The settings with all standard deviations of the prior times ``width``."""
    return replace(
        settings,
        modes=width * settings.modes,
        expression_modes=width * settings.expression_modes,
        smooth_mm=width * settings.smooth_mm,
    )


def replaced(
    true: frozenset[str],
    collection: PhotoCollection,
    template: Template,
    truth: Truth,
    cameras: list[Camera],
    settings: Settings,
) -> BSplineSurface:
    """The face that the program makes when some parts are the truth."""
    model = template
    if LANDMARKS in true:
        collection, model = true_landmarks(collection, template, truth, cameras)
        settings = replace(settings, landmark_offset_mm=0.1, landmark_noise_mm=0.1)
    if MEAN in true:
        model = true_template(model, truth)
    problem = make_problem(collection, model, settings)
    parts = JointParts()
    if {LIGHTS, ALBEDO} & true:
        held = HeldShading(
            truth,
            cameras,
            collection.photos,
            JointOptions.of(problem),
            LIGHTS in true,
            ALBEDO in true,
        )
        parts = JointParts(shading=held, terms=held.terms)
    if START in true:
        start = true_start(problem, truth, cameras)
        with one_blas_thread():
            *_, last = joint(problem, start, never_cancelled, parts)
        return last.estimate.surface
    return estimated_surface(problem, parts, cameras if CAMERAS in true else None)


def true_start(problem: Problem, truth: Truth, cameras: list[Camera]) -> FaceEstimate:
    """The truth as an estimate, which the joint step is free to leave."""
    template, marks = problem.template, problem.landmarks
    offset = template.landmark_xyz[marks.index]
    offset = offset - template.surface.evaluate(*marks.uv.T)
    n = len(cameras)
    return FaceEstimate(
        surface=truth.surface,
        cameras=tuple(cameras),
        landmarks_xyz=truth.surface.evaluate(*marks.uv.T) + offset,
        expressions=np.zeros((n, 0)),
        modes=truth.modes,
        smooth=truth.smooth,
        photo_weights=np.ones(n),
    )


def with_changes(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Means over the sets, and their change against the default."""
    table: list[dict[str, Any]] = averages(rows, [*NUMBERS, "seconds"], "row")
    base = next((line for line in table if line["row"] == DEFAULT), None)
    for line in table if base else ():
        line["change"] = line["mean"] - base["mean"]  # type: ignore[index]
        line["turn"] = line["normals"] - base["normals"]  # type: ignore[index]
    return table


if __name__ == "__main__":
    main()
