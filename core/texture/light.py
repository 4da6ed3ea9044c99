"""The light of each photo in colour, and what it leaves of the skin's own colour.

``I_ijc = a_jc  L_ic . Y_j``: texel j of photo i in channel c is albedo times the light,
25 spherical harmonics, each integrated over the sky that the face leaves open there
(see ``photometry.transfer``), so that its own shadows are not darker skin. Lights and
albedo are solved in turn, each robustly: highlights, hair and closed eyes are outliers
in one photo, not skin. Exposure and colour cast of a photo are part of its lights, so
this balances the photos as well.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .._types import Array
from ..gram import gram
from ..photometry.transfer import Transfer, radiance_transfer
from ..progress import CheckCancelled, never_cancelled
from ..surface.bspline import BSplineSurface
from .views import channel_mean, resized, texel_centres

Picture = npt.NDArray[np.float32]

#: Shading is not allowed below this part of a photo's mean: there is no dividing by it.
DARKEST = 0.12
#: Degree of the light's harmonics; the reconstruction's own 6 is for its shape.
DEGREE = 4
_SKY = 128  # texels a side on which the harmonics are integrated over the open sky
_BATCH = 8  # photos whose slopes are computed at a time
_SCALE = 0.15  # Cauchy scale of the relative residual
_RIDGE = 3e-3


@dataclass(frozen=True, eq=False)
class PhotoLights:
    """Lights of n photos.

    Attributes
    ----------
    coefficients : (n, k, 3) array
        Harmonics of the head's axes for each colour channel. Scaled so that the mean
        shading over photos and skin is 1 in each channel.
    front : (k,) array
        Shading by each harmonic, averaged over normals that look forwards: what the
        exposure of a photo is measured by.
    """

    coefficients: Array
    front: Array

    def shading(self, photo: int, basis: Array | Picture) -> npt.NDArray[np.float32]:
        """(..., 3) shading of a photo; ``basis`` (..., k) is that by each harmonic."""
        light = self.coefficients[photo]
        floor = DARKEST * np.maximum(self.front @ light, 1e-6)
        return np.maximum(basis @ light, floor).astype(np.float32)

    def mean_shading(self, basis: Array | Picture) -> npt.NDArray[np.float32]:
        """(..., 3) shading averaged over photos, each at the same exposure."""
        total = np.zeros((*basis.shape[:-1], 3), np.float32)
        for photo, light in enumerate(self.coefficients):
            exposure = np.maximum(self.front @ light, 1e-6).astype(np.float32)
            total += self.shading(photo, basis) / exposure
        return total / len(self.coefficients)


_FRONT = np.array(
    [[x, y, np.sqrt(1 - x * x - y * y)] for x in (-0.5, 0, 0.5) for y in (-0.5, 0, 0.5)]
)


@dataclass(frozen=True)
class Sky:
    """What a surface sees of the directions around it, on `_SKY` texels a side.

    Attributes
    ----------
    transfer : Transfer
    normals : (p, 3) array
        Of the same points, row by row.
    """

    transfer: Transfer
    normals: Array

    def maps(self, size: int) -> tuple[Picture, Array]:
        """What each harmonic of the light does on the surface, shadows included.

        Returns
        -------
        basis : (size, size, k) float32 array
            Row v, column u.
        front : (k,) array
            As in `PhotoLights`.
        """
        over = self.transfer
        front = np.maximum(_FRONT @ over.directions.T, 0) @ over.light
        return _enlarged(over.basis(self.normals), size), front.mean(axis=0)

    def slopes(self, lights: Array, size: int) -> Iterator[Picture]:
        """Derivative of the logarithm of each photo's shading by the normal.

        Parameters
        ----------
        lights : (n, k, 3) array
            Harmonics of each photo's light.
        size : int

        Yields
        ------
        (size, size, 3) float32 array
            Mean over the channels; 0 where it is too dark for a shading.
        """
        basis = self.transfer.basis(self.normals)
        for start in range(0, len(lights), _BATCH):
            some = lights[start : start + _BATCH]
            rows = some.transpose(0, 2, 1).reshape(-1, some.shape[1])
            turned = self.transfer.slopes(self.normals, rows)
            for light, own in zip(some, np.split(turned, len(some)), strict=True):
                shading = basis @ light
                lit = shading > DARKEST * shading.mean(axis=0)
                per_shading = np.where(lit, 1 / np.where(lit, shading, 1), 0)
                mean = sum(
                    s[:, None] * t for s, t in zip(per_shading.T, own, strict=True)
                )
                yield _enlarged(mean / shading.shape[1], size)


def open_sky(surface: BSplineSurface) -> Sky:
    """The sky over a surface, its own shadows included."""
    at = texel_centres(_SKY)
    v, u = (x.ravel() for x in np.meshgrid(at, at, indexing="ij"))
    transfer = radiance_transfer(surface, np.stack([u, v], axis=1), DEGREE)
    return Sky(transfer, surface.normals(u, v))


def _enlarged(values: Array, size: int) -> Picture:
    """Values (p, k) at the points of a `Sky` as a picture (size, size, k)."""
    picture = values.reshape(_SKY, _SKY, -1)
    # the picture functions take four channels at a time
    parts = [
        resized(picture[..., k : k + 4], size).reshape(size, size, -1)
        for k in range(0, picture.shape[2], 4)
    ]
    return np.concatenate(parts, axis=2)


def estimate_lights(
    intensity: Array,
    weight: Array,
    basis: Array,
    front: Array,
    iterations: int = 6,
    check_cancelled: CheckCancelled = never_cancelled,
) -> tuple[PhotoLights, Array]:
    """Lights of all photos and the albedo of the sample points.

    Parameters
    ----------
    intensity : (n, p, 3) array
        Linear colours.
    weight : (n, p) array
        0 where a photo does not see a point.
    basis : (p, k) array
        Shading of each point by each harmonic of the light.
    front : (k,) array
        As in `PhotoLights`.
    iterations : int
    check_cancelled : callable
        Called for each photo in every iteration; may raise `Cancelled`.

    Returns
    -------
    lights : PhotoLights
    albedo : (p, 3) array
        0 for points that no photo sees.
    """
    n, p = weight.shape
    # Skin of one colour to begin with: what varies over the face goes to the light
    # first, what does not turn with the light comes back as albedo.
    level = np.array([np.median(intensity[weight > 0][:, c]) for c in range(3)])
    albedo = np.tile(np.maximum(level, 1e-6), (p, 1))
    lights = np.zeros((n, basis.shape[1], 3))
    for step in range(iterations):
        for i in range(n):
            check_cancelled()
            lights[i] = _fit_light(intensity[i], albedo, weight[i], basis, lights[i])
        shading = basis @ lights
        floor = DARKEST * np.einsum("k,ikc->ic", front, lights)
        shading = np.maximum(shading, np.maximum(floor, 1e-6)[:, None])
        albedo = _fit_albedo(intensity, shading, weight, albedo)
        if step == 0:
            # The first lights were fitted to brows and lips as if they were skin.
            middle = np.median(albedo[albedo[:, 0] > 0], axis=0)
            albedo = np.where(albedo > 0, 0.5 * albedo + 0.5 * middle, 0)
        # Gauge: mean shading 1 in each channel.
        seen = weight[..., None] > 0
        gauge = (shading * seen).sum(axis=(0, 1)) / np.maximum(seen.sum((0, 1)), 1)
        albedo *= gauge
        lights /= gauge
    return PhotoLights(lights, front), albedo


def _fit_light(
    colours: Array, albedo: Array, weight: Array, basis: Array, start: Array
) -> Array:
    """Robust ridge least squares of the light of one photo, (k, 3).

    ``start`` (k, 3) says which colours are outliers, unless it is 0.
    """
    used = (weight > 0) & (albedo > 0).all(axis=1)
    order = basis.shape[1]
    if not used.any():
        light = np.zeros_like(start)
        light[0] = 1.0
        return light
    basis, albedo, colours = basis[used], albedo[used], colours[used]
    level = np.maximum(np.median(colours, axis=0), 1e-6)
    # One matrix for the three channels: what is fitted is colour over albedo.
    shading, energy = colours / albedo, weight[used] * channel_mean(albedo**2)
    degree = np.sqrt(np.arange(order)).astype(int)
    strength = np.diag(np.select([degree == 0, degree == 1], [1e-6, 0.3], 1.0))
    light = start
    for _ in range(2 if start.any() else 4):
        robust = energy
        if light.any():
            residual = albedo * (shading - basis @ light) / level
            # One weight too: an outlier is one as a colour.
            robust = energy / (1 + channel_mean(residual**2) / _SCALE**2)
        normal = gram(np.sqrt(robust)[:, None] * basis)
        scale = np.trace(normal) / order
        normal += _RIDGE * scale * strength + 1e-12 * np.eye(order)
        light = np.linalg.solve(normal, basis.T @ (robust[:, None] * shading))
    return light


def _fit_albedo(intensity: Array, shading: Array, weight: Array, start: Array) -> Array:
    """Robust mean over photos of intensity / shading, (p, 3)."""
    ratio = intensity / shading
    # A ratio of dark numbers is noisy: its variance goes with 1 / shading^2.
    trust = weight[..., None] * shading**2
    albedo = start
    for _ in range(3):
        residual = (ratio - albedo) / np.maximum(albedo, 1e-6)
        # One weight for the three channels: an outlier is one as a colour.
        size = channel_mean(residual**2)[..., None]
        robust = trust / (1 + size / _SCALE**2)
        total = robust.sum(axis=0)
        albedo = np.divide(
            (robust * ratio).sum(axis=0),
            total,
            out=np.zeros(start.shape),
            where=total > 0,
        )
    return albedo
