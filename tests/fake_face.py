"""A small made-up reconstruction for the tests of the output modules.

The face is an ellipsoidal cap with a nose, seen by orthographic cameras of known
pose, and its photos are drawn from a known texture under known light: everything
that an output module derives from it can be checked.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from bsface.photometry.lighting import PhotometricEvidence
from bsface.result import HistoryEntry, PhotoReport, Reconstruction
from bsface.settings import Settings
from bsface.surface.bspline import BSplineSurface
from bsface.surface.template import Template, load_template


def face_surface(shape: tuple[int, int] = (16, 18), nose: float = 12.0):
    """Ellipsoidal cap, 140 x 180 mm, about 60 mm deep, with a bump for a nose."""
    m, n = shape
    # Greville abscissae of the uniform knots: control point i sits at (i - 1)/(m - 3).
    u = (np.arange(m) - 1) / (m - 3)
    v = (np.arange(n) - 1) / (n - 3)
    u, v = np.meshgrid(u, v, indexing="ij")
    x, y = 140 * (u - 0.5), 180 * (0.5 - v) - 20
    r2 = ((u - 0.5) / 0.72) ** 2 + ((v - 0.5) / 0.75) ** 2
    z = 75 * np.sqrt(np.maximum(1 - r2, 0.02)) - 50
    z = z + nose * np.exp(-(((u - 0.5) / 0.09) ** 2) - ((v - 0.52) / 0.11) ** 2)
    return BSplineSurface(np.stack([x, y, z], axis=-1))


def ellipse_outline(count: int = 60) -> np.ndarray:
    """Closed polygon (count, 2) in (u, v), counter-clockwise on the page."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return 0.5 + np.stack([0.44 * np.cos(angle), 0.46 * np.sin(angle)], axis=1)


def face_template(surface: BSplineSurface | None = None) -> Template:
    """The bundled template with a made-up surface and outline."""
    surface = surface or face_surface(nose=8.0)
    return replace(
        load_template().resampled(surface.shape),
        surface=surface,
        outline_uv=ellipse_outline(),
    )


def skin_pattern(uv: np.ndarray) -> np.ndarray:
    """Made-up skin colour (..., 3), linear, with broad and fine detail."""
    u, v = uv[..., 0], uv[..., 1]
    broad = 1 + 0.15 * np.sin(19 * u + 4 * v) + 0.1 * np.cos(23 * v)
    spots = 1 - 0.55 * ((np.sin(22 * u) * np.sin(25 * v)) > 0.55)
    lips = np.exp(-(((u - 0.5) / 0.12) ** 2) - ((v - 0.75) / 0.04) ** 2)
    colour = np.array([0.45, 0.32, 0.25]) * (broad * spots)[..., None]
    return colour * (1 - lips[..., None] * (0.1, 0.5, 0.4))


def other_skin(uv: np.ndarray) -> np.ndarray:
    """The skin of somebody else than `skin_pattern`, (..., 3), linear."""
    u, v = uv[..., 0], uv[..., 1]
    spots = 1 - 0.55 * ((np.sin(57 * u + 1) * np.sin(43 * v + 2)) > 0.2)
    broad = 1 + 0.1 * np.cos(13 * u)
    return np.array([0.45, 0.32, 0.25]) * (spots * broad)[..., None]


