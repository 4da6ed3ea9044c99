"""The light of each photo in colour, and what it leaves of the skin's own colour.

``I_ijc = a_jc  L_ic . Y(n_j)``: texel j of photo i in channel c is albedo times the
light, nine spherical harmonics of the normal (see ``evidence.harmonics``). Lights and
albedo are solved in turn, each robustly: shadows, highlights, hair and closed eyes are
outliers in one photo, not skin. Exposure and colour cast of a photo are part of its
lights, so this balances the photos as well.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..evidence import harmonics

Array = npt.NDArray[np.float64]

#: Shading is not allowed below this part of a photo's mean: there is no dividing by it.
DARKEST = 0.12
_SCALE = 0.15  # Cauchy scale of the relative residual
_RIDGE = 3e-3


@dataclass(frozen=True)
class PhotoLights:
    """Lights of n photos.

    Attributes
    ----------
    coefficients : (n, 9, 3) array
        Harmonics of the head's axes for each colour channel. Scaled so that the mean
        shading over photos and skin is 1 in each channel.
    """

    coefficients: Array

    def shading(self, photo: int, normals: Array) -> npt.NDArray[np.float32]:
        """(..., 3) shading of a photo at normals (..., 3)."""
        light = self.coefficients[photo]
        value = harmonics.basis(normals) @ light
        # The mean over the sphere's front stands for the photo's exposure.
        floor = DARKEST * np.maximum(_frontal_mean(light), 1e-6)
        return np.maximum(value, floor).astype(np.float32)

    def mean_shading(self, normals: Array) -> npt.NDArray[np.float32]:
        """(..., 3) shading averaged over photos, each at the same exposure."""
        total = np.zeros((*normals.shape[:-1], 3), np.float32)
        for photo, light in enumerate(self.coefficients):
            total += self.shading(photo, normals) / np.maximum(
                _frontal_mean(light), 1e-6
            ).astype(np.float32)
        return total / len(self.coefficients)


_FRONT = np.array(
    [[x, y, np.sqrt(1 - x * x - y * y)] for x in (-0.5, 0, 0.5) for y in (-0.5, 0, 0.5)]
)


def _frontal_mean(light: Array) -> Array:
    """Mean shading (3,) over normals that look forwards."""
    return (harmonics.basis(_FRONT) @ light).mean(axis=0)


def estimate_lights(
    intensity: Array, weight: Array, normals: Array, iterations: int = 6
) -> tuple[PhotoLights, Array]:
    """Lights of all photos and the albedo of the sample points.

    Parameters
    ----------
    intensity : (n, p, 3) array
        Linear colours.
    weight : (n, p) array
        0 where a photo does not see a point.
    normals : (p, 3) array
    iterations : int

    Returns
    -------
    lights : PhotoLights
    albedo : (p, 3) array
        0 for points that no photo sees.
    """
    basis = harmonics.basis(normals)
    n, p = weight.shape
    # Skin of one colour to begin with: what varies over the face goes to the light
    # first, what does not turn with the light comes back as albedo.
    level = np.array([np.median(intensity[weight > 0][:, c]) for c in range(3)])
    albedo = np.tile(np.maximum(level, 1e-6), (p, 1))
    lights = np.zeros((n, 9, 3))
    for step in range(iterations):
        for i in range(n):
            for c in range(3):
                lights[i, :, c] = _fit_light(
                    intensity[i, :, c], albedo[:, c], weight[i], basis
                )
        shading = np.einsum("pk,ikc->ipc", basis, lights)
        floor = DARKEST * np.einsum("qk,ikc->ic", harmonics.basis(_FRONT), lights) / 9
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
    return PhotoLights(lights), albedo


def _fit_light(value: Array, albedo: Array, weight: Array, basis: Array) -> Array:
    """Robust ridge least squares of one channel of one photo, (9,)."""
    design = albedo[:, None] * basis
    used = (weight > 0) & (albedo > 0)
    light = np.zeros(9)
    if not used.any():
        light[0] = 1.0
        return light
    design, value, weight = design[used], value[used], weight[used]
    level = max(float(np.median(value)), 1e-6)
    strength = np.diag(np.r_[1e-6, np.full(3, 0.3), np.full(5, 1.0)])
    robust = weight.copy()
    for _ in range(4):
        normal = design.T @ (design * robust[:, None])
        scale = np.trace(normal) / 9
        light = np.linalg.solve(
            normal + _RIDGE * scale * strength + 1e-12 * np.eye(9),
            design.T @ (robust * value),
        )
        residual = (value - design @ light) / level
        robust = weight / (1 + (residual / _SCALE) ** 2)
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
        size = (residual**2).mean(axis=2, keepdims=True)
        robust = trust / (1 + size / _SCALE**2)
        total = robust.sum(axis=0)
        albedo = np.divide(
            (robust * ratio).sum(axis=0),
            total,
            out=np.zeros(start.shape),
            where=total > 0,
        )
    return albedo
