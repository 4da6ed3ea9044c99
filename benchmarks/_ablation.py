"""What each ingredient of the default is worth: switched off or changed one at a time.

Ingredients that are settings are changed there.  Those that are not are parts of the
joint step, which takes others in their place (`Variant.parts`).
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from _faces import surface_face
from _methods import Outcome, run
from _parts import Channel, EqualWeights, estimated_surface, nothing_hidden
from _reliability import reliability
from _sets import FaceSet, each_set, load_measure, load_set, score, some_photos
from _table import averages, text_table, write_csv
from bsface.errors import ReconstructionError
from bsface.prepare import collect_photos, make_problem
from bsface.problem import PhotoCollection
from bsface.settings import Settings
from bsface.solve.joint.refine import JointParts
from bsface.surface.template import Template, load_template

Change = Callable[[Settings], Mapping[str, Any]]


@dataclass(frozen=True)
class Variant:
    """One change against the default.

    Attributes
    ----------
    name : str
    settings : mapping, or callable that makes one from the default settings
        Settings that differ.
    landmarks : str
        Scheme that the detected landmarks are reduced to.
    photos : int
        Number of photos; 0 = all.
    parts : JointParts or None
        What is replaced in the joint step.
    """

    name: str
    settings: Mapping[str, Any] | Change = field(default_factory=dict)
    landmarks: str = "468"
    photos: int = 0
    parts: JointParts | None = None

    def changed(self, base: Settings) -> Settings:
        """The settings of this variant."""
        change = self.settings
        return replace(base, **(change(base) if callable(change) else change))


def times(name: str, factor: float) -> Change:
    """The change of one setting by a factor."""
    return lambda base: {name: getattr(base, name) * factor}


#: How many random choices of photos stand for a number of photos.
DRAWS = 3

GROUPS: dict[str, list[Variant]] = {
    "method": [
        Variant("motion only", {"method": "motion"}),
        Variant("alternating (imls)", {"method": "imls"}),
    ],
    "camera": [
        Variant("no perspective", {"perspective": False}),
        Variant("camera distance x 0.5", times("distance_mm", 0.5)),
        Variant("camera distance x 2", times("distance_mm", 2.0)),
        Variant("no expressions", {"expressions": False}),
    ],
    "light": [
        Variant("light of degree 1", {"light_degree": 1}),
        Variant("light of degree 2", {"light_degree": 2}),
        Variant("light of degree 4", {"light_degree": 4}),
        Variant("no shadows", {"shadows": False}),
        Variant(
            "no robust weights", parts=JointParts(shading=EqualWeights(0.06, 1e-3))
        ),
        Variant("intensity noise x 0.5", times("intensity_noise", 0.5)),
        Variant("intensity noise x 2", times("intensity_noise", 2.0)),
        Variant("independence x 0.3", times("independence", 0.3)),
        Variant("independence x 2", times("independence", 2.0)),
    ],
    "image": [
        Variant(
            "hidden points not left out", parts=JointParts(visibility=nothing_hidden)
        ),
        Variant("red channel", parts=JointParts(reader=Channel(0))),
        Variant("green channel", parts=JointParts(reader=Channel(1))),
        Variant("blue channel", parts=JointParts(reader=Channel(2))),
        Variant("finest blur x 0.7", times("finest_blur_mm", 0.7)),
        Variant("finest blur x 2", times("finest_blur_mm", 2.0)),
        Variant("2 iterations a level", {"iterations": 2}),
        Variant("10 iterations a level", {"iterations": 10}),
    ],
    "prior": [
        Variant("no identity modes", {"modes": 0.0}),
        Variant("identity modes x 0.5", times("modes", 0.5)),
        Variant("identity modes x 2", times("modes", 2.0)),
        Variant("no shared expression", {"expression_modes": 0.0}),
        Variant("shared expression x 1.5", times("expression_modes", 1.5)),
        Variant("smooth part x 0.3", times("smooth_mm", 0.3)),
        Variant("smooth part x 3", times("smooth_mm", 3.0)),
        Variant("correlation length x 0.5", times("smooth_length", 0.5)),
        Variant("correlation length x 2", times("smooth_length", 2.0)),
    ],
    "net": [
        Variant("net of 20 x 22", {"control_points": (20, 22)}),
        Variant("net of 30 x 33", {"control_points": (30, 33)}),
        Variant("net of 60 x 66", {"control_points": (60, 66)}),
    ],
    "landmarks": [
        Variant("68 landmarks", landmarks="68"),
        Variant("40 landmarks", landmarks="40"),
        Variant("landmark offset x 0.3", times("landmark_offset_mm", 0.3)),
        Variant("landmark offset x 2", times("landmark_offset_mm", 2.0)),
        Variant("landmark noise x 0.5", times("landmark_noise_mm", 0.5)),
        Variant("landmark noise x 2", times("landmark_noise_mm", 2.0)),
    ],
    "photos": [Variant("1 photo", photos=1)]
    + [Variant(f"{n} photos", photos=n) for n in (3, 5, 10, 20)],
}

COLUMNS = (
    ("mean", "mean %", ".2f"),
    ("change", "change", "+.2f"),
    ("worst", "worst %", ".2f"),
    ("rms", "RMS %", ".2f"),
    ("normals", "normals", ".1f"),
    ("turn", "change", "+.1f"),
    ("seconds", "s", ".0f"),
)


def run_ablation(
    data: Path,
    names: Sequence[str],
    settings: Settings,
    groups: Sequence[str],
    out: Path,
    jobs: int = 1,
) -> None:
    """Run and print the ablation; ``ablation.csv`` is written after each set.

    Parameters
    ----------
    data : Path
        Folder of the sets.
    names : sequence of str
        Sets.
    settings : Settings
        The default that is changed.
    groups : sequence of str
        Of `GROUPS`, or names of single variants.
    out : Path
        Folder.
    jobs : int
        Number of processes.
    """
    every = {v.name for variants in GROUPS.values() for v in variants}
    unknown = sorted(set(groups) - set(GROUPS) - every)
    if unknown:
        raise SystemExit(
            f"no group or variant {', '.join(unknown)}: "
            f"{', '.join([*GROUPS, *sorted(every)])}."
        )
    rows: list[dict[str, Any]] = []
    work = partial(ablate_set, data=data, settings=settings, groups=tuple(groups))
    for found in each_set(work, names, jobs):
        rows += found
        write_csv(out / "ablation.csv", rows)
    print("\n" + text_table(summary(rows), COLUMNS, [("variant", "variant")]))
    print(f"\nmean over {', '.join(names)}; written: {out}/ablation.csv")


def ablate_set(
    name: str, data: Path, settings: Settings, groups: Sequence[str]
) -> list[dict[str, Any]]:
    """All variants on one set, after the template alone and the default."""
    logging.getLogger("bsface").setLevel(logging.ERROR)
    measure, one = load_measure(data), load_set(data, name)
    started = time.perf_counter()
    collection = collect_photos(one.photos, replace(settings, landmarks="468"))
    print(f"\n{name}: landmarks {time.perf_counter() - started:.0f} s", flush=True)
    template = load_template()
    first: dict[str, Any] = {"group": "", "variant": "template alone", "set": name}
    outcome = run("template", collection, template, settings)
    if outcome.face is not None:
        first |= numbers(score(measure, outcome.face, one))
    rows = [first]
    variants = [("", Variant("default"))]
    variants += [
        (group, variant)
        for group, members in GROUPS.items()
        for variant in members
        if group in groups or variant.name in groups
    ]
    for group, variant in variants:
        row = {"group": group, "variant": variant.name, "set": name}
        row |= one_variant(variant, one, collection, template, measure, settings)
        rows.append(row)
        print(
            f"  {name}, {variant.name}: "
            + (row["note"] or f"{row['mean']:.2f} %, {row['normals']:.1f} degrees"),
            flush=True,
        )
    return rows


def one_variant(
    variant: Variant,
    one: FaceSet,
    collection: PhotoCollection,
    template: Template,
    measure: ModuleType,
    settings: Settings,
) -> dict[str, Any]:
    """Numbers of one variant on one set; means over the draws of photos."""
    changed = variant.changed(settings)
    model = template.resampled(changed.control_points)
    results = []
    started = time.perf_counter()
    for chosen in draws(len(collection.photos), variant.photos):
        some = reduced(collection, template, variant.landmarks, chosen)
        if variant.parts is None:
            outcome = run("default", some, model, changed)
        else:
            outcome = run_parts(variant.parts, some, model, changed)
        if outcome.face is None:
            return {"note": f"failed: {outcome.note}"}
        found = score(measure, outcome.face, one)
        result = numbers(found) | {"seconds": outcome.seconds}
        for spread in reliability(one, variant.name, outcome.result, found):
            result["within"] = float(spread["within 68%"])
        results.append(result)
    row: dict[str, Any] = {
        k: float(np.mean([r[k] for r in results])) for k in results[0]
    }
    row["worst"] = max(r["mean"] for r in results)
    row["all_seconds"] = time.perf_counter() - started
    row["note"] = ""
    return row


def run_parts(
    parts: JointParts,
    collection: PhotoCollection,
    template: Template,
    settings: Settings,
) -> Outcome:
    """As `run` of the default, with parts of the joint step replaced."""
    started = time.perf_counter()
    try:
        problem = make_problem(collection, template, settings)
        face = surface_face(estimated_surface(problem, parts), template)
    except (ReconstructionError, np.linalg.LinAlgError) as error:
        return Outcome(None, time.perf_counter() - started, str(error))
    return Outcome(face, time.perf_counter() - started, used=len(problem.photos))


def numbers(found: Any) -> dict[str, float]:
    """What is kept of a score."""
    return {k: getattr(found, k) for k in ("mean", "median", "rms", "p90", "normals")}


def draws(total: int, count: int) -> list[np.ndarray]:
    """Choices of ``count`` of ``total`` photos; 0 or too many = all, once."""
    if not 0 < count < total:
        return [np.arange(total)]
    random = np.random.default_rng(0)
    return [np.sort(random.permutation(total)[:count]) for _ in range(DRAWS)]


def reduced(
    collection: PhotoCollection, template: Template, scheme: str, chosen: np.ndarray
) -> PhotoCollection:
    """Some of the photos, with fewer landmarks."""
    found = some_photos(collection, chosen)
    if scheme == "468":
        return found
    index = template.schemes[scheme]
    marks = tuple(m.subset(scheme, index) for m in found.landmarks)
    return replace(found, landmarks=marks)


def summary(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Means over the sets, and their change against the default."""
    table = averages(rows, ["mean", "rms", "normals", "seconds"], "variant")
    base = next(line for line in table if line["variant"] == "default")
    for line in table:
        worst = [r.get("worst", r.get("mean")) for r in rows]
        worst = [
            w
            for w, r in zip(worst, rows, strict=True)
            if r["variant"] == line["variant"] and w is not None
        ]
        line["worst"] = max(worst, default=float("nan"))
        line["change"] = line["mean"] - base["mean"]  # type: ignore[operator]
        line["turn"] = line["normals"] - base["normals"]  # type: ignore[operator]
    return table
