#!/usr/bin/env python3
"""How often drawings and paintings are told, and photos taken for them.

    python benchmarks/drawn.py                          all press and rendered photos
    python benchmarks/drawn.py --people FOLDER --photos 5

``--people`` is a folder with one folder of photos per person; it may be given again.
The face of each photo is turned into worse photos and into drawings, pixel by pixel in
place (`tests/drawings_for_tests.py`), and the landmarks stay.  Into ``--out`` goes
``drawn.csv``: the number of faces, and how many of them get the doubt, in %.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from _sets import EVAL, ROOT
from _table import text_table, write_csv
from bsface.errors import PhotoFailure
from bsface.images.folder import list_photos
from bsface.landmarks.candidates import CandidateReader
from bsface.landmarks.drawn import looks_drawn
from bsface.progress import never_cancelled
from bsface.settings import Settings
from bsface.surface.template import load_template

sys.path.insert(0, str(ROOT / "tests"))

from drawings_for_tests import DRAWINGS, PHOTOS  # noqa: E402

SHARED = ROOT.parent / "shared" / "photos"
STYLES = {f"photo, {name}": style for name, style in PHOTOS.items()}
STYLES |= {f"drawing, {name}": style for name, style in DRAWINGS.items()}


def main() -> None:
    """Run the command line."""
    p = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    p.add_argument("--people", type=Path, action="append", metavar="FOLDER")
    p.add_argument("--photos", type=int, metavar="N", help="of each person, at most")
    p.add_argument("--out", type=Path, default=ROOT / "out" / "drawn")
    options = p.parse_args()
    kinds = options.people or [SHARED / "lfw", SHARED / "athletes", EVAL]
    for kind in kinds:
        if not kind.is_dir():
            p.error(f"{kind} is no folder; name one with --people.")
    told: dict[str, dict[str, list[bool]]] = {name: {} for name in STYLES}
    for kind in kinds:
        for person in sorted(p for p in kind.iterdir() if p.is_dir()):
            if person.name.endswith("-lambert"):
                continue  # without a camera's response and noise
            sets = [p for p in sorted(person.glob("*/images"))] or [person]
            for folder in sets:
                doubts = doubts_of(folder, options.photos)
                for name, found in doubts.items():
                    told[name].setdefault(kind.name, []).extend(found)
                print(f"{folder}: {len(doubts['photo, as it is'])} faces", flush=True)
    rows = [
        {"style": name}
        | {f"{kind} %": 100 * float(np.mean(found)) for kind, found in by_kind.items()}
        | {f"{kind} faces": len(found) for kind, found in by_kind.items()}
        for name, by_kind in told.items()
    ]
    columns = [
        (f"{kind.name} {what}", f"{kind.name} {what}", form)
        for kind in kinds
        for what, form in (("%", ".1f"), ("faces", ".0f"))
    ]
    print(text_table(rows, columns, [("style", "picture")]))
    write_csv(options.out / "drawn.csv", rows)


def doubts_of(folder: Path, most: int | None) -> dict[str, list[bool]]:
    """Whether the largest face of each photo gets the doubt, per style."""
    reader = CandidateReader(load_template(), Settings(), {})
    paths = list_photos(folder)
    if most:
        paths = paths[:: max(len(paths) // most, 1)][:most]
    found: dict[str, list[bool]] = {name: [] for name in STYLES}
    for path in paths:
        faces = reader.read(path, path.name, never_cancelled)
        if isinstance(faces, PhotoFailure) or faces[0].failure is not None:
            continue
        face = faces[0]
        photo = replace(face.photo, pixels=face.photo.bytes8())
        for name, style in STYLES.items():
            copy = replace(photo, pixels=style(photo.pixels))
            found[name].append(looks_drawn(copy, face.landmarks, face.fit))
    return found


if __name__ == "__main__":
    main()
