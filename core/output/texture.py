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
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..errors import ReconstructionError
from .colour import to_picture
from .pictures import write_png
from .texture_light import PhotoLights, estimate_lights
from .texture_views import (
    SurfaceMaps,
    View,
    look_all,
    prefiltered,
    resized,
    sample,
    surface_maps,
)

Picture = npt.NDArray[np.float32]

#: Texels a side of the pictures on which views, lights and the coarse band live.
COARSE = 256
_LIGHT = 64  # texels a side for estimating the lights
_SCALE = 0.12  # Cauchy scale of relative differences between photos
# Weight of all photos together from which on a place counts as measured, relative to
# the well-seen places.
_SEEN = 0.05
# Relative spread between photos up to which they are averaged, from which on the best
# is chosen, and the power that chooses.
_AGREE, _DISAGREE, _POWER = 0.09, 0.18, 30.0
_FINE = 1.5  # power of the weights in the fine band
_EYES_END = 0.42  # v between eyes and mouth, at the nose
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
    """

    albedo: Picture
    mean: Picture
    measured: npt.NDArray[np.bool_]
    residual: Picture
    photos_seen: Picture
    lights: PhotoLights

    @property
    def size(self) -> int:
        """Texels a side."""
        return self.albedo.shape[0]


def bake_texture(
    reconstruction: Any,
    size: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> Texture:
    """Albedo and mean texture from all used photos.

    Parameters
    ----------
    reconstruction : Reconstruction
    size : int, optional
        Texels a side, 64 to 8192. By default 1024, 2048 or 4096: the first that holds
        what the sharpest photos show.
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
    maps = surface_maps(reconstruction.surface, COARSE)
    views = look_all(reconstruction.surface, maps, photos, cameras)
    tell(0.15)
    size = size or natural_size(views)
    sources = [
        prefiltered(photo, view, size)
        for photo, view in zip(photos, views, strict=True)
    ]
    coarse = np.stack(
        [_coarse_sample(s, v) for s, v in zip(sources, views, strict=True)]
    )
    weight = np.stack([view.weight for view in views])
    weight *= _well_exposed(coarse)
    lights = _lights(maps, coarse, weight)
    shading = np.stack([lights.shading(i, maps.normals) for i in range(len(views))])
    coarse /= shading
    # Dark places of a photo tell less about the skin.
    weight = weight * np.clip(shading.mean(axis=3), 0, 2) ** 2
    calm = _calmness(reconstruction)
    weight = weight * calm[:, None, None]
    base, agreement = _consensus(coarse, weight)
    measured = _measured(weight)
    counts = (weight > 0.15 * np.percentile(weight, 99)).sum(axis=0)
    average = weight
    weight = _sharpened(weight, agreement, coarse, base, _frontality(cameras), calm)
    total = np.maximum(weight.sum(axis=0), 1e-12)[..., None]
    base = _fill((weight[..., None] * coarse).sum(axis=0) / total, measured)
    tell(0.3)
    own = np.stack(
        [_band(picture, w > 0) for picture, w in zip(coarse, weight, strict=True)]
    )
    smooth = _band(base, np.ones_like(measured))
    inner = _inner(measured)
    albedo = np.empty((size, size, 3), np.float32)
    for start in range(0, size, _TILE):
        rows = slice(start, min(start + _TILE, size))
        fine = _fine_band(sources, views, shading, own, weight, size, rows)
        fine *= np.clip(resized(inner, size, rows), 0, 1)[..., None]
        albedo[rows] = resized(smooth, size, rows) + fine
        tell(0.3 + 0.65 * rows.stop / size)
    measured_fine = resized(measured.astype(np.float32), size) > 0.5
    albedo = np.clip(albedo, 0, None)
    mean_light = lights.mean_shading(maps.normals)
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
    )


def natural_size(views: list[View]) -> int:
    """1024, 2048 or 4096 texels, after the resolution of the sharper photos."""
    best = float(np.percentile([view.resolution for view in views], 80))
    return next((s for s in (1024, 2048) if best <= 1.1 * s), 4096)


