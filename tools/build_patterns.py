#!/usr/bin/env python3
"""Builds ``core/data/patterns.npz``: what the look of most faces has in common.

    python tools/build_patterns.py --kind REAL/anna REAL/bert --kind MADE/carl MADE/dora

Each ``--kind`` lists folders with photos of one person each, at least two; more people
make better patterns, more photos of one do not.  A pattern is the mean, over all people
of a kind but one and their mirror images, of the contrast that
`bsface.evidence.appearance` reads at 96 x 96 places of the face, in hundredths: as many
patterns as people, so that for each of them there is one without.  No photo can be had
back from them.

The stored file was made of two kinds: four people of Labeled Faces in the Wild, 35
photos each, and three rendered people, 40 pictures each.
"""

from __future__ import annotations

import argparse
import io
from pathlib import Path

import numpy as np
from bsface.evidence.appearance import PATTERNS, SIDE, look, mean_pattern
from bsface.evidence.gather import gather
from bsface.output.files import write_bytes
from bsface.settings import Settings


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--kind", nargs="+", type=Path, action="append", required=True, metavar="FOLDER"
    )
    parser.add_argument("--output", type=Path, default=PATTERNS)
    options = parser.parse_args()
    settings = Settings(one_person=False)
    maps = []
    for folders in options.kind:
        people = []
        for folder in folders:
            found = gather(folder, settings)
            people.append(look(found.photos, found.landmarks))
            print(f"{folder}: {len(found.photos)} photos", flush=True)
        without = [people[:k] + people[k + 1 :] for k in range(len(people))]
        maps.append([mean_pattern(others)[:, : SIDE // 2] for others in without])
    most = max(map(len, maps))
    for kind in maps:  # kinds of fewer people repeat their first
        kind += kind[:1] * (most - len(kind))
    stored = np.clip(np.round(100 * np.array(maps)), -127, 127).astype(np.int8)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, patterns=stored)
    print(f"{write_bytes(options.output, buffer.getvalue())}: {stored.shape}")


if __name__ == "__main__":
    main()
