#!/usr/bin/env python3
"""Surface error on photo sets with ground truth: the paper's Table 1, and more.

    python benchmarks/accuracy.py                          all sets, all methods
    python benchmarks/accuracy.py --sets ict-a/S1 --methods template default
    python benchmarks/accuracy.py --data FOLDER            any sets in that layout
    python benchmarks/accuracy.py --ablation               each ingredient off in turn
    python benchmarks/accuracy.py --ablation light "68 landmarks"  groups or variants
    python benchmarks/accuracy.py --setting smooth_mm=2    with another default

Measured by the ``evaluate.py`` of the data folder: similarity alignment, distance from
the ground truth to the surface in % of the eye distance, weighted by area, and the
angle between the normals.  Landmarks are detected once for each set and shared by all
methods; the seconds of a row include them.  Written into ``--out``: ``accuracy.csv``
and ``accuracy.html`` (error maps and renders), or ``ablation.csv``.
"""

from __future__ import annotations

import argparse
import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from _ablation import GROUPS, run_ablation
from _methods import available, changed_settings, run
from _page import SetPictures, set_pictures, write_page
from _reliability import reliability, reliability_table
from _sets import EVAL, ROOT, each_set, find_sets, load_measure, load_set, score
from _table import COLUMNS, averages, text_table, write_csv
from bsface.errors import ReconstructionError
from bsface.prepare import collect_photos
from bsface.settings import Settings
from bsface.surface.template import load_template

#: One set for each person and family of heads, so that no ablation is one face's.
ABLATION_SETS = ["ict-a/S1", "ict-b/S1", "mh-c/S1"]


@dataclass(frozen=True)
class SetResult:
    """Everything about one set: rows of the tables, and pictures."""

    rows: list[dict[str, object]]
    pictures: SetPictures
    spread: list[dict[str, object]]


def main() -> None:
    """Run the command line."""
    options = arguments()
    settings = changed_settings(options.setting)
    load_measure(options.data)
    wanted = options.sets
    if wanted is None and options.ablation is not None and options.data == EVAL:
        wanted = ABLATION_SETS
    names = find_sets(options.data, wanted)
    if options.ablation is not None:
        groups = options.ablation or list(GROUPS)
        run_ablation(options.data, names, settings, groups, options.out, options.jobs)
        return
    work = partial(
        run_set,
        data=options.data,
        methods=available(options.methods),
        settings=settings,
    )
    done: list[SetResult] = []
    for found in each_set(work, names, options.jobs):
        done.append(found)
        rows = [row for one in done for row in one.rows]
        spread = [row for one in done for row in one.spread]
        # After each set, so that a long run that is stopped leaves what it has.
        write_csv(options.out / "accuracy.csv", rows)
        write_csv(options.out / "reliability.csv", spread)
        pictures = [one.pictures for one in done]
        write_page(options.out / "accuracy.html", rows, pictures, settings, spread)
    report(rows, spread)
    print(f"\nwritten: {options.out}/accuracy.csv, {options.out}/accuracy.html")


def run_set(
    name: str, data: Path, methods: Sequence[str], settings: Settings
) -> SetResult:
    """All methods on one set."""
    # What the photos cannot tell is said for one face, not for every row of a table.
    logging.getLogger("bsface").setLevel(logging.ERROR)
    measure, one = load_measure(data), load_set(data, name)
    template = load_template().resampled(settings.control_points)
    rows: list[dict[str, object]] = []
    spread: list[dict[str, object]] = []
    drawn = {}
    started = time.perf_counter()
    try:
        collection = collect_photos(one.photos, settings)
    except ReconstructionError as error:
        rows = [{"set": name, "method": m, "note": str(error)} for m in methods]
        print(f"{name}: {error}", flush=True)
        return SetResult(rows, set_pictures(one, {}), [])
    seconds = time.perf_counter() - started
    total = len(collection.photos) + len(collection.failures)
    print(f"\n{name}: {total} photos, landmarks {seconds:.0f} s", flush=True)
    for method in methods:
        outcome = run(method, collection, template, settings)
        row: dict[str, object] = {"set": name, "method": method}
        if outcome.face is not None:
            found = score(measure, outcome.face, one)
            row |= {k: getattr(found, k) for k, _, _ in COLUMNS[:6]}
            drawn[method] = (outcome.face.moved(found.transform), found)
            spread += reliability(one, method, outcome.result, found)
        if outcome.used:
            row["used"] = outcome.used / total
            row["seconds"] = seconds + outcome.seconds
            row["landmark_seconds"] = seconds
        row["note"] = outcome.note
        rows.append(row)
        print("  " + one_line(row), flush=True)
    return SetResult(rows, set_pictures(one, drawn), spread)


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=EVAL, help="folder of the sets")
    parser.add_argument("--sets", nargs="+", metavar="PERSON/SET")
    parser.add_argument("--methods", nargs="+", metavar="METHOD")
    parser.add_argument(
        "--ablation", nargs="*", metavar="GROUP", help=f"of {', '.join(GROUPS)}"
    )
    parser.add_argument("--setting", action="append", default=[], metavar="NAME=VALUE")
    parser.add_argument(
        "--jobs", type=int, default=1, help="sets at a time (the seconds then suffer)"
    )
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "accuracy")
    return parser.parse_args()


def one_line(row: dict[str, object]) -> str:
    """A row as it is finished."""
    if row["note"]:
        return f"{row['set']}, {row['method']}: failed: {row['note']}"
    return (
        f"{row['set']}, {row['method']}: mean {row['mean']:.2f} %, "
        f"normals {row['normals']:.1f} degrees, {row.get('seconds', 0):.0f} s"
    )


def report(rows: list[dict[str, object]], spread: list[dict[str, object]]) -> None:
    """Print the tables."""
    print("\n" + text_table(rows, COLUMNS, [("set", "set"), ("method", "method")]))
    keys = [k for k, _, _ in COLUMNS]
    for title, ends in (
        ("one expression (S1-S4)", "1234"),
        ("mixed expressions (S5)", ("S5",)),
        ("press-like pictures (P5)", ("P5",)),
    ):
        chosen = [r for r in rows if str(r["set"]).endswith(tuple(ends))]
        if chosen:
            print(f"\nmean over the sets with {title}")
            means = averages(chosen, keys, "method")
            print(text_table(means, COLUMNS, [("method", "method"), ("sets", "sets")]))
    if spread:
        print("\n" + reliability_table(spread))


if __name__ == "__main__":
    main()
