"""Photos drawn of a known face, with landmarks, and how far two faces differ."""

from dataclasses import replace

import numpy as np
from bsface import BSplineSurface, Settings
from bsface.camera.camera import Camera
from bsface.drawing.rasterize import rasterize
from bsface.drawing.surface_grid import sample_surface
from bsface.landmarks.landmarks import Landmarks
from bsface.photometry import harmonics
from bsface.surface.alignment import fit_similarity
from bsface.surface.template import load_template
from fake_face import skin_pattern
from scipy.spatial.transform import Rotation

SIDE = 200
QUICK = Settings(
    control_points=(14, 15), landmarks="68", detector=False, iterations=1, shadows=False
)
MOTION = replace(QUICK, method="motion")
TEMPLATE = load_template()


def person(seed=3) -> BSplineSurface:
    """A face that differs from the template by its modes, some millimetres."""
    k = 1.3 * np.random.default_rng(seed).normal(size=len(TEMPLATE.identity_modes))
    b = TEMPLATE.surface.control_points
    return BSplineSurface(b + np.tensordot(k, TEMPLATE.identity_modes, 1))


def draw(surface, count=5, seed=0, side=SIDE):
    """16-bit photos and landmarks of a face under varied light, poses known."""
    rng = np.random.default_rng(seed)
    grid = sample_surface(surface, None, 150)
    photos, marks = [], {}
    moved = surface.evaluate(*TEMPLATE.landmark_uv.T)
    moved += TEMPLATE.landmark_xyz - TEMPLATE.surface.evaluate(*TEMPLATE.landmark_uv.T)
    for index in range(count):
        angles = [-28 + 56 * index / max(count - 1, 1), *rng.uniform(-8, 8, 2)]
        R = Rotation.from_euler("yxz", angles, degrees=True).as_matrix()
        centre = np.full(2, (side - 1) / 2)
        camera = Camera(R, side / 250, rng.uniform(-4, 4, 2), 1 / 1200, centre)
        raster = rasterize(
            camera.project(grid.points),
            grid.points @ R[2],
            grid.triangles,
            (side, side),
        )
        normal = raster.interpolate(grid.normals, grid.triangles)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        light = np.zeros(9)
        light[0], light[1:4] = 0.5, rng.normal(0, 0.2, 3) + (0, 0, 0.15)
        shading = np.maximum(harmonics.basis(normal) @ light, 0.02)
        picture = np.full((side, side, 3), 0.1)
        skin = skin_pattern(raster.interpolate(grid.uv, grid.triangles))
        picture[raster.covered] = skin * shading[:, None]
        photos.append(encoded(picture + rng.normal(0, 0.001, picture.shape)))
        name = f"picture {index + 1}"
        points = (camera.project(moved) + rng.normal(0, 0.3, moved[:, :2].shape))[
            TEMPLATE.schemes["68"]
        ]
        marks[name] = Landmarks(name, "68", points, np.ones(68), source="hand")
    return photos, marks


def encoded(linear):
    """sRGB curve to 16 bits."""
    c = np.clip(linear, 0, 1)
    high = 1.055 * np.maximum(c, 1e-9) ** (1 / 2.4) - 0.055
    return np.round(65535 * np.where(c <= 0.0031308, 12.92 * c, high)).astype(np.uint16)


def linear(pixels):
    c = pixels / 65535
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def moved_marks(marks, move):
    """Landmarks with their points moved by a function."""
    return {k: replace(m, points=move(m.points)) for k, m in marks.items()}


def distance(a, b):
    """Root mean square distance of two faces on the skin, mm, as they stand."""
    uv = TEMPLATE.landmark_uv.T
    away = a.surface.evaluate(*uv) - b.surface.evaluate(*uv)
    return float(np.sqrt((away**2).sum(1).mean()))


def error(surface, truth):
    """The same after the best similarity."""
    uv = TEMPLATE.landmark_uv.T
    here, there = surface.evaluate(*uv), truth.evaluate(*uv)
    away = fit_similarity(here, there)(here) - there
    return float(np.sqrt((away**2).sum(1).mean()))


def plausible(found):
    """Finite, and still a face."""
    assert np.isfinite(found.surface.control_points).all()
    assert error(found.surface, TEMPLATE.surface) < 10
    uv = np.random.default_rng(0).uniform(0.3, 0.7, (2, 200))
    assert found.surface.normals(*uv)[:, 2].mean() > 0.5
    for row in found.reports:
        if row.status == "used":
            assert np.isfinite(
                [row.yaw, row.pitch, row.roll, row.reprojection_pct]
            ).all()
    return " ".join(found.warnings)
