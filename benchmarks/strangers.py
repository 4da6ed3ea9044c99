#!/usr/bin/env python3
"""How often strangers among the photos are found, and how often the check errs.

    python benchmarks/strangers.py                      press photos and rendered ones
    python benchmarks/strangers.py --people FOLDER      on people of your own

``--people`` is a folder with one folder of photos a person, at least three people with
35 photos each; it may be given again for another kind of pictures.  Folders are made at
random: of one person, with one stranger, with five photos of another person, and of two
people by halves.  Faces in general are those stored; for the rendered people, of whom
those are made, they are made anew without the people of each folder, so nobody is known
beforehand.  Into ``--out`` goes ``strangers.csv``:

wrong     photos of the person that are left out, in % of them; largest number in a
          folder; folders in which that happens, in %
doubts    folders in which a photo of the person is named in a doubt, in %
found     photos of the stranger that are left out, in %; with the doubts
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from _sets import EVAL, ROOT
from _table import text_table, write_csv
from bsface.identity.descriptor import (
    Appearance,
    MeanAppearance,
    describe_appearance,
    general_of,
    mean_pattern,
    pattern_variance,
    similarity,
)
from bsface.identity.same_person import split_identities
from bsface.prepare import collect_photos
from bsface.settings import Settings

PRESS = ROOT.parent / "shared" / "photos" / "lfw"
# Rendered sets of one person belong together: another expression is no stranger.
SUBSETS = ("S1", "S2", "S3", "S4", "S5")
MIXES = (
    ("one person", ((35, 0), (20, 0), (10, 0), (6, 0))),
    ("one stranger", ((34, 1), (19, 1), (9, 1), (5, 1))),
    ("five of another", ((30, 5), (15, 5))),
    ("two people", ((17, 17), (10, 10), (5, 5))),
)
COLUMNS = (
    ("photos", "photos", ".0f"),
    ("wrong", "wrong %", ".2f"),
    ("wrong_most", "most", ".0f"),
    ("wrong_folders", "folders %", ".0f"),
    ("doubts", "doubts %", ".0f"),
    ("found", "found %", ".0f"),
    ("found_or_doubt", "with doubts %", ".0f"),
)

# Person -> sets of photos; sets of one person are never mixed with each other.
Kind = Mapping[str, Sequence[Appearance]]
# Person -> mean pattern and variance of that person; None where the stored are used.
Own = Mapping[str, tuple[np.ndarray, np.ndarray]] | None


def main() -> None:
    """Run the command line."""
    options = arguments()
    kinds: dict[str, Kind] = {}
    for folder in options.people:
        started = time.perf_counter()
        kinds[folder.name] = kind = read_kind(folder)
        if len(kind) < 2:
            raise SystemExit(f"{folder} holds fewer than two people with photos.")
        taken = time.perf_counter() - started
        print(f"{folder.name}: {', '.join(kind)}; landmarks {taken:.0f} s", flush=True)
    rows = []
    for name, people in kinds.items():
        # Of the rendered people the stored patterns are made.
        known = own_patterns(people) if name == EVAL.name else None
        for mix, sizes in MIXES:
            for own, other in sizes:
                rng = np.random.default_rng([options.seed, own, other])
                row = trials(people, known, own, other, options.folders, rng)
                rows.append({"pictures": name, "folder": mix, **row})
    print(text_table(rows, COLUMNS, [("pictures", "pictures"), ("folder", "folder")]))
    write_csv(options.out / "strangers.csv", rows)


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--people", type=Path, action="append", metavar="FOLDER")
    parser.add_argument("--folders", type=int, default=100, help="of each kind of mix")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "strangers")
    options = parser.parse_args()
    options.people = options.people or [PRESS, EVAL]
    for folder in options.people:
        if not folder.is_dir():
            parser.error(f"{folder} is no folder; name one with --people.")
    return options


def read_kind(folder: Path) -> Kind:
    """The looks of the photos of each person below a folder."""
    settings = Settings(one_person=False)
    found: dict[str, list[Appearance]] = {}
    for person in sorted(p for p in folder.iterdir() if p.is_dir()):
        sets = [person / s / "images" for s in SUBSETS if (person / s).is_dir()]
        if person.name.endswith("-lambert"):
            continue  # without a camera's response and noise
        for photos in sets or [person]:
            if any(photos.glob("*.*")):
                collection = collect_photos(photos, settings)
                seen = describe_appearance(collection.photos, collection.landmarks)
                found.setdefault(person.name, []).append(seen)
    return found


def trials(
    people: Kind,
    known: Own,
    own: int,
    other: int,
    folders: int,
    rng: np.random.Generator,
) -> dict[str, float]:
    """Random folders with ``own`` photos of one person and ``other`` of another."""
    counts = np.array(
        [one_folder(people, known, own, other, rng) for _ in range(folders)]
    )
    wrong, doubt, found, told = counts.T
    return {
        "photos": own + other,
        "wrong": 100 * wrong.sum() / (own * folders),
        "wrong_most": wrong.max(),
        "wrong_folders": 100 * (wrong > 0).mean(),
        "doubts": 100 * (doubt > 0).mean(),
        "found": 100 * found.sum() / (other * folders) if other else "",
        "found_or_doubt": 100 * told.sum() / (other * folders) if other else "",
    }


def one_folder(
    people: Kind,
    known: Own,
    own: int,
    other: int,
    rng: np.random.Generator,
) -> tuple[int, int, int, int]:
    """Of one folder: own photos left out, in doubt; strangers left out, or in doubt."""
    first, second = (str(p) for p in rng.permutation(list(people))[:2])
    parts = [(first, own)] + ([(second, other)] if other else [])
    chosen = [draw(people[p], count, rng) for p, count in parts]
    order = rng.permutation(own + other)
    seen = Appearance(
        np.concatenate([c.pattern for c in chosen])[order],
        np.concatenate([c.weight for c in chosen])[order],
    )
    general = general_without(known, {p for p, _ in parts})
    found = split_identities(*similarity(seen, general))
    stranger = order >= own
    left_out = np.ones(own + other, bool)
    left_out[found.person] = False
    told = left_out.copy()
    for group in found.doubtful:
        told[group] = True
    if 2 * other >= own and (told & ~stranger).sum() > (told & stranger).sum():
        stranger = ~stranger  # by halves either of the two may be called the stranger
    return (
        int((left_out & ~stranger).sum()),
        int((told & ~left_out & ~stranger).sum()),
        int((left_out & stranger).sum()),
        int((told & stranger).sum()),
    )


def draw(
    sets: Sequence[Appearance], count: int, rng: np.random.Generator
) -> Appearance:
    """Random photos of one set of a person."""
    chosen = sets[rng.integers(len(sets))]
    some = rng.permutation(len(chosen.pattern))[:count]
    if len(some) < count:
        raise SystemExit(f"{count} photos of each person are needed.")
    return Appearance(chosen.pattern[some], chosen.weight[some])


def own_patterns(people: Kind) -> Own:
    """Mean pattern and variance of each person."""
    return {p: (mean_pattern(s), pattern_variance(s)) for p, s in people.items()}


def general_without(known: Own, without: set[str]) -> MeanAppearance | None:
    """Faces in general made of all people but some; None for those stored."""
    if known is None:
        return None
    left = [patterns for person, patterns in known.items() if person not in without]
    if not left:
        raise SystemExit("More people are needed: some must be left for comparison.")
    return general_of(left)


if __name__ == "__main__":
    main()
