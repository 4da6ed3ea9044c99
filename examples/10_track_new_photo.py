#!/usr/bin/env python3
"""A known person in a new photo: where the head is and what the face does.

python examples/10_track_new_photo.py [PHOTOS [OUT]]
"""

import bsface
import cv2
import numpy as np
from _arguments import start
from bsface.drawing.pictures import write_png


def main(photos, out, settings=None):
    """Make the face without the last photo, then find it in that one."""
    *known, new = bsface.list_photos(photos)
    bsface.reconstruct(known, settings).save(out / "known.npz")

    # The face file is all that is needed from here on.
    face = bsface.load(out / "known.npz")
    (found,) = bsface.track(new, face).photos
    yaw, pitch, roll = found.camera.yaw_pitch_roll
    print(f"{found.name}: yaw {yaw:.0f}, pitch {pitch:.0f}, roll {roll:.0f} degrees")
    print(f"landmarks are {found.residual_mm:.1f} mm from their projections")
    moved = found.surface.control_points - face.surface.control_points
    size = np.linalg.norm(moved, axis=2).max()
    print(f"the expression moves control points by up to {size:.1f} mm")

    print("wrote", write_png(out / "tracked.png", net_on_photo(found)))
    return found, face


def net_on_photo(found, lines=24):
    """The photo with lines of equal u and v of the found surface, where they show."""
    picture = np.ascontiguousarray(found.photo.bytes8())
    at = np.linspace(0.02, 0.98, lines)
    u, v = np.meshgrid(at, np.linspace(0.02, 0.98, 200), indexing="ij")
    for uv in ((u, v), (v, u)):
        points = found.surface.evaluate(*uv)
        toward = found.camera.toward(points)
        front = (toward * found.surface.normals(*uv)).sum(-1) > 0.15
        pixels = found.photo.to_window(found.camera.project(points))
        for line, seen in zip(np.round(pixels).astype(np.int32), front, strict=True):
            for a, b in zip(line[:-1][seen[1:]], line[1:][seen[1:]], strict=True):
                cv2.line(picture, a.tolist(), b.tolist(), (90, 230, 140))
    return picture


if __name__ == "__main__":
    start(main, __doc__)
