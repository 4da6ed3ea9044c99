#!/usr/bin/env python3
"""Landmarks that you bring: as files beside the photos, or as arrays.

Here the detector makes them once and they are written as ``.pts`` files (68 points in
the iBUG order); from then on no detector and no model files are needed.

    python examples/02_own_landmarks.py [PHOTOS [OUT]]
"""

import shutil
from dataclasses import replace
from pathlib import Path

import bsface
from _arguments import start


def main(photos, out, settings=None):
    """Write landmark files beside copies of the photos and reconstruct from them."""
    settings = replace(settings or bsface.Settings(), landmarks="68")
    folder = out / "photos_with_landmarks"
    folder.mkdir(parents=True, exist_ok=True)

    found = bsface.reconstruct(photos, settings, method="motion")
    for photo, landmarks in zip(found.photos, found.landmarks, strict=True):
        assert photo.path is not None
        copy = Path(shutil.copy(photo.path, folder))
        bsface.write_landmarks(copy.with_suffix(".pts"), landmarks)

    # 1. Files: 000.pts beside 000.jpg is found by its name.
    result = bsface.reconstruct(folder, replace(settings, detector=False))
    print(f"{len(result.photos)} photos with landmarks from files")

    # 2. Arrays: pixels of the photo as it is seen, centres at integers. They win over
    # files, and weights say how sure a point is; 0 leaves it out.
    mine = {}
    for landmarks in found.landmarks:
        weight = landmarks.weight.copy()
        weight[:17] = 0  # the outline of the jaw slides with the pose
        mine[landmarks.photo] = bsface.Landmarks(
            landmarks.photo, "68", landmarks.points, weight, source="hand"
        )
    result = bsface.reconstruct(
        photos, replace(settings, detector=False), landmarks=mine
    )
    print(f"{len(result.photos)} photos with landmarks from arrays")
    return result


if __name__ == "__main__":
    start(main, __doc__)
