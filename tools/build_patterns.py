#!/usr/bin/env python3
"""Builds ``core/data/patterns.npz``: what the look of most faces has in common.

    python tools/build_patterns.py FOLDER

The folder holds one folder a person, at least two, each with photos or with the sets
``S1`` to ``S5`` of photos of one expression or light each, in ``images``; people count
the same whatever their number of photos.  Stored are, in hundredths, the mean patterns
of contrast that `bsface.identity.descriptor` reads at 96 x 96 places of the face, over
all people but one and their mirror images: as many as people, so that for each of them
there is one without; and, in 1/200, the variance of a person's pattern.

The stored file was made of our own rendered pictures alone: three made-up people in 9
sets of 40 pictures.  One of these sets is ``examples/photos``.
"""

from __future__ import annotations

import argparse
import io
from pathlib import Path

import numpy as np
from bsface.files import write_bytes
from bsface.identity.descriptor import (
    PATTERNS,
    SIDE,
    describe_appearance,
    general_of,
    mean_pattern,
    pattern_variance,
)
from bsface.prepare import collect_photos
from bsface.settings import Settings

SETS = ("S1", "S2", "S3", "S4", "S5")


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--output", type=Path, default=PATTERNS)
    options = parser.parse_args()
    settings = Settings(one_person=False)
    people = []
    for person in sorted(p for p in options.folder.iterdir() if p.is_dir()):
        if person.name.endswith("-lambert"):
            continue  # without a camera's response and noise
        sets = []
        named = [person / s / "images" for s in SETS if (person / s).is_dir()]
        for folder in named or [person]:
            found = collect_photos(folder, settings)
            sets.append(describe_appearance(found.photos, found.landmarks))
            print(f"{folder}: {len(found.photos)} photos", flush=True)
        people.append((mean_pattern(sets), pattern_variance(sets)))
    if len(people) < 2:
        raise SystemExit(f"{options.folder} holds fewer than two people with photos.")
    general = general_of(people, members=True)
    half = SIDE // 2
    mean = np.round(100 * general.mean[..., :half]).clip(-127, 127)
    variance = np.round(200 * general.variance[:, :half]).clip(0, 255)
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer, mean=mean.astype(np.int8), variance=variance.astype(np.uint8)
    )
    print(f"{write_bytes(options.output, buffer.getvalue())}: {mean.shape}")


if __name__ == "__main__":
    main()
