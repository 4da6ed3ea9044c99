#!/usr/bin/env python3
"""What a reconstruction holds: coefficient matrices, normals, cameras, lights.

python examples/03_look_inside.py [PHOTOS [OUT]]
"""

import bsface
import numpy as np
from _arguments import start


def main(photos, out, settings=None):
    """Walk through the parts of a `Reconstruction`."""
    result = bsface.reconstruct(photos, settings)
    surface = result.surface

    # The surface: points, derivatives and normals at any (u, v) of the unit square.
    u, v = np.meshgrid(np.linspace(0.2, 0.8, 7), np.linspace(0.2, 0.8, 7))
    points = surface.evaluate(u, v)
    normals = surface.normals(u, v)
    print("middle of the face:", surface.evaluate(0.5, 0.5).round(1), "mm")
    print("normal there:", surface.normals(0.5, 0.5).round(2))

    # The same by the coefficient matrices T, T1, T2 of Eq. 2 and 5.
    b = surface.vector
    T = surface.matrix(u.ravel(), v.ravel())
    T1 = surface.matrix(u.ravel(), v.ravel(), du=1)
    T2 = surface.matrix(u.ravel(), v.ravel(), dv=1)
    assert np.allclose(T @ b, points.reshape(-1, 3))
    h = np.cross(T2 @ b, T1 @ b)  # v runs down, so this is the outward order
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    assert np.allclose(h, normals.reshape(-1, 3))
    print(f"T is {T.shape[0]} x {T.shape[1]} with {T.nnz} numbers, 16 a point")

    # Closest point, and on which side of the surface a point lies.
    above = surface.evaluate(0.4, 0.4) + 3.0 * surface.normals(0.4, 0.4)
    uv, distance = surface.closest_point(above[None])
    side = surface.signed_distance(above[None])
    print("closest (u, v):", uv[0].round(3), f"{distance[0]:.2f} mm, {side[0]:+.2f}")

    # A camera a photo: pixels of the original photo from head coordinates.
    camera, photo = result.cameras[0], result.photos[0]
    yaw, pitch, roll = camera.yaw_pitch_roll
    print(f"{photo.name}: yaw {yaw:.0f}, pitch {pitch:.0f}, roll {roll:.0f} degrees,")
    print(f"  camera at {camera.distance_mm:.0f} mm, focal {camera.focal_px:.0f} px")
    print("  the middle of the face is at pixel", camera.project(points[3, 3]).round(1))

    # What shading says: light and albedo, and how sure the control points are.
    if result.photometric is not None:
        light = result.photometric.lights[0]
        print("light from", (light[1:4] / np.linalg.norm(light[1:4])).round(2))
        print("diversity of light:", result.photometric.singular_values[:4].round(3))
    if result.deviation is not None:
        inner = result.deviation[5:-5, 5:-5]
        print(f"standard deviation inside the net: {np.median(inner):.2f} mm")
    return result


if __name__ == "__main__":
    start(main, __doc__)
