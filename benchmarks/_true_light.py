"""Light and albedo held at what they are on the true face.

The renderer's lamps and skin are not the model's harmonics and albedo.  What stands in
for their truth is what the model makes of the photos when surface and cameras are the
true ones: the light that explains them best, and the albedo that goes with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from _parts import HELD
from _truth import Truth
from bsface.camera.camera import Camera
from bsface.images.photo import Photo
from bsface.photometry.lighting import (
    estimate_lighting,
    photo_noise,
    robust_weights,
    shading_of,
    solve_albedo,
    solve_lights,
)
from bsface.photometry.sampling import smooth_photo, view_weights
from bsface.photometry.transfer import radiance_transfer
from bsface.solve.joint.linearise import PictureReader, Readings, Shading
from bsface.solve.joint.options import JointOptions, Level
from bsface.solve.joint.samples import Samples
from bsface.solve.joint.state import State
from bsface.solve.joint.system import Term
from bsface.solve.joint.terms import LightDamping
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Alternations of light and albedo on the true face, and in each step.
ROUNDS, ALTERNATIONS = 20, 6
#: Precision of an albedo that is known.
KNOWN = 1e12


@dataclass(frozen=True)
class TrueShading:
    """The model's light and albedo on the true face.

    Attributes
    ----------
    lights : (n, q) array
    albedo : (p,) array
    """

    lights: Array
    albedo: Array


@dataclass(frozen=True, eq=False)
class HeldShading:
    """Estimates light and albedo for the joint step, with one or both held.

    A photo's intensities are relative to its median over the points that it sees, which
    the estimated geometry changes a little: held lights keep a factor for each photo.

    Attributes
    ----------
    truth : Truth
    cameras, photos : sequences of n
        The true cameras, in the template's frame.
    options : JointOptions
    lights, albedo : bool
        What is held.
    reader : callable
        Smooths a photo.
    """

    truth: Truth
    cameras: Sequence[Camera]
    photos: Sequence[Photo]
    options: JointOptions
    lights: bool
    albedo: bool
    reader: PictureReader = smooth_photo
    known: dict[Level, TrueShading] = field(default_factory=dict)

    @property
    def terms(self) -> list[Term]:
        """What has to be added to the joint system."""
        return [LightDamping(HELD)] if self.lights else []

    def shading_on(self, uv: Array, level: Level) -> TrueShading:
        """Light and albedo under the true geometry, as the joint step estimates them.

        Parameters
        ----------
        uv : (p, 2) array
            Sample points of the level.
        level : Level
        """
        face, options = self.truth.surface, self.options
        points, normals = face.evaluate(*uv.T), face.normals(*uv.T)
        view = view_weights(face, self.cameras, uv, options.grazing)
        values = np.zeros_like(view)
        for i, (photo, camera) in enumerate(
            zip(self.photos, self.cameras, strict=True)
        ):
            picture = self.reader(photo, camera, level.blur_mm)
            value, _, inside = picture.read(camera.project(points))
            view[i] *= inside
            seen = view[i] > 0
            scale = np.median(value[seen, 0]) if seen.any() else 1.0
            values[i] = value[:, 0] / max(float(scale), 1e-3)
        transfer = radiance_transfer(face, uv, level.degree, options.shadows)
        Y = transfer.basis(normals)
        lights, albedo, _, _ = estimate_lighting(
            values, view, Y, np.zeros((len(view), Y.shape[1])), np.ones(len(uv)),
            noise=options.noise, rounds=ROUNDS, ridge=options.light_ridge,
        )  # fmt: skip
        return TrueShading(lights, albedo)

    def __call__(self, seen: Readings, samples: Samples, state: State, /) -> Shading:
        """See `ShadingSolver`."""
        level, options = samples.level, self.options
        if level not in self.known:
            self.known[level] = self.shading_on(samples.uv, level)
        true, values = self.known[level], seen.values
        view = seen.view * samples.area
        Y = seen.harmonics
        first = not state.lights.any()
        found = true.lights if self.lights or first else state.lights
        albedo = state.albedo
        if self.albedo or bool((albedo == 1).all()):
            albedo = true.albedo
        s = shading_of(found, Y)
        for _ in range(ALTERNATIONS):
            W = robust_weights(view, values - albedo * s, options.noise)
            if self.lights:
                model = albedo * s
                top, down = (W * model * values).sum(1), (W * model**2).sum(1)
                found = found * (top / np.maximum(down, 1e-9))[:, None]
            else:
                found = solve_lights(values, W, Y, albedo, options.light_ridge)
            s = shading_of(found, Y)
            if not self.albedo:
                albedo = solve_albedo(values, W, s)
        r = values - albedo * s
        noise = photo_noise(view, r, options.noise)
        weights = robust_weights(view, r, noise)
        known = KNOWN if self.albedo else 0.0
        return Shading(found, albedo, weights, r, noise, known)
