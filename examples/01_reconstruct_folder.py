#!/usr/bin/env python3
"""A folder of photos in; a face file and a page to look at out.

python examples/01_reconstruct_folder.py [PHOTOS [OUT]]
"""

import bsface
from _arguments import start


def show(step: bsface.Step) -> None:
    """Receive the progress; raising `bsface.Cancelled` here would stop the job."""
    print(f"{step.overall:4.0%}  {step.stage}: {step.message}")


def main(photos, out, settings=None):
    """Reconstruct, say what became of each photo, and write the results."""
    # It raises `bsface.ReconstructionError`, one sentence with the remedy.
    result = bsface.reconstruct(photos, settings, progress=show)

    for photo in result.reports:
        if photo.status == "used":
            error = f"{photo.reprojection_pct:.1f} % of the eye distance"
            line = f"yaw {photo.yaw:+.0f}, landmarks off by {error}"
        else:
            line = photo.reason
        print(f"{photo.name}: {line}")
    for warning in result.warnings:
        print("note:", warning)

    m, n = result.surface.shape
    print(f"{m} x {n} control points in millimetres")
    print("wrote", result.save(out / "face.npz"))
    print("wrote", bsface.write_report(out / "face.html", result))
    return result


if __name__ == "__main__":
    start(main, __doc__)
