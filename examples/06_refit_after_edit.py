#!/usr/bin/env python3
"""Edit the control net and fit again, with the edited points held.

python examples/06_refit_after_edit.py [PHOTOS [OUT]]
"""

import sys
from dataclasses import replace
from pathlib import Path

import bsface
import numpy as np
from bsface.formats import export
from bsface.solve.constraint import hold

PHOTOS = Path(__file__).resolve().parent / "photos"
OUT = Path(__file__).resolve().parents[1] / "out" / "examples"


def main(photos=PHOTOS, out=OUT, settings=None):
    """Pull the tip of the nose out by 3 mm and continue from there."""
    first = bsface.reconstruct(photos, settings)
    b = first.surface.control_points.copy()
    held = np.zeros(b.shape[:2], bool)
    i, j = np.unravel_index(b[..., 2].argmax(), held.shape)
    held[i - 1 : i + 2, j - 1 : j + 2] = True
    b[held] += 3.0 * np.array([0.0, 0.0, 1.0])
    edited = bsface.BSplineSurface(b)

    # The edited face becomes the template b_t of the next run; landmarks that are
    # known need not be found again.
    second = bsface.reconstruct(
        photos,
        first.settings,
        template=edited,
        landmarks={marks.photo: marks for marks in first.landmarks},
    )
    moved = np.linalg.norm(second.surface.control_points - b, axis=2)[held]
    print(f"left free, the photos move the points by up to {moved.max():.1f} mm")

    # Held points are observations of a smooth displacement; softness is their
    # standard deviation.
    kept = hold(second.surface, b, held, softness_mm=0.2)
    moved = np.linalg.norm(kept.control_points - b, axis=2)[held]
    print(f"held, they are {moved.max():.1f} mm away at most")
    export(Path(out) / "refit.npz", replace(second, surface=kept))
    return edited, held, kept


if __name__ == "__main__":
    main(*sys.argv[1:])
