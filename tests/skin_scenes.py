"""Painted photos of the template with something over one edge of the face."""

import numpy as np
from bsface.camera.camera import Camera
from bsface.images.photo import Photo
from bsface.photometry.skin import SkinMask, skin_masks
from bsface.surface.template import load_template
from drawn_person import encoded
from scipy.spatial.transform import Rotation

TEMPLATE = load_template()
SKIN = np.array([0.45, 0.27, 0.19])
HAIR = np.array([0.035, 0.028, 0.025])
SHIRT = np.array([0.08, 0.3, 0.12])
#: Samples well inside the outline of the face on its left side, its right, its middle.
SIDES = np.array([[0.05, 0.35], [0.95, 0.35], [0.5, 0.3]])


def scene(yaw, gain=(1.0, 1.0, 1.0), other=HAIR, light=0.3):
    """A photo of the template, something before the left edge of its face; its camera.

    The skin is shaded from one side; ``gain`` is exposure and white balance.
    """
    size = 240
    R = Rotation.from_euler("y", yaw, degrees=True).as_matrix()
    camera = Camera(R, 1.1, (0, 0), 0.0, ((size - 1) / 2, (size - 1) / 2))
    y, x = np.mgrid[0:size, 0:size]
    shade = 0.7 + light * (x / (size - 1) - 0.5)
    picture = SKIN * shade[..., None]
    edge = camera.project(
        TEMPLATE.surface.evaluate(np.array([0.12]), 0.35 * np.ones(1))
    )
    picture[:, : int(edge[0, 0])] = other
    pixels = encoded(picture * gain)
    return Photo(f"yaw {yaw}", None, (size, size), pixels), camera


def masks_of(scenes) -> tuple[SkinMask, ...]:
    photos, cameras = zip(*scenes, strict=True)
    return skin_masks(photos, TEMPLATE.surface, cameras, TEMPLATE)


def at_sides(scenes) -> np.ndarray:
    """Masks at the left side, the right side and the middle, ``(n, 3)``."""
    points = TEMPLATE.surface.evaluate(*SIDES.T)
    pairs = zip(scenes, masks_of(scenes), strict=True)
    return np.array([mask.read(camera.project(points)) for (_, camera), mask in pairs])
