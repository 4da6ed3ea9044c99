#!/usr/bin/env python3
"""Errors of the default with other templates: % of the eye distance / degrees.

    python tools/score_templates.py FILE.npz ...
    python tools/score_templates.py FILE.npz --sets ict-b/P5 mh-c/P5

The first column is the bundled template.  All share the landmarks of a set.
"""

from __future__ import annotations

import argparse
import logging
import sys
from pathlib import Path

import numpy as np
from bsface.prepare import collect_photos
from bsface.settings import Settings
from bsface.surface.template import load_template

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
from _methods import run  # noqa: E402
from _sets import EVAL, find_sets, load_measure, load_set, score  # noqa: E402


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("templates", type=Path, nargs="+", metavar="FILE")
    parser.add_argument("--data", type=Path, default=EVAL, help="folder of the sets")
    parser.add_argument("--sets", nargs="+", metavar="PERSON/SET")
    options = parser.parse_args()
    logging.getLogger("bsface").setLevel(logging.ERROR)
    settings = Settings()
    try:
        templates = [
            load_template(path).resampled(settings.control_points)
            for path in (None, *options.templates)
        ]
    except ValueError as error:
        raise SystemExit(str(error)) from None
    measure = load_measure(options.data)
    heads = ["bundled", *(path.stem for path in options.templates)]
    print("| set | " + " | ".join(heads) + " |")
    print("|---" * (len(heads) + 1) + "|")
    found = []
    for name in find_sets(options.data, options.sets):
        one = load_set(options.data, name)
        collection = collect_photos(one.photos, settings)
        row = []
        for template in templates:
            outcome = run("default", collection, template, settings)
            if outcome.face is None:
                raise SystemExit(f"{name}: {outcome.note}")
            measured = score(measure, outcome.face, one)
            row.append((measured.mean, measured.normals))
        found.append(row)
        print(line(name, row), flush=True)
    print(line("mean", np.mean(found, axis=0)))
    rise = np.array(found)[..., 0] - np.array(found)[:, :1, 0]
    cells = [f"{most:+.3f}" for most in rise.max(axis=0)]
    print("| largest rise | " + " | ".join(cells) + " |")


def line(name: str, row) -> str:
    """A row of the table."""
    return f"| {name} | " + " | ".join(f"{m:.3f} / {n:.2f}" for m, n in row) + " |"


if __name__ == "__main__":
    main()
