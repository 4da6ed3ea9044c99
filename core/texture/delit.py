"""All photos of a face on its (u, v), each divided by its own light.

What the texture and the detail are made of: where each texel lies in each photo, how
much it counts there, and its colour without the light of the photo
(:mod:`.light`), which also balances exposure and colour.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from ..errors import ReconstructionError
from ..images.photo import Photo, pixels_in
from ..photometry.skin import SkinMask
from ..progress import CheckCancelled
from ..result import Reconstruction
from .blend import COARSE, consensus, explained, weighted_median
from .light import PhotoLights, Sky, estimate_lights, open_sky
from .views import (
    View,
    channel_mean,
    prefiltered,
    sample,
    view_photos,
)

Picture = npt.NDArray[np.float32]
Tell = Callable[[float], None]

_LIGHT = 64  # texels a side for estimating the lights


@dataclass(frozen=True)
class DelitPhotos:
    """n photos on the coarse grid of texels, C a side.

    Attributes
    ----------
    sources : list of (h, w, 3) float32 arrays
        Linear cut-outs, blurred to what the texture holds.
    views : list of View
    size : int
        Texels a side of the texture.
    natural : int
        Texels a side that hold what the sharpest photos show.
    lights : PhotoLights
    sky : Sky
    basis : (C, C, k) float32 array
        Shading by each harmonic of the light, the face's own shadows included.
    shading : (n, C, C, 3) float32 array
        By the light of each photo.
    colours : (n, C, C, 3) float32 array
        The photos divided by it.
    weight : (n, C, C) float32 array
        How much each photo counts; 0 where it does not see a texel.
    neutral : (n,) float32 array
        The part of that by its expression.
    base : (C, C, 3) float32 array
        Robust mean of the colours.
    agreement : (n, C, C) float32 array
        How far each photo agrees with it.
    """

    sources: list[Picture]
    views: list[View]
    size: int
    natural: int
    lights: PhotoLights
    sky: Sky
    basis: Picture
    shading: Picture
    colours: Picture
    weight: Picture
    neutral: npt.NDArray[np.float32]
    base: Picture
    agreement: Picture


def delit_photos(
    reconstruction: Reconstruction,
    skin: Sequence[SkinMask],
    size: int | None,
    tell: Tell,
) -> DelitPhotos:
    """The used photos on the surface, without their light.

    Parameters
    ----------
    reconstruction : Reconstruction
        With pixels.
    skin : sequence of n SkinMask
        What of each photo is skin.
    size : int or None
        Texels a side of the texture; by default those that the photos are worth.
    tell : callable
        Called with the fraction done of a texture, 0 to 0.27.

    Raises
    ------
    ReconstructionError
        When no photo shows skin.
    """
    photos = reconstruction.photos
    seen = view_photos(reconstruction, COARSE)
    views = list(telling(seen, tell, 0.0, 0.12, len(photos)))
    natural = natural_size(views)
    size = size or natural
    pairs = telling(zip(photos, views, strict=True), tell, 0.12, 0.15, len(photos))
    sources = [prefiltered(photo, view, size) for photo, view in pairs]
    pairs = telling(zip(sources, views, strict=True), tell, 0.15, 0.17, len(photos))
    colours = np.stack([_coarse_sample(s, v) for s, v in pairs])
    weight = np.stack([view.weight for view in views])
    weight *= _well_exposed(colours)
    weight *= _skin_seen(skin, photos, views)
    tell(0.17)
    sky = open_sky(reconstruction.surface)
    basis, front = sky.maps(COARSE)
    lights = _lights(basis, front, colours, weight, lambda: tell(0.19))
    tell(0.22)
    shading = np.stack([lights.shading(i, basis) for i in range(len(views))])
    colours /= shading
    # Dark places of a photo tell less about the skin.
    weight = weight * np.clip(channel_mean(shading), 0, 2) ** 2
    neutral = _calmness(reconstruction)
    weight = weight * neutral[:, None, None]
    tell(0.24)
    middle = weighted_median(colours, weight, lambda: tell(0.24))
    weight = weight * explained(colours, weight, middle)[:, None, None]
    base, agreement = consensus(colours, weight, middle, lambda: tell(0.25))
    tell(0.27)
    return DelitPhotos(
        sources=sources,
        views=views,
        size=size,
        natural=natural,
        lights=lights,
        sky=sky,
        basis=basis,
        shading=shading,
        colours=colours,
        weight=weight,
        neutral=neutral,
        base=base,
        agreement=agreement,
    )


def natural_size(views: list[View]) -> int:
    """512, 1024, 2048 or 4096 texels, after the resolution of the sharper photos."""
    best = float(np.percentile([view.resolution for view in views], 80))
    return next((s for s in (512, 1024, 2048) if best <= 1.1 * s), 4096)


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
        xy = pixels_in(mask.window, photo.to_original(view.xy.astype(float)))
        skin = sample(mask.values, np.asarray(xy, np.float32))
        # A step back from hair, as from the rim of what is hidden.
        found[i] = cv2.erode(skin, np.ones((7, 7), np.uint8))
    return found


def _well_exposed(colours: Picture) -> Picture:
    """0 for burnt-out or black texels, 1 for the rest; (n, S, S)."""
    brightest = np.maximum.reduce([colours[..., c] for c in range(3)])
    return np.clip((0.98 - brightest) / 0.08, 0.02, 1) * np.clip(
        brightest / 0.004, 0.02, 1
    )


def telling(
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
    if not weight[:, part, part].any():
        raise ReconstructionError(
            "The photos show no skin of which a texture could be made; check their "
            "masks."
        )
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
    expressions = reconstruction.expressions
    if not expressions.size:
        return np.ones(len(reconstruction.photos), np.float32)
    size = (expressions**2).sum(axis=1)
    return (1 / (1 + size / max(float(np.median(size)), 1.0)) ** 2).astype(np.float32)
