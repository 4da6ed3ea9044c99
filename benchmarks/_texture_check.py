"""How well a texture explains the photos, and the plain average to compare it with."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from bsface.drawing.rasterize import rasterize
from bsface.drawing.surface_grid import outline_picture, read_picture, sample_surface
from bsface.images.colour import encode_srgb
from bsface.texture.bake import Texture
from bsface.texture.blend import COARSE
from bsface.texture.light import open_sky
from bsface.texture.views import (
    faces_of,
    prefiltered,
    resized,
    sample,
    view_photos,
)

Picture = npt.NDArray[np.float32]


def plain_average(reconstruction: Any, size: int = 1024) -> Picture:
    """The usual way: mean of all photos that see a texel, all alike.

    Returns
    -------
    (size, size, 3) float32 array
        Linear; 0 where no photo sees the place.
    """
    photos = reconstruction.photos
    views = view_photos(reconstruction, COARSE)
    total = np.zeros((size, size, 3), np.float32)
    count = np.zeros((size, size, 1), np.float32)
    for photo, view in zip(photos, views, strict=True):
        seen = resized((view.weight > 0).astype(np.float32), size)[..., None] > 0.5
        colours = sample(prefiltered(photo, view, size), resized(view.xy, size))
        total += np.where(seen, colours, 0)
        count += seen
    return total / np.maximum(count, 1)


def rerender(
    reconstruction: Any,
    photo: int,
    linear: Picture,
    shading: Picture | None = None,
    resolution: int = 200,
) -> tuple[Picture, npt.NDArray[np.bool_]]:
    """The textured surface as a photo's camera sees it.

    Parameters
    ----------
    reconstruction : Reconstruction
    photo : int
        Index of a used photo.
    linear : (S, S, 3) array
        Texture.
    shading : (C, C, 3) array, optional
        Light over (u, v) to multiply with.

    Returns
    -------
    picture : (h, w, 3) float32 array
        Linear, pixels of the photo's cut-out.
    covered : (h, w) bool array
        Pixels of the face.
    """
    target, camera = reconstruction.photos[photo], reconstruction.cameras[photo]
    face = faces_of(reconstruction)[photo]
    grid = sample_surface(face, reconstruction.template, resolution)
    height, width = target.pixels.shape[:2]
    xy = target.to_window(camera.project(grid.points))
    depth = grid.points @ camera.R[2]
    raster = rasterize(xy, depth, grid.triangles, (width, height))
    uv = raster.interpolate(grid.uv, grid.triangles)
    facing = raster.interpolate(
        np.einsum("kc,kc->k", camera.toward(grid.points), grid.normals)[:, None],
        grid.triangles,
    )[:, 0]
    inside = (
        grid.inside
        if grid.inside is not None
        else outline_picture(reconstruction.template)
    )
    keep = (facing > 0.1) & read_picture(inside.astype(np.float32)[..., None], uv)[
        :, 0
    ].astype(bool)
    values = read_picture(linear, uv)
    if shading is not None:
        values = values * read_picture(shading, uv)
    covered = raster.covered.copy()
    picture = np.zeros((height, width, 3), np.float32)
    picture[covered] = values
    covered[covered] = keep
    picture[~covered] = 0
    return picture, covered


def rerender_errors(reconstruction: Any, texture: Texture) -> dict[str, npt.NDArray]:
    """Median absolute error of each photo, in 8-bit sRGB steps, for four textures.

    "plain": the plain average as it is; "plain_relit": the plain average divided by its
    own mean light and relit by each photo's; "mean": our mean texture, brought to each
    photo's exposure and colour; "albedo": our albedo under each photo's light.
    """
    plain = plain_average(reconstruction, texture.size)
    lights = texture.lights
    basis, _ = open_sky(reconstruction.surface).maps(COARSE)
    mean_light = lights.mean_shading(basis)
    plain_albedo = plain / resized(mean_light, texture.size)
    errors: dict[str, list[float]] = {
        name: [] for name in ("plain", "plain_relit", "mean", "albedo")
    }
    for i, photo in enumerate(reconstruction.photos):
        shading = lights.shading(i, basis)
        truth = photo.bytes8().astype(np.float32)
        for name, picture, light in (
            ("plain", plain, None),
            ("plain_relit", plain_albedo, shading),
            ("mean", texture.mean, None),
            ("albedo", texture.albedo, shading),
        ):
            drawn, covered = rerender(reconstruction, i, picture, light)
            if name in ("mean", "plain_relit"):
                linear = photo.linear()
                gain = np.median(
                    linear[covered] / np.maximum(drawn[covered], 1e-4), axis=0
                )
                drawn = drawn * gain
            off = np.abs(encode_srgb(drawn) * 255 - truth)[covered]
            errors[name].append(float(np.median(off)) if covered.any() else np.nan)
    return {name: np.array(values) for name, values in errors.items()}
