"""Landmarks as cameras in known places would see them."""

import numpy as np
from bsface.camera.camera import Camera
from bsface.landmarks.observations import LandmarkObservations
from bsface.surface.template import load_template
from scipy.spatial.transform import Rotation


def true_cameras(count=10, seed=1, kappa=True, between=(900, 1600)):
    rng = np.random.default_rng(seed)
    out = []
    for yaw in np.linspace(-40, 40, count):
        R = Rotation.from_euler(
            "yxz", [yaw, rng.uniform(-15, 15), rng.uniform(-8, 8)], degrees=True
        ).as_matrix()
        distance = rng.uniform(*between)
        s, t = rng.uniform(1.5, 4), rng.normal(0, 20, 2)
        out.append(Camera(R, s, t, 1 / distance if kappa else 0.0, (300, 250)))
    return out


def observe(Q, cameras, index, noise=0.0, seed=2):
    rng = np.random.default_rng(seed)
    pixels = np.stack([c.project(Q) for c in cameras])
    pixels = pixels + noise * rng.normal(size=pixels.shape)
    return observations(pixels, np.ones(pixels.shape[:2]), index)


def observations(pixels, weight, index):
    uv, centre = (
        load_template().landmark_uv[index],
        np.tile([300.0, 250], (len(pixels), 1)),
    )
    return LandmarkObservations(pixels, weight, index, uv, centre)
