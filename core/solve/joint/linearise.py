"""The residuals of all intensities and their derivatives.

With the displacement ``delta`` of the surface along its normals, the residual of photo
``i`` at point ``j``

    r_ij = I_i(pi_i(X_j)) - rho_j L_i . Y(n_j)

changes by ``(grad I . dpi/dX n_j) delta`` (motion, 0th order) and by
``rho_j L_i Y'(n_j) (g^u delta_u + g^v delta_v)`` (shading, 1st order, because the
normal turns by minus the surface gradient of ``delta``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from ..._types import Array, Mask
from ...camera.camera import PARAMETERS, Camera
from ...gram import product
from ...images.photo import Photo
from ...photometry.lighting import estimate_lighting, photo_noise, robust_weights
from ...photometry.skin import SkinMask
from ...surface.bspline import BSplineSurface
from .samples import Geometry, Samples
from .state import State


class Picture(Protocol):
    """A smooth photo; `IntensityField` is one."""

    def read(self, xy: Array, /) -> tuple[Array, Array, Mask]:
        """Intensity (p, 1), gradient (p, 1, 2), inside (p,) at pixels (p, 2)."""
        ...

    def around(self, xy: Array, margin: float, /) -> Picture:
        """What has to be kept to read about these places."""
        ...


class PictureReader(Protocol):
    """Makes the picture of a level; `smooth_photo` is one."""

    def __call__(self, photo: Photo, camera: Camera, blur_mm: float, /) -> Picture:
        """The photo smoothed by a Gaussian of ``blur_mm`` at the head."""
        ...


class Visibility(Protocol):
    """Says what each photo sees; `view_weights` is one."""

    def __call__(
        self,
        surface: BSplineSurface | Sequence[BSplineSurface],
        cameras: Sequence[Camera],
        uv: Array,
        grazing: float,
        /,
    ) -> Array:
        """Weight (n, p) of the points of a face, or of the face of each photo."""
        ...


class Readings(NamedTuple):
    """What n photos show at the samples.

    Attributes
    ----------
    geometry : Geometry
    harmonics : (k, p, q) array
        Shading of the samples by each harmonic of the light, for each of k faces.
    view : (n, p) array
        Weight by the viewing angle, 0 where a photo does not see the point.
    values : (n, p) array
        Intensities over the median of their photo.
    by_motion : (n, 7 + e, p) array
        Derivative of the values by the parameters of `Camera.moved` and by the
        expression modes.
    by_displacement : (n, p) array
        Derivative by a displacement of the point along its direction.
    """

    geometry: Geometry
    harmonics: Array
    view: Array
    values: Array
    by_motion: Array
    by_displacement: Array


class Shading(NamedTuple):
    """Lights and albedo that explain the values, and what is left.

    Attributes
    ----------
    lights : (n, q) array
    albedo : (p,) array
    weights : (n, p) array
        Robust, 0 where a photo does not see the point.
    residual : (n, p) array
    noise : float or (n, 1) array
        Cauchy scale of the residuals, of all photos or of each.
    albedo_precision : float
        Of the albedo before the values are looked at; 0 = nothing is known of it.
    """

    lights: Array
    albedo: Array
    weights: Array
    residual: Array
    noise: float | Array
    albedo_precision: float = 0.0


class ShadingSolver(Protocol):
    """Estimates light and albedo for a known face; `RobustShading` is one."""

    def __call__(self, seen: Readings, samples: Samples, state: State, /) -> Shading:
        """Light and albedo, from those of ``state`` on."""
        ...


@dataclass(frozen=True)
class RobustShading:
    """Lights, albedo and Cauchy weights by turns.

    Attributes
    ----------
    noise : float
        Cauchy scale of the residuals of a usual photo, see `photo_noise`.
    ridge : float
        Of the lights, relative.
    """

    noise: float
    ridge: float

    def __call__(self, seen: Readings, samples: Samples, state: State, /) -> Shading:
        """See `ShadingSolver`."""
        view = seen.view * samples.area
        lights, albedo, _, residual = estimate_lighting(
            seen.values,
            view,
            seen.harmonics,
            state.lights,
            state.albedo,
            noise=self.noise,
            ridge=self.ridge,
        )
        noise = photo_noise(view, residual, self.noise)
        weights = robust_weights(view, residual, noise)
        return Shading(lights, albedo, weights, residual, noise)


class Linearisation(NamedTuple):
    """Residuals ``r + T_a c_a (dd + D da) + h_i dz_i - s drho`` with their precision.

    Attributes
    ----------
    samples : Samples
    residual, precision : (n, p) arrays
    by_displacement : (3, n, p) array
        ``c``: derivative by the displacement and by its two slopes.
    by_motion : (n, 7 + e, p) array
        First columns of ``h``: camera and expression.
    harmonics : (k, p, q) array
        Shading by each harmonic, for all photos (k = 1) or for each of them; times
        minus the albedo these are the last columns of ``h``.
    albedo : (p,) array
    shading : (n, p) array
        ``s``: minus the derivative by the albedo.
    albedo_precision : float
        Known of the albedo beforehand.
    """

    samples: Samples
    residual: Array
    precision: Array
    by_displacement: Array
    by_motion: Array
    harmonics: Array
    albedo: Array
    shading: Array
    albedo_precision: float = 0.0

    def by_photo(self, i: int) -> Array:
        """``h_i``: derivative by the parameters of photo ``i``, ``(p, m)``."""
        Y = self.harmonics[i if len(self.harmonics) > 1 else 0]
        return np.concatenate([self.by_motion[i].T, -self.albedo[:, None] * Y], 1)

    def thinned(self, every: int) -> Linearisation:
        """One of ``every`` samples, with the precision of as many."""
        samples = self.samples
        return Linearisation(
            samples._replace(uv=samples.uv[::every], T=[t[::every] for t in samples.T]),
            self.residual[:, ::every],
            every * self.precision[:, ::every],
            self.by_displacement[:, :, ::every],
            self.by_motion[:, :, ::every],
            self.harmonics[:, ::every],
            self.albedo[::every],
            self.shading[:, ::every],
            self.albedo_precision * every,
        )

    def change(self, z: Array) -> Array:
        """``h_i z_i``: change of the residuals (n, p) by photo parameters (n, m)."""
        motion, light = np.split(z, [self.by_motion.shape[1]], axis=1)
        if len(self.harmonics) == 1:
            out = product(light, self.harmonics[0].T)
        else:
            out = np.matmul(self.harmonics, light[..., None])[..., 0]
        out *= -self.albedo
        out += np.matmul(motion[:, None], self.by_motion)[:, 0]
        return out

    def pull(self, x: Array) -> Array:
        """``h_i^T x_i``, ``(n, m)``, for ``x`` (n, p)."""
        motion = np.matmul(self.by_motion, x[..., None])[..., 0]
        light = x * -self.albedo
        if len(self.harmonics) == 1:
            light = product(light, self.harmonics[0])
        else:
            light = np.matmul(light[:, None], self.harmonics)[:, 0]
        return np.concatenate([motion, light], 1)


def read_photos(
    pictures: Sequence[Picture],
    samples: Samples,
    state: State,
    view: Array,
    skin: Sequence[SkinMask] = (),
) -> Readings:
    """Intensities at the samples, and how they change with the geometry.

    Parameters
    ----------
    pictures : sequence of n
    samples : Samples
    state : State
    view : (n, p) array
        Weight by the viewing angle, 0 where a point cannot be seen.
    skin : sequence of n, optional
        What of each photo is skin; by default all of it.
    """
    model, cameras = state.model, state.cameras
    n = len(cameras)
    view = view.copy()
    geometry = samples.geometry(state.surface, state.expressions)
    X = np.broadcast_to(geometry.points, (n, *geometry.points.shape[1:]))
    direction = samples.T[0] @ model.directions
    values, along = np.zeros_like(view), np.zeros_like(view)
    by_motion = np.zeros((n, state.motions, view.shape[1]))
    expressions = samples.expressions[0]
    for i, (picture, camera) in enumerate(zip(pictures, cameras, strict=True)):
        pixels, J, C = camera.jacobians(X[i])
        v, g, inside = picture.read(pixels)
        view[i] *= inside
        if skin:
            view[i] *= skin[i].read(pixels)
        visible = view[i] > 0
        scale = np.median(v[visible, 0]) if visible.any() else 1.0
        scale = max(float(scale), 1e-3)
        values[i], g = v[:, 0] / scale, g[:, 0] / scale
        by_point = np.einsum("px,pxa->pa", g, J)
        by_motion[i, :PARAMETERS] = np.einsum("px,pxa->ap", g, C)
        by_motion[i, PARAMETERS:] = np.einsum("pa,epa->ep", by_point, expressions)
        along[i] = (by_point * direction).sum(1)
    Y = np.stack([samples.transfer.basis(N) for N in geometry.normals])
    return Readings(geometry, Y, view, values, by_motion, along)


def linearise(
    seen: Readings, shading: Shading, samples: Samples, independence: float | Array
) -> Linearisation:
    """Derivatives of all residuals.

    Parameters
    ----------
    seen : Readings
    shading : Shading
    samples : Samples
    independence : float or (n, 1) array
        Share of the samples that count as independent, of all photos or of each.
    """
    geometry, albedo, lights = seen.geometry, shading.albedo, shading.lights
    n = len(lights)
    c = np.empty((3, *seen.values.shape))
    c[0] = seen.by_displacement
    s = np.empty_like(seen.values)
    _, E_u, E_v = samples.expressions
    by_motion = seen.by_motion.copy() if len(E_u) else seen.by_motion
    for k, N in enumerate(geometry.normals):
        which = list(range(n)) if len(geometry.normals) == 1 else [k]
        turn = samples.transfer.slopes(N, lights[which])
        for t, i in zip(turn, which, strict=True):
            c[1, i] = albedo * (t * geometry.g_u[k]).sum(1)
            c[2, i] = albedo * (t * geometry.g_v[k]).sum(1)
            if len(E_u):
                # The normal turns with what an expression moves along it.
                turned = c[1, i] * (E_u * N).sum(2) + c[2, i] * (E_v * N).sum(2)
                by_motion[i, PARAMETERS:] += turned
            s[i] = seen.harmonics[k] @ lights[i]
    return Linearisation(
        samples,
        shading.residual,
        independence / shading.noise**2 * shading.weights,
        c,
        by_motion,
        seen.harmonics,
        albedo,
        s,
        shading.albedo_precision,
    )