def write_texture(
    path: str | os.PathLike, linear: Picture, depth: int = 8, mask: Any = None
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


# -------------------------------------------------------------------- parts
def _coarse_sample(source: Picture, view: View) -> Picture:
    """Photo on the coarse grid, blurred to its texels."""
    excess = view.resolution / COARSE
    if excess > 1.2:
        blur = float(0.45 * np.sqrt(excess**2 - 1))
        source = np.asarray(cv2.GaussianBlur(source, (0, 0), blur), np.float32)
    return sample(source, view.xy)


def _well_exposed(colours: Picture) -> Picture:
    """0 for burnt-out or black texels, 1 for the rest; (n, S, S)."""
    brightest, darkest = colours.max(axis=3), colours.max(axis=3)
    return np.clip((0.98 - brightest) / 0.08, 0.02, 1) * np.clip(
        darkest / 0.004, 0.02, 1
    )


def _lights(maps: SurfaceMaps, coarse: Picture, weight: Picture) -> PhotoLights:
    step = maps.size // _LIGHT
    part = slice(step // 2, None, step)
    n = len(coarse)
    lights, _ = estimate_lights(
        coarse[:, part, part].reshape(n, -1, 3).astype(float),
        weight[:, part, part].reshape(n, -1).astype(float),
        maps.normals[part, part].reshape(-1, 3),
    )
    return lights


def _calmness(reconstruction: Any) -> npt.NDArray[np.float32]:
    """(n,) weight of each photo by its expression: the surface is that of a calm face.

    An open mouth is not only another picture, it also lies elsewhere on the surface.
    """
    expressions = getattr(reconstruction, "expressions", None)
    if expressions is None or not np.size(expressions):
        return np.ones(len(reconstruction.photos), np.float32)
    size = (np.asarray(expressions, float) ** 2).sum(axis=1)
    return (1 / (1 + size / max(float(np.median(size)), 1.0)) ** 2).astype(np.float32)


def _measured(weight: Picture) -> npt.NDArray[np.bool_]:
    """Places that enough photos see well enough: one piece without holes.

    What only a photo or two see at a grazing angle, under the chin for instance, is as
    often collar as skin.
    """
    seen = cv2.GaussianBlur(weight.sum(axis=0), (0, 0), COARSE / 128)
    mask = (seen > _SEEN * np.percentile(seen, 90)).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
    if count > 1:
        largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
        mask = (labels == largest).astype(np.uint8)
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(mask, outlines, -1, (1,), cv2.FILLED)
    # A hole that no photo sees at all stays one.
    return mask.astype(bool) & (seen > 0)


def _inner(measured: npt.NDArray[np.bool_]) -> Picture:
    """1 inside the measured places, falling softly to 0 at their rim."""
    away = cv2.distanceTransform(
        np.pad(measured, 1, mode="edge").astype(np.uint8), cv2.DIST_L2, 5
    )[1:-1, 1:-1]
    return np.asarray(np.clip(away / (COARSE / 64), 0, 1), np.float32)


def _consensus(delit: Picture, weight: Picture) -> tuple[Picture, Picture]:
    """Robust mean over photos, and how far each photo agrees with it.

    Starts at the weighted median of each channel: with many photos and few outliers
    the mean would do, with hair over half of them it would not.

    Returns
    -------
    base : (S, S, 3) array
    agreement : (n, S, S) array in (0, 1]
    """
    base = _weighted_median(delit, weight)
    agreement = np.ones_like(weight)
    for _ in range(4):
        level = np.maximum(base.mean(axis=2), 1e-4)[..., None]
        square = (((delit - base) / level) ** 2).mean(axis=3)
        agreement = 1 / (1 + square / _SCALE**2)
        trust = (weight * agreement)[..., None]
        total = trust.sum(axis=0)
        base = np.where(
            total > 0, (trust * delit).sum(axis=0) / np.maximum(total, 1e-12), base
        )
    return base.astype(np.float32), agreement.astype(np.float32)


def _weighted_median(values: Picture, weight: Picture) -> Picture:
    """Over the first axis; (n, S, S, 3) and (n, S, S) to (S, S, 3)."""
    result = np.empty(values.shape[1:], np.float32)
    for row in range(values.shape[1]):
        part = values[:, row]
        order = np.argsort(part, axis=0)
        share = np.take_along_axis(
            np.broadcast_to(weight[:, row, :, None], part.shape), order, axis=0
        )
        share = np.cumsum(share, axis=0)
        index = (share < 0.5 * share[-1:]).sum(axis=0, keepdims=True)
        index = np.minimum(index, len(values) - 1)
        ordered = np.take_along_axis(part, order, axis=0)
        result[row] = np.take_along_axis(ordered, index, axis=0)[0]
    return result


def _sharpened(
    weight: Picture,
    agreement: Picture,
    delit: Picture,
    base: Picture,
    frontality: npt.NDArray[np.float64],
    calm: npt.NDArray[np.float32],
) -> Picture:
    """Weights that pick one photo where details disagree and average elsewhere.

    The mean of different gazes, or of hair that moved, is a smear. There the weights
    are raised to a power, so that the best of the typical photos wins. Only detail
    counts: a shadow is a broad difference, and averaging is what removes it.
    """
    level = np.maximum(base.mean(axis=2), 1e-4)
    fine = np.stack([d - cv2.GaussianBlur(d, (0, 0), COARSE / 64) for d in delit])
    total = np.maximum(weight.sum(axis=0), 1e-12)
    centre = (weight[..., None] * fine).sum(axis=0) / total[..., None]
    square = ((fine - centre) ** 2).mean(axis=3) / level**2
    spread = np.sqrt((weight * np.minimum(square, 1)).sum(axis=0) / total)
    spread = cv2.GaussianBlur(spread, (0, 0), COARSE / 64)
    rise = np.clip((spread - _AGREE) / (_DISAGREE - _AGREE), 0, 1)
    rise = rise * rise * (3 - 2 * rise)
    power = 1 + (_POWER - 1) * rise
    # One order of the photos for all such places of the upper half, one for those of
    # the lower: else an eye would be put together from several gazes, or the two eyes
    # would look in different directions.
    typical = np.empty_like(weight)
    middle = round(_EYES_END * COARSE)
    # The weights know the expression already; it matters for the mouth, not the eyes.
    for half, prior in (
        (slice(0, middle), frontality / calm),
        (slice(middle, COARSE), frontality * calm),
    ):
        chosen = (weight * agreement * rise)[:, half].sum(axis=(1, 2)) * prior
        typical[:, half] = (chosen / max(float(chosen.max()), 1e-12))[:, None, None]
    sees = weight / (weight + 0.2 * weight.max(axis=(1, 2), keepdims=True) + 1e-12)
    near = np.stack([_blurred(a, 170) for a in agreement])
    quality = weight * near * (1 - rise) + typical * sees * total * rise
    best = np.maximum(quality.max(axis=0), 1e-12)
    return ((quality / best) ** power * best).astype(np.float32)


def _frontality(cameras: Any) -> npt.NDArray[np.float64]:
    """(n,) 1 for a frontal photo, falling with the angle.

    People look at the camera: eyes that are to look straight ahead are those of a
    frontal photo.
    """
    return np.array([max(float(camera.R[2, 2]), 0.05) ** 10 for camera in cameras])


def _blurred(picture: Picture, part: float) -> Picture:
    """Gaussian blur by the given part of the coarse grid."""
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), COARSE / part), np.float32)


