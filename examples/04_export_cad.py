#!/usr/bin/env python3
"""A face file to CAD programs and as meshes.

python examples/04_export_cad.py [PHOTOS [OUT]]
"""

import bsface
from _arguments import start
from bsface.formats import WRITERS


def main(photos, out, settings=None):
    """Write every format that the installed packages allow."""
    file = bsface.reconstruct(photos, settings).save(out / "face.npz")
    face = bsface.load(file)  # no photos and no second run are needed any more

    written = []
    for ending, (what, _) in WRITERS.items():
        try:
            # The tolerance is that of meshes, mm; the others are exact.
            path = bsface.export(out / f"face{ending}", face, tolerance=0.1)
        except bsface.ReconstructionError as error:
            print(error)  # .3dm without the package rhino3dm
            continue
        print(f"{path.name}: {what}, {path.stat().st_size / 1024:.0f} KB")
        written.append(path)

    # Untrimmed: the whole patch with its rim, not only the face.
    written.append(bsface.export(out / "face_untrimmed.step", face, trimmed=False))
    return written


if __name__ == "__main__":
    start(main, __doc__)
