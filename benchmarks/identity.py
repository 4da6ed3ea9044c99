#!/usr/bin/env python3
"""How often the right face is chosen, outlier identities are found, and the check errs.

    python benchmarks/identity.py                    press photos and rendered ones
    python benchmarks/identity.py --people FOLDER    on people of your own
    python benchmarks/identity.py --labels FILE      also: is the right face chosen?

``--people`` is a folder with one folder of photos per person, at least two people; it
may be given again for another kind of pictures.  Folders are made at random: of one
person, with one photo of another, with five, and of two people by halves.  Into
``--out`` goes ``identity.csv``:

wrong     photos of the person that are left out, in % of them; largest number in a
          folder; folders in which that happens, in %
doubts    folders in which a photo of the person is named in a doubt, in %
found     photos of the other person that are left out, in %; with the doubts

``--labels`` is a JSON file that says who is who in whole folders as they are found:
``{"people": {"FOLDER": {"PHOTO": NUMBER, ...}}}``.  The number is that of the person's
face from the left, 0 where the person is not in the photo, null where it cannot be
told.  Photos that are not listed show the person alone.  Into ``--out`` goes
``choice.csv``:

shown     photos that show the person and in which a face was found
right     of these, the person's face is used; of them with a doubt; left out
others    photos in which somebody else's face is used; of them without a doubt
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from _sets import EVAL, ROOT
from _table import text_table, write_csv
from bsface.errors import PhotoFailure
from bsface.identity.descriptor import describe_face
from bsface.identity.face_network import FaceNetwork
from bsface.identity.identify import identify
from bsface.identity.same_person import split_identities
from bsface.images.folder import list_photos
from bsface.landmarks.candidates import CandidateReader
from bsface.landmarks.face_models import find_models
from bsface.landmarks.face_selection import Candidate
from bsface.progress import never_cancelled
from bsface.settings import Settings
from bsface.surface.template import load_template
from scipy.spatial.distance import cdist

PRESS = ROOT.parent / "shared" / "photos" / "lfw"
# Rendered sets of one person belong together: another expression is no other person.
SUBSETS = ("S1", "S2", "S3", "S4", "S5", "P5")
MIXES = (
    ("one person", ((30, 0), (20, 0), (10, 0), (6, 0), (3, 0))),
    ("one outlier", ((29, 1), (19, 1), (9, 1), (5, 1), (2, 1))),
    ("five of another", ((25, 5), (15, 5))),
    ("two people", ((15, 15), (10, 10), (5, 5))),
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
CHOICE_COLUMNS = (
    ("several", "several faces", ".0f"),
    ("shown", "shown", ".0f"),
    ("right", "right", ".0f"),
    ("doubted", "doubted", ".0f"),
    ("left_out", "left out", ".0f"),
    ("others", "others", ".0f"),
    ("silent", "silent", ".0f"),
)

Faces = Sequence[tuple[Candidate, ...] | PhotoFailure]


@dataclass(frozen=True, eq=False)
class Descriptors:
    """The chosen faces of a set of photos of one person.

    Attributes
    ----------
    vector : (n, 128) array
    turn, score : (n,) arrays
        See `split_identities`.
    """

    vector: np.ndarray
    turn: np.ndarray
    score: np.ndarray

    def some(self, chosen: np.ndarray) -> Descriptors:
        return Descriptors(self.vector[chosen], self.turn[chosen], self.score[chosen])


# Person -> sets of photos; sets of one person are never mixed with each other.
Kind = Mapping[str, Sequence[Descriptors]]


def main() -> None:
    """Run the command line."""
    options = arguments()
    network = FaceNetwork(find_models().recognition)
    rows = []
    for folder in options.people:
        started = time.perf_counter()
        people = read_kind(folder, network)
        if len(people) < 2:
            raise SystemExit(f"{folder} holds fewer than two people with photos.")
        taken = time.perf_counter() - started
        print(f"{folder.name}: {', '.join(people)}; faces {taken:.0f} s", flush=True)
        for mix, sizes in MIXES:
            for own, other in sizes:
                rng = np.random.default_rng([options.seed, own, other])
                row = trials(people, own, other, options.folders, rng)
                rows.append({"pictures": folder.name, "folder": mix, **row})
    print(text_table(rows, COLUMNS, [("pictures", "pictures"), ("folder", "folder")]))
    write_csv(options.out / "identity.csv", rows)
    if options.labels:
        labels = json.loads(options.labels.read_text())["people"]
        describe = partial(describe_face, network=network)
        rows = [
            {"person": Path(folder).name}
            | choice_of(read_faces(Path(folder)), marks, describe)
            for folder, marks in labels.items()
        ]
        print(text_table(rows, CHOICE_COLUMNS, [("person", "person")]))
        write_csv(options.out / "choice.csv", rows)


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--people", type=Path, action="append", metavar="FOLDER")
    parser.add_argument("--labels", type=Path, metavar="FILE")
    parser.add_argument("--folders", type=int, default=200, help="of each kind of mix")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "identity")
    options = parser.parse_args()
    options.people = options.people or [PRESS, EVAL]
    for folder in options.people:
        if not folder.is_dir():
            parser.error(f"{folder} is no folder; name one with --people.")
    return options


def read_faces(folder: Path) -> Faces:
    """All faces of all photos of a folder."""
    reader = CandidateReader(load_template(), Settings(), {})
    return [
        reader.read(path, path.name, never_cancelled) for path in list_photos(folder)
    ]


def read_kind(folder: Path, network: FaceNetwork) -> Kind:
    """The descriptors of the photos of each person below a folder."""
    describe = partial(describe_face, network=network)
    found: dict[str, list[Descriptors]] = {}
    for person in sorted(p for p in folder.iterdir() if p.is_dir()):
        sets = [person / s / "images" for s in SUBSETS if (person / s).is_dir()]
        if person.name.endswith("-lambert"):
            continue  # without a camera's response and noise
        for photos in sets or [person]:
            if any(photos.glob("*.*")):
                chosen, _ = identify(
                    read_faces(photos), one_person=False, describe=describe
                )
                faces = [face for face in chosen if isinstance(face, Candidate)]
                found.setdefault(person.name, []).append(
                    Descriptors(
                        np.array([describe(f.photo, f.landmarks) for f in faces]),
                        np.array([f.fit.turn for f in faces]),
                        np.array([f.landmarks.score for f in faces]),
                    )
                )
    return found


def trials(
    people: Kind, own: int, other: int, folders: int, rng: np.random.Generator
) -> dict[str, float | str]:
    """Random folders with ``own`` photos of one person and ``other`` of another."""
    counts = np.array([one_folder(people, own, other, rng) for _ in range(folders)])
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
    people: Kind, own: int, other: int, rng: np.random.Generator
) -> tuple[int, int, int, int]:
    """Of one folder: own photos left out, in doubt; others left out, or in doubt."""
    first, second = (str(p) for p in rng.permutation(list(people))[:2])
    parts = [(first, own)] + ([(second, other)] if other else [])
    chosen = [draw(people[p], count, rng) for p, count in parts]
    order = rng.permutation(own + other)
    vector = np.concatenate([c.vector for c in chosen])[order]
    found = split_identities(
        cdist(vector, vector),
        turn=np.concatenate([c.turn for c in chosen])[order],
        score=np.concatenate([c.score for c in chosen])[order],
    )
    outlier = order >= own
    left_out = np.ones(own + other, bool)
    left_out[found.person] = False
    told = left_out.copy()
    told[found.doubtful] = True
    if other >= own and (told & ~outlier).sum() > (told & outlier).sum():
        outlier = ~outlier  # by halves either of the two may be the person
    return (
        int((left_out & ~outlier).sum()),
        int((told & ~left_out & ~outlier).sum()),
        int((left_out & outlier).sum()),
        int((told & outlier).sum()),
    )


def draw(
    sets: Sequence[Descriptors], count: int, rng: np.random.Generator
) -> Descriptors:
    """Random photos of one set of a person."""
    chosen = sets[rng.integers(len(sets))]
    some = rng.permutation(len(chosen.vector))[:count]
    if len(some) < count:
        raise SystemExit(f"{count} photos of each person are needed.")
    return chosen.some(some)


def choice_of(
    outcome: Faces,
    marks: Mapping[str, int | None],
    describe: Callable[..., np.ndarray | None],
) -> dict[str, int]:
    """What becomes of a whole folder whose faces are labelled."""
    chosen, warnings = identify(outcome, describe=describe)
    told = " ".join(warnings).replace(",", " ").replace(";", " ").split()
    count = dict.fromkeys((key for key, _, _ in CHOICE_COLUMNS), 0)
    for found, item in zip(outcome, chosen, strict=True):
        if isinstance(found, PhotoFailure):
            continue
        name = found[0].photo.name
        marked = marks.get(name, 1)
        count["several"] += len(found) > 1
        if marked is None:
            continue
        count["shown"] += marked > 0
        if isinstance(item, PhotoFailure):
            count["left_out"] += marked > 0
        elif rank_of(item, found) == marked:
            count["right"] += 1
            count["doubted"] += name in told
        else:
            count["others"] += 1
            count["silent"] += name not in told
    return count


def rank_of(face: Candidate, found: tuple[Candidate, ...]) -> int:
    """Number of a face of a photo, from the left."""
    x = face.landmarks.points[:, 0].mean()
    return 1 + sum(bool(f.landmarks.points[:, 0].mean() < x) for f in found)


if __name__ == "__main__":
    main()
