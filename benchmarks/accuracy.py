#!/usr/bin/env python3
"""Surface error on photo sets with ground truth: the paper's Table 1, and more.

    python benchmarks/accuracy.py                          all sets, all methods
    python benchmarks/accuracy.py --sets ict-a/S1 --methods template default
    python benchmarks/accuracy.py --data FOLDER            any sets in that layout
    python benchmarks/accuracy.py --ablation               each ingredient off in turn
    python benchmarks/accuracy.py --ablation light photos  only these groups
    python benchmarks/accuracy.py --setting smooth_mm=2    with another default

Measured by the ``evaluate.py`` of the data folder: similarity alignment, distance from
the ground truth to the surface in % of the eye distance, weighted by area, and the
angle between the normals.  Landmarks are detected once for each set and shared by all
methods; the seconds of a row include them.  Written into ``--out``: ``accuracy.csv``
and ``accuracy.html`` (error maps and renders), or ``ablation.csv``.
"""

from __future__ import annotations

import argparse
import json
import logging
import time
from pathlib import Path

from _ablation import GROUPS, run_ablation
from _methods import available, run
from _page import SetPictures, set_pictures, write_page
from _reliability import reliability, reliability_table
from _sets import EVAL, ROOT, FaceSet, find_sets, load_measure, load_set, score
from _table import COLUMNS, averages, text_table, write_csv
from bsface.errors import ReconstructionError
from bsface.evidence.gather import Gathered, gather
from bsface.settings import Settings
from bsface.surface.template import load_template

#: One set for each person and family of heads, so that no ablation is one face's.
ABLATION_SETS = ["ict-a/S1", "ict-b/S1", "mh-c/S1"]


def main() -> None:
    """Run the command line."""
    options = arguments()
    # What the photos cannot tell is said for one face, not for every row of a table.
    logging.getLogger("bsface").setLevel(logging.ERROR)
    settings = changed_settings(options.setting)
    measure = load_measure(options.data)
    wanted = options.sets
    if wanted is None and options.ablation is not None and options.data == EVAL:
        wanted = ABLATION_SETS
    names = find_sets(options.data, wanted)
    if options.ablation is not None:
        run_ablation(
            [load_set(options.data, name) for name in names],
            measure,
            settings,
            options.ablation or list(GROUPS),
            options.out,
        )
        return
    methods = available(options.methods)
    template = load_template().resampled(settings.control_points)
    rows: list[dict[str, object]] = []
    pictures: list[SetPictures] = []
    spread: list[dict[str, object]] = []
    for name in names:
        one = load_set(options.data, name)
        gathered, seconds = gathered_of(one, settings)
        total = len(gathered.photos) + len(gathered.failures)
        print(f"\n{name}: {total} photos, landmarks {seconds:.0f} s", flush=True)
        drawn = {}
        for method in methods:
            outcome = run(method, gathered, template, settings)
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
        pictures.append(set_pictures(one, drawn))
        # After each set, so that a long run that is stopped leaves what it has.
        write_csv(options.out / "accuracy.csv", rows)
        write_page(options.out / "accuracy.html", rows, pictures, settings, spread)
    if spread:
        write_csv(options.out / "reliability.csv", spread)
    report(rows, spread)
    print(f"\nwritten: {options.out}/accuracy.csv, {options.out}/accuracy.html")


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
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "accuracy")
    return parser.parse_args()


def changed_settings(pairs: list[str]) -> Settings:
    """The default settings with some changed, ``NAME=VALUE`` each."""
    values = {}
    for pair in pairs:
        name, _, value = pair.partition("=")
        try:
            values[name] = json.loads(value)
        except json.JSONDecodeError:
            values[name] = value
    try:
        return Settings.from_dict(values)
    except (ValueError, TypeError) as error:
        raise SystemExit(str(error)) from None


def gathered_of(one: FaceSet, settings: Settings) -> tuple[Gathered, float]:
    """Photos and landmarks of a set, and how long they took."""
    started = time.perf_counter()
    try:
        gathered = gather(one.photos, settings)
    except ReconstructionError as error:
        raise SystemExit(str(error)) from None
    return gathered, time.perf_counter() - started


def one_line(row: dict[str, object]) -> str:
    """A row as it is finished."""
    if row["note"]:
        return f"{row['method']}: failed: {row['note']}"
    return (
        f"{row['method']}: mean {row['mean']:.2f} %, normals {row['normals']:.1f} "
        f"degrees, {row.get('seconds', 0):.0f} s"
    )


def report(rows: list[dict[str, object]], spread: list[dict[str, object]]) -> None:
    """Print the tables."""
    print("\n" + text_table(rows, COLUMNS, [("set", "set"), ("method", "method")]))
    keys = [k for k, _, _ in COLUMNS]
    for title, chosen in (
        ("one expression (S1-S4)", [r for r in rows if r["set"][-2:] != "S5"]),
        ("mixed expressions (S5)", [r for r in rows if r["set"][-2:] == "S5"]),
    ):
        if chosen:
            print(f"\nmean over the sets with {title}")
            means = averages(chosen, keys, "method")
            print(text_table(means, COLUMNS, [("method", "method"), ("sets", "sets")]))
    if spread:
        print("\n" + reliability_table(spread))


if __name__ == "__main__":
    main()
