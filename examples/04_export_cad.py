#!/usr/bin/env python3
"""A face file to CAD programs and as meshes.

python examples/04_export_cad.py [PHOTOS [OUT]]
"""

import sys
from pathlib import Path

import bsface
from bsface.formats import WRITERS, export, load_face

PHOTOS = Path(__file__).resolve().parent / "photos"
OUT = Path(__file__).resolve().parents[1] / "out" / "examples"


def main(photos=PHOTOS, out=OUT, settings=None):
    """Write every format that the installed packages allow."""
    out = Path(out)
    file = out / "face.npz"
    if not file.is_file():
        export(file, bsface.reconstruct(photos, settings))
    face = load_face(file)  # no photos and no second run are needed any more

    written = []
    for ending, (what, _) in WRITERS.items():
        try:
            # The tolerance is that of meshes, mm; the others are exact.
            path = export(out / f"face{ending}", face, tolerance=0.1)
        except bsface.ReconstructionError as error:
            print(error)  # .3dm without the package rhino3dm
            continue
        print(f"{path.name}: {what}, {path.stat().st_size / 1024:.0f} KB")
        written.append(path)

    # Untrimmed: the whole patch with its rim, not only the face.
    written.append(export(out / "face_untrimmed.step", face, trimmed=False))
    return written


if __name__ == "__main__":
    main(*sys.argv[1:])