def painted_reconstruction(
    count: int = 8, side: int = 200, seed: int = 2, height=None
) -> Reconstruction:
    """Photos drawn of `skin_pattern` under one soft light each, poses known.

    ``height(u, v)``: what stands out of the surface, mm; drawn by its normals only.
    """
    from bsface.camera.camera import Camera
    from bsface.drawing.rasterize import rasterize
    from bsface.drawing.render import yaw_rotation
    from bsface.drawing.surface_grid import sample_surface
    from bsface.images.colour import to_picture
    from bsface.images.photo import Photo
    from bsface.landmarks.landmarks import Landmarks
    from bsface.photometry import harmonics

    rng = np.random.default_rng(seed)
    surface = face_surface()
    template = face_template(surface)
    grid = sample_surface(surface, None, 150)
    photos, cameras, marks, reports, lights = [], [], [], [], []
    for index in range(count):
        yaw = -35 + 70 * index / max(count - 1, 1)
        R = yaw_rotation(yaw, rng.uniform(-12, 12))
        centre = np.full(2, (side - 1) / 2)
        camera = Camera(R, side / 220, rng.uniform(-4, 4, 2), 1 / 1500, centre)
        light = np.zeros((9, 3))
        light[0] = rng.uniform(0.6, 1.0) * np.array([1, 0.95, 0.9]) ** rng.normal()
        # More from one side: the plain average keeps that shading.
        direction = rng.normal(size=3) + (-1.5, 0.5, 1.5)
        light[1:4] = 0.7 * light[0] * (direction / np.linalg.norm(direction))[:, None]
        raster = rasterize(
            camera.project(grid.points),
            grid.points @ R[2],
            grid.triangles,
            (side, side),
        )
        uv = raster.interpolate(grid.uv, grid.triangles)
        normal = raster.interpolate(grid.normals, grid.triangles)
        if height is not None:
            normal = displaced_normals(surface, height, *uv.T)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        picture = np.full((side, side, 3), 0.05 + 0.1 * rng.random())
        shading = np.maximum(harmonics.basis(normal) @ light, 0.02)
        picture[raster.covered] = skin_pattern(uv) * shading
        picture += rng.normal(0, 0.002, picture.shape)
        name = f"{index:03d}.png"
        photos.append(Photo(name, None, (side, side), to_picture(picture)))
        cameras.append(camera)
        points = camera.project(surface.evaluate(*template.landmark_uv.T))
        marks.append(Landmarks(name, "468", points, np.ones(468)))
        lights.append(light.mean(axis=1))
        turned = [float(a) for a in camera.yaw_pitch_roll]
        reports.append(PhotoReport(name, "used", "", 1.2, *turned, 0.05, 1.0))
    uv = rng.uniform(0.2, 0.8, (50, 2))
    return Reconstruction(
        surface=surface,
        template=template,
        photos=tuple(photos),
        landmarks=tuple(marks),
        cameras=tuple(cameras),
        photometric=PhotometricEvidence(
            uv=uv,
            normals=surface.normals(*uv.T),
            albedo=skin_pattern(uv),
            lights=np.array(lights),
            weights=np.ones((count, 50)),
            residual=np.zeros((count, 50)),
            singular_values=np.array([9.0, 3.0, 1.5, 0.8, 0.2, 0.1]),
        ),
        reports=tuple(reports),
        deviation=np.full(surface.shape, 0.4),
        settings=Settings(),
        expressions=np.zeros((count, len(template.expression_modes))),
        history=tuple(HistoryEntry("refine", 0.1 / (k + 1), 0.5) for k in range(5)),
        warnings=("All photos were taken from the front; add some from the side.",),
        seconds={"photos": 1.5, "refine": 3.0},
    )


def displaced_normals(surface: BSplineSurface, height, u, v, step: float = 1e-4):
    """Unit normals (..., 3) of the displaced surface, by central differences."""

    def point(u, v):
        return surface.evaluate(u, v) + height(u, v)[..., None] * surface.normals(u, v)

    along_u = point(u + step, v) - point(u - step, v)
    along_v = point(u, v + step) - point(u, v - step)
    normal = np.cross(along_v, along_u)
    return normal / np.linalg.norm(normal, axis=-1, keepdims=True)


def bare_reconstruction() -> Reconstruction:
    """Only what every reconstruction has."""
    surface = face_surface()
    template = face_template()
    return Reconstruction(
        surface=surface,
        template=template,
        photos=(),
        landmarks=(),
        cameras=(),
        photometric=None,
        reports=(),
        deviation=None,
        settings=Settings(),
        expressions=np.zeros((0, len(template.expression_modes))),
    )


def average_reconstruction() -> Reconstruction:
    """The same of the bundled average face."""
    template = load_template()
    return replace(bare_reconstruction(), surface=template.surface, template=template)


def person_folder(
    folder,
    count: int = 4,
    seed: int = 0,
    side: int = 220,
    yaw=(-25.0, 25.0),
    skin=skin_pattern,
):
    """A folder of drawn photos of the template with their landmark files beside them.

    The whole job runs on it without the detector (``detector=False``).
    """
    import json

    from bsface.camera.camera import Camera
    from bsface.drawing.rasterize import rasterize
    from bsface.drawing.render import yaw_rotation
    from bsface.drawing.surface_grid import sample_surface
    from bsface.images.colour import to_picture
    from bsface.photometry import harmonics
    from bsface.surface.template import load_template

    rng = np.random.default_rng(seed)
    template = load_template()
    surface = template.surface
    grid = sample_surface(surface, None, 150)
    folder.mkdir(parents=True, exist_ok=True)
    for index in range(count):
        R = yaw_rotation(rng.uniform(*yaw), rng.uniform(-8, 8))
        centre = np.full(2, (side - 1) / 2)
        camera = Camera(R, side / 260, np.zeros(2), 1 / 1200, centre)
        raster = rasterize(
            camera.project(grid.points),
            grid.points @ R[2],
            grid.triangles,
            (side, side),
        )
        normal = raster.interpolate(grid.normals, grid.triangles)
        light = np.array([0.8, *rng.normal(0, 0.25, 2), 0.3, 0, 0, 0, 0, 0])
        picture = np.full((side, side, 3), 0.2)
        colour = skin(raster.interpolate(grid.uv, grid.triangles))
        shading = np.maximum(harmonics.basis(normal) @ light, 0.05)
        picture[raster.covered] = colour * shading[:, None]
        picture += rng.normal(0, 0.004, picture.shape)
        path = folder / f"{index}.png"
        cv2.imwrite(str(path), to_picture(picture)[..., ::-1])
        points = camera.project(template.landmark_xyz)
        points += rng.normal(0, 0.3, points.shape)
        text = json.dumps(
            {"scheme": "468", "points": points.tolist(), "image_size": [side, side]}
        )
        path.with_suffix(".json").write_text(text)
    return folder
