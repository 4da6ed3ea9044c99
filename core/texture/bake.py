"""The face's skin on its own (u, v): de-lit albedo and mean texture from all photos.

Each photo is divided by its own light (:mod:`.light`), which also balances
exposure and colour. What is left is blended in two bands (Burt and Adelson 1983;
Baumberg 2002): the coarse band is a robust mean over all photos, so no seam can appear
where one photo ends; the fine band favours the photos that see a place best and agree
with the others, so a shifted photo leaves no ghost. Where details disagree in any case
(gaze, hair, lips) one typical photo is taken instead of the smear of all. Texels that
no photo sees are filled smoothly and marked.

Pictures over (u, v): row 0 is v = 0, the top; see :mod:`.views`. In Blender the
surface's ``UVMap`` has the core's v, and Blender counts picture rows from the bottom:
give the image texture a Mapping node with scale (1, -1, 1) and location (0, 1, 0). In
exported files v is turned round already, so the picture fits as it is.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..camera.camera import Camera
from ..drawing.pictures import write_png
from ..errors import ReconstructionError
from ..images.colour import to_picture
from ..kinds import CALLBACK, SWITCH, expect, expect_paths, expect_picture, expect_whole
from ..photometry.skin import SkinMask, skin_masks
from ..progress import CheckCancelled
from ..result import Reconstruction
from ..threads import one_blas_thread
from .blend import (
    choose_where_disagreeing,
    coarse_band,
    fill,
    fine_band,
    inner_part,
    measured_places,
)
from .choice import differing_photos, with_photos
from .delit import delit_photos, telling
from .detail import Detail
from .detail_measurement import measure_detail
from .light import PhotoLights
from .views import channel_mean, faces_of, resized

Picture = npt.NDArray[np.float32]

_TILE = 64  # texture rows blended at a time


@dataclass(frozen=True, eq=False)
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
        measured, and where one photo alone does, which agrees with itself.
    photos_seen : (C, C) float32 array
        How many of its photos count at each place.
    photos : tuple of int
        Numbers of the used photos that it is made of: all, or those that differ most.
    lights : PhotoLights
        Of these photos.
    skin : tuple of SkinMask
        What of each used photo is skin.
    detail : Detail or None
        Relief that the control net cannot hold; None when not asked for.
    """

    albedo: Picture
    mean: Picture
    measured: npt.NDArray[np.bool_]
    residual: Picture
    photos_seen: Picture
    photos: tuple[int, ...]
    lights: PhotoLights
    skin: tuple[SkinMask, ...]
    detail: Detail | None = None

    @property
    def size(self) -> int:
        """Texels a side."""
        return self.albedo.shape[0]


