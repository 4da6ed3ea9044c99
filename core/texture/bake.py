"""The face's skin on its own (u, v): de-lit albedo and mean texture from all photos.

Each photo is divided by its own light (:mod:`.texture_light`), which also balances
exposure and colour. What is left is blended in two bands (Burt and Adelson 1983;
Baumberg 2002): the coarse band is a robust mean over all photos, so no seam can appear
where one photo ends; the fine band favours the photos that see a place best and agree
with the others, so a shifted photo leaves no ghost. Where details disagree in any case
(gaze, hair, lips) one typical photo is taken instead of the smear of all. Texels that
no photo sees are filled smoothly and marked.

Pictures over (u, v): row 0 is v = 0, the top; see :mod:`.texture_views`. In Blender the
surface's ``UVMap`` has the core's v, and Blender counts picture rows from the bottom:
give the image texture a Mapping node with scale (1, -1, 1) and location (0, 1, 0). In
exported files v is turned round already, so the picture fits as it is.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from ..camera.camera import Camera
from ..drawing.pictures import write_png
from ..errors import ReconstructionError
from ..images.colour import to_picture
from ..images.photo import Photo
from ..photometry.skin import SkinMask, skin_masks
from ..progress import CheckCancelled
from ..result import Reconstruction
from .blend import (
    COARSE,
    choose_where_disagreeing,
    coarse_band,
    consensus,
    explained,
    fill,
    fine_band,
    inner_part,
    measured_places,
)
from .light import PhotoLights, estimate_lights, light_maps
from .views import (
    View,
    faces_of,
    prefiltered,
    resized,
    sample,
    surface_maps,
    view_photo,
)

Picture = npt.NDArray[np.float32]

_LIGHT = 64  # texels a side for estimating the lights
_TILE = 64  # texture rows blended at a time


@dataclass(frozen=True)
class Texture:
    """Textures of a face, linear intensities, row 0 at v = 0.

    Attributes
    ----------
    albedo : (S, S, 3) float32 array
        The skin's own colour, free of light; the light's mean shading is 1.
    mean : (S, S, 3) float32 array
        The skin under the mean light of the photos, each at the same exposure.
    measured : (S, S) bool array
        False where no photo sees the place: filled from around it.
    residual : (C, C) float32 array
        Mean relative difference between the photos and the relit albedo; NaN where not
        measured.
    photos_seen : (C, C) float32 array
        How many photos count at each place.
    lights : PhotoLights
        Of the used photos, in their order.
    skin : tuple of SkinMask
        What of each used photo is skin.
    """

    albedo: Picture
    mean: Picture
    measured: npt.NDArray[np.bool_]
    residual: Picture
    photos_seen: Picture
    lights: PhotoLights
    skin: tuple[SkinMask, ...]

    @property
    def size(self) -> int:
        """Texels a side."""
        return self.albedo.shape[0]


def bake_texture(
    reconstruction: Reconstruction,
    size: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> Texture:
    """Albedo and mean texture from all used photos.

    Parameters
    ----------
    reconstruction : Reconstruction
    size : int, optional
        Texels a side, 64 to 8192. By default 512, 1024, 2048 or 4096: the first that
        holds what the sharpest photos show.
    progress : callable, optional
        Called with the fraction done.

    Raises
    ------
    ReconstructionError
        When no photo with a camera is there.
    ValueError
        When ``size`` is out of range.
    """
    photos, cameras = reconstruction.photos, reconstruction.cameras
    if not photos:
        raise ReconstructionError(
            "A texture needs the photos of the reconstruction; run it again with them."
        )
    if size is not None and not 64 <= size <= 8192:
        raise ValueError(f"texture size must be 64 to 8192 texels, got {size}")
    tell = progress or (lambda fraction: None)
    faces = faces_of(reconstruction)
    seen = zip(faces, photos, cameras, strict=True)
    seen = _telling(seen, tell, 0.0, 0.12, len(photos))
    views = [view_photo(f, surface_maps(f, COARSE), p, c) for f, p, c in seen]
    size = size or natural_size(views)
    pairs = _telling(zip(photos, views, strict=True), tell, 0.12, 0.15, len(photos))
    sources = [prefiltered(photo, view, size) for photo, view in pairs]
    pairs = _telling(zip(sources, views, strict=True), tell, 0.15, 0.17, len(photos))
    coarse = np.stack([_coarse_sample(s, v) for s, v in pairs])
    weight = np.stack([view.weight for view in views])
    weight *= _well_exposed(coarse)
    skin = skin_masks(
        photos,
        faces[0] if all(face is faces[0] for face in faces) else faces,
        cameras,
        reconstruction.template,
        lambda: tell(0.17),
    )
    weight *= _skin_seen(skin, photos, views)
    tell(0.17)
    basis, front = light_maps(reconstruction.surface, COARSE)
    lights = _lights(basis, front, coarse, weight, lambda: tell(0.19))
    tell(0.22)
    shading = np.stack([lights.shading(i, basis) for i in range(len(views))])
    coarse /= shading
    # Dark places of a photo tell less about the skin.
    weight = weight * np.clip(shading.mean(axis=3), 0, 2) ** 2
    neutral = _calmness(reconstruction)
    weight = weight * neutral[:, None, None]
    tell(0.24)
    base, agreement = consensus(coarse, weight, lambda: tell(0.24))
    fit = explained(coarse, weight, base)
    if fit.min() < 1:
        weight = weight * fit[:, None, None]
        base, agreement = consensus(coarse, weight, lambda: tell(0.25))
    tell(0.27)
    measured = measured_places(weight)
    counts = (weight > 0.15 * np.percentile(weight, 99)).sum(axis=0)
    average = weight
    # The weights know the expression; it matters for the mouth, hardly for the eyes.
    front = _frontality(cameras)
    mouth = front * neutral * _closed_mouth(reconstruction)
    weight = choose_where_disagreeing(
        weight, agreement, coarse, base, front / neutral, mouth
    )
    total = np.maximum(weight.sum(axis=0), 1e-12)[..., None]
    base = fill((weight[..., None] * coarse).sum(axis=0) / total, measured)
    pairs = _telling(zip(coarse, weight, strict=True), tell, 0.28, 0.3, len(photos))
    own = np.stack([coarse_band(picture, w > 0) for picture, w in pairs])
    smooth = coarse_band(base, np.ones_like(measured))
    inner = inner_part(measured)
    albedo = np.empty((size, size, 3), np.float32)
    for start in range(0, size, _TILE):
        rows = slice(start, min(start + _TILE, size))
        tell(0.3 + 0.65 * start / size)
        check_cancelled = partial(tell, 0.3 + 0.65 * start / size)
        fine = fine_band(
            sources,
            views,
            shading,
            own,
            weight,
            size=size,
            rows=rows,
            check_cancelled=check_cancelled,
        )
        fine *= np.clip(resized(inner, size, rows), 0, 1)[..., None]
        albedo[rows] = resized(smooth, size, rows) + fine
    tell(0.95)
    measured_fine = resized(measured.astype(np.float32), size) > 0.5
    albedo = np.clip(albedo, 0, None)
    mean_light = lights.mean_shading(basis)
    difference = np.abs(coarse - base).mean(axis=3) / np.maximum(
        base.mean(axis=2), 1e-4
    )
    residual = (difference * average).sum(axis=0) / np.maximum(
        average.sum(axis=0), 1e-9
    )
    tell(1.0)
    return Texture(
        albedo=albedo,
        mean=albedo * resized(mean_light, size),
        measured=measured_fine,
        residual=np.where(measured, residual, np.nan).astype(np.float32),
        photos_seen=counts.astype(np.float32),
        lights=lights,
        skin=skin,
    )


def natural_size(views: list[View]) -> int:
    """512, 1024, 2048 or 4096 texels, after the resolution of the sharper photos."""
    best = float(np.percentile([view.resolution for view in views], 80))
    return next((s for s in (512, 1024, 2048) if best <= 1.1 * s), 4096)


def write_texture(
    path: str | os.PathLike,
    linear: Picture,
    depth: int = 8,
    mask: npt.NDArray[np.bool_] | None = None,
) -> Path:
    """Write a texture as an sRGB PNG, row 0 at v = 0.

    Parameters
    ----------
    path : path-like
    linear : (S, S, 3) array
    depth : 8 or 16
    mask : (S, S) bool array, optional
        Written as the alpha channel: opaque where measured.
    """
    picture = to_picture(linear, depth)
    if mask is not None:
        alpha = np.where(mask, np.iinfo(picture.dtype).max, 0).astype(picture.dtype)
        picture = np.dstack([picture, alpha])
    return write_png(path, picture)


def _coarse_sample(source: Picture, view: View) -> Picture:
    """Photo on the coarse grid, blurred to its texels."""
    excess = view.resolution / COARSE
    if excess > 1.2:
        blur = float(0.45 * np.sqrt(excess**2 - 1))
        source = np.asarray(cv2.GaussianBlur(source, (0, 0), blur), np.float32)
    return sample(source, view.xy)


def _skin_seen(
    masks: Sequence[SkinMask], photos: Sequence[Photo], views: Sequence[View]
) -> Picture:
    """How far each texel shows skin in each photo, ``(n, S, S)``."""
    found = np.empty((len(views), COARSE, COARSE), np.float32)
    for i, (mask, photo, view) in enumerate(zip(masks, photos, views, strict=True)):
        xy = photo.to_original(view.xy.reshape(-1, 2).astype(float))
        skin = mask.read(xy).reshape(COARSE, COARSE).astype(np.float32)
        # A step back from hair, as from the rim of what is hidden.
        found[i] = cv2.erode(skin, np.ones((7, 7), np.uint8))
    return found


def _well_exposed(colours: Picture) -> Picture:
    """0 for burnt-out or black texels, 1 for the rest; (n, S, S)."""
    brightest = colours.max(axis=3)
    return np.clip((0.98 - brightest) / 0.08, 0.02, 1) * np.clip(
        brightest / 0.004, 0.02, 1
    )


def _telling(
    items: Iterable, tell: Callable[[float], None], low: float, high: float, count: int
) -> Iterator:
    """The items one after another, the fraction between low and high told before."""
    for k, item in enumerate(items):
        tell(low + (high - low) * k / count)
        yield item


def _lights(
    basis: Picture,
    front: npt.NDArray,
    coarse: Picture,
    weight: Picture,
    check_cancelled: CheckCancelled,
) -> PhotoLights:
    step = COARSE // _LIGHT
    part = slice(step // 2, None, step)
    n = len(coarse)
    lights, _ = estimate_lights(
        coarse[:, part, part].reshape(n, -1, 3).astype(float),
        weight[:, part, part].reshape(n, -1).astype(float),
        basis[part, part].reshape(-1, basis.shape[2]).astype(float),
        front,
        check_cancelled=check_cancelled,
    )
    return lights


def _calmness(reconstruction: Reconstruction) -> npt.NDArray[np.float32]:
    """(n,) weight of each photo by its expression: the surface is that of a calm face.

    An open mouth is not only another picture, it also lies elsewhere on the surface.
    """
    expressions = getattr(reconstruction, "expressions", None)
    if expressions is None or not np.size(expressions):
        return np.ones(len(reconstruction.photos), np.float32)
    size = (np.asarray(expressions, float) ** 2).sum(axis=1)
    return (1 / (1 + size / max(float(np.median(size)), 1.0)) ** 2).astype(np.float32)


def _closed_mouth(reconstruction: Reconstruction) -> npt.NDArray[np.float64]:
    """(n,) 1 for closed lips, falling with the gap between them.

    The surface has closed lips: teeth on it would be painted skin.
    """
    # Inner lip of the 68 iBUG points: above, below, right and left corner.
    inner = np.array([62, 66, 60, 64])
    scheme68 = reconstruction.template.schemes.get("68")
    closed = np.ones(len(reconstruction.photos))
    for i, marks in enumerate(reconstruction.landmarks):
        points = np.asarray(marks.points, float)
        if marks.scheme == "468" and scheme68 is not None:
            points = points[np.asarray(scheme68)]
        elif marks.scheme != "68":
            continue
        above, below, right, left = points[inner]
        width = max(float(np.linalg.norm(left - right)), 1e-9)
        gap = float(np.linalg.norm(below - above)) / width
        closed[i] = 1 / (1 + (gap / 0.06) ** 2)
    return closed


def _frontality(cameras: Sequence[Camera]) -> npt.NDArray[np.float64]:
    """(n,) 1 for a frontal photo, falling with the angle.

    People look at the camera: eyes that are to look straight ahead are those of a
    frontal photo.
    """
    return np.array([max(float(camera.R[2, 2]), 0.05) ** 10 for camera in cameras])