def _band(picture: Picture, known: npt.NDArray[np.bool_]) -> Picture:
    """Coarse band of a (u, v) picture, blurred over what is known only."""
    sigma = COARSE / 64
    mask = known.astype(np.float32)
    total = cv2.GaussianBlur(mask, (0, 0), sigma)[..., None]
    blurred = cv2.GaussianBlur(picture * mask[..., None], (0, 0), sigma)
    return np.where(total > 1e-3, blurred / np.maximum(total, 1e-3), picture)


def _fine_band(
    sources: list[Picture],
    views: list[View],
    shading: Picture,
    own: Picture,
    weight: Picture,
    size: int,
    rows: slice,
) -> Picture:
    """Detail finer than the coarse band, for some rows of the texture."""
    detail, trust = [], []
    # Only photos of some weight: the rest cannot matter, and costs time.
    strongest = resized(weight.max(axis=0), size, rows)
    for i, view in enumerate(views):
        w = np.maximum(resized(weight[i], size, rows), 0)
        w = np.where(w > 0.1 * strongest, w, 0)
        if not w.any():
            continue
        colours = sample(sources[i], resized(view.xy, size, rows))
        colours /= np.maximum(resized(shading[i], size, rows), 1e-6)
        detail.append(colours - resized(own[i], size, rows))
        trust.append(w**_FINE)
    if not detail:
        return np.zeros((rows.stop - rows.start, size, 3), np.float32)
    stack, weights = np.stack(detail), np.stack(trust)
    mean = np.zeros(stack.shape[1:], np.float32)
    robust = weights
    for _ in range(3):
        total = np.maximum(robust.sum(axis=0), 1e-12)[..., None]
        mean = (robust[..., None] * stack).sum(axis=0) / total
        square = ((stack - mean) ** 2).mean(axis=3)
        spread = np.maximum(np.median(square, axis=0), 1e-6)
        robust = weights / (1 + square / (4 * spread))
    return mean


def _fill(picture: Picture, known: npt.NDArray[np.bool_]) -> Picture:
    """Fill unknown texels from around them by a pyramid (push-pull)."""
    levels = [(picture * known[..., None], known.astype(np.float32))]
    while min(levels[-1][1].shape) > 1:
        colours, mask = levels[-1]
        half = (max(1, mask.shape[1] // 2), max(1, mask.shape[0] // 2))
        small = cv2.resize(mask, half, interpolation=cv2.INTER_AREA)
        sums = cv2.resize(colours, half, interpolation=cv2.INTER_AREA)
        filled = np.where(small[..., None] > 0, sums, 0)
        # Coarser levels hold averages of what is known, at full strength.
        strength = np.minimum(4 * small, 1)
        filled = filled * (strength / np.maximum(small, 1e-9))[..., None]
        levels.append((filled, strength))
    result = levels[-1][0] / max(float(levels[-1][1].max()), 1e-9)
    for colours, mask in levels[-2::-1]:
        shape = (mask.shape[1], mask.shape[0])
        wide = cv2.resize(result, shape, interpolation=cv2.INTER_LINEAR)
        result = colours + (1 - mask[..., None]) * wide.reshape(colours.shape)
    return result.astype(np.float32)