@one_blas_thread()
def bake_texture(
    reconstruction: Reconstruction,
    size: int | None = None,
    progress: Callable[[float], None] | None = None,
    *,
    detail: bool = True,
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
    detail : bool
        Whether normal map and displacement are measured too.

    Raises
    ------
    ReconstructionError
        When no photo with a camera is there.
    ValueError
        When ``size`` is out of range.
    """
    expect(Reconstruction, "a Reconstruction", reconstruction=reconstruction)
    expect(CALLBACK, "a function", progress=progress)
    expect(SWITCH, "true or false", detail=detail)
    if size is not None:
        expect_whole(64, 8192, size=size)
    if not reconstruction.has_pixels:
        raise ReconstructionError(
            "A texture needs the photos of the reconstruction; run it again with them."
        )
    tell = progress or (lambda fraction: None)
    skin = reconstruction.skin or _skin(reconstruction, partial(tell, 0.0))
    chosen = differing_photos(reconstruction)
    reconstruction = with_photos(reconstruction, chosen)
    delit = delit_photos(reconstruction, [skin[i] for i in chosen], size, tell)
    size, views = delit.size, delit.views
    weight, base, agreement = delit.weight, delit.base, delit.agreement
    coarse, neutral = delit.colours, delit.neutral
    measured = measured_places(weight)
    counts = (weight > 0.15 * np.percentile(weight, 99)).sum(axis=0)
    compared = measured & ((weight > 0).sum(axis=0) > 1)
    average = weight
    # The weights know the expression; it matters for the mouth, hardly for the eyes.
    front = _frontality(reconstruction.cameras)
    mouth = front * neutral * _closed_mouth(reconstruction)
    weight = choose_where_disagreeing(
        weight, agreement, coarse, base, front / neutral, mouth
    )
    total = np.maximum(weight.sum(axis=0), 1e-12)[..., None]
    base = fill((weight[..., None] * coarse).sum(axis=0) / total, measured)
    pairs = telling(zip(coarse, weight, strict=True), tell, 0.28, 0.3, len(chosen))
    own = np.stack([coarse_band(picture, w > 0) for picture, w in pairs])
    smooth = coarse_band(base, np.ones_like(measured))
    inner = inner_part(measured)
    albedo = np.empty((size, size, 3), np.float32)
    last = 0.8 if detail else 0.95
    for start in range(0, size, _TILE):
        rows = slice(start, min(start + _TILE, size))
        tell(0.3 + (last - 0.3) * start / size)
        check_cancelled = partial(tell, 0.3 + (last - 0.3) * start / size)
        fine = fine_band(
            delit.sources,
            views,
            delit.shading,
            own,
            weight,
            size=size,
            rows=rows,
            check_cancelled=check_cancelled,
        )
        fine *= np.clip(resized(inner, size, rows), 0, 1)[..., None]
        albedo[rows] = resized(smooth, size, rows) + fine
    tell(last)
    relief = None
    if detail:
        check_cancelled = partial(tell, last)
        relief = measure_detail(reconstruction, delit, measured, check_cancelled)
    tell(0.95)
    measured_fine = resized(measured.astype(np.float32), size) > 0.5
    albedo = np.clip(albedo, 0, None)
    mean_light = delit.lights.mean_shading(delit.basis)
    level = np.maximum(channel_mean(base), 1e-4)
    difference = channel_mean(np.abs(coarse - base)) / level
    residual = (difference * average).sum(axis=0) / np.maximum(
        average.sum(axis=0), 1e-9
    )
    tell(1.0)
    return Texture(
        albedo=albedo,
        mean=albedo * resized(mean_light, size),
        measured=measured_fine,
        residual=np.where(compared, residual, np.nan).astype(np.float32),
        photos_seen=counts.astype(np.float32),
        lights=delit.lights,
        photos=tuple(chosen),
        skin=skin,
        detail=relief,
    )


def _skin(
    reconstruction: Reconstruction, check_cancelled: CheckCancelled
) -> tuple[SkinMask, ...]:
    """What of each photo is skin, for a method that did not ask."""
    faces = faces_of(reconstruction)
    return skin_masks(
        reconstruction.photos,
        faces[0] if all(face is faces[0] for face in faces) else faces,
        reconstruction.cameras,
        reconstruction.template,
        check_cancelled,
    )


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
    linear : (S, S, 3) array of floats
        Intensities in [0, 1]; what lies beyond is clipped.
    depth : 8 or 16
    mask : (S, S) bool array, optional
        Written as the alpha channel: opaque where measured.

    Raises
    ------
    TypeError, ValueError
        No such picture, another depth, or a name that does not end in .png.
    """
    expect_paths(path=path)
    expect_picture(linear, "linear", "linear intensities in [0, 1]", 3)
    expect(np.ndarray | None, "an array", mask=mask)
    square = linear.shape[:1] * 2
    if mask is not None and (mask.dtype != bool or mask.shape != square):
        raise ValueError(
            f"mask must be a bool array of shape {square}, not {mask.dtype} of "
            f"shape {mask.shape}."
        )
    picture = to_picture(linear, depth)
    if mask is not None:
        alpha = np.where(mask, np.iinfo(picture.dtype).max, 0).astype(picture.dtype)
        picture = np.dstack([picture, alpha])
    return write_png(path, picture)


def _closed_mouth(reconstruction: Reconstruction) -> npt.NDArray[np.float64]:
    """(n,) 1 for closed lips, falling with the gap between them.

    The surface has closed lips: teeth on it would be painted skin.
    """
    # Inner lip of the 68 iBUG points: above, below, right and left corner.
    inner = np.array([62, 66, 60, 64])
    scheme68 = reconstruction.template.schemes["68"]
    closed = np.ones(len(reconstruction.photos))
    for i, marks in enumerate(reconstruction.landmarks):
        points = np.asarray(marks.points, float)
        if marks.scheme == "468":
            points = points[scheme68]
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
