#!/usr/bin/env python3
"""Edit the control net and fit again, with the edited points held.

python examples/06_refit_after_edit.py [PHOTOS [OUT]]
"""

import bsface
import numpy as np
from _arguments import start


def main(photos, out, settings=None):
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
    known = {marks.photo: marks for marks in first.landmarks}
    second = bsface.reconstruct(
        photos, first.settings, template=edited, landmarks=known
    )
    moved = np.linalg.norm(second.surface.control_points - b, axis=2)[held]
    print(f"left free, the photos move the points by up to {moved.max():.1f} mm")

    # Held points are observations; softness is their standard deviation.
    third = bsface.reconstruct(
        photos,
        first.settings,
        template=edited,
        landmarks=known,
        constraint=bsface.Constraint(held, softness_mm=0.2),
    )
    moved = np.linalg.norm(third.surface.control_points - b, axis=2)[held]
    print(f"held, they are {moved.max():.1f} mm away at most")
    third.save(out / "refit.npz")
    return edited, held, third.surface


if __name__ == "__main__":
    start(main, __doc__)
