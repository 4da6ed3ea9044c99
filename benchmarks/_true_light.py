"""Light and albedo held at what they are on the true face.

The renderer's lamps and skin are not the model's harmonics and albedo.  What stands in
for their truth is what the model makes of the photos when surface and cameras are the
true ones: the light that explains them best, and the albedo that goes with it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from unittest import mock

import numpy as np
from _truth import Truth, hold_photos
from bsface.camera.camera import PARAMETERS, Camera
from bsface.images.photo import Photo
from bsface.photometry.lighting import (
    estimate_lighting,
    robust_weights,
    solve_albedo,
    solve_lights,
)
from bsface.photometry.sampling import smooth_photo, view_weights
from bsface.photometry.transfer import radiance_transfer
from bsface.solve.joint import refine as joint_stage
from bsface.solve.joint.system import read_photos
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Alternations of light and albedo on the true face, and in each step.
ROUNDS, ALTERNATIONS = 20, 6


@dataclass(frozen=True)
class Shading:
    """The model's light and albedo on the true face.

    Attributes
    ----------
    lights : (n, k) array
    albedo : (p,) array
    """

    lights: Array
    albedo: Array


def shading_on(
    truth: Truth,
    cameras: Sequence[Camera],
    photos: Sequence[Photo],
    uv: Array,
    blur_mm: float,
    degree: int,
    options: joint_stage.JointOptions,
) -> Shading:
    """Light and albedo under the true geometry, as the joint stage estimates them.

    Parameters
    ----------
    truth : Truth
    cameras, photos : sequences of n
        The cameras in the template's frame.
    uv : (p, 2) array
        Sample points of a level.
    blur_mm, degree : float, int
        Of the level.
    options : JointOptions
    """
    points, normals = truth.surface.evaluate(*uv.T), truth.surface.normals(*uv.T)
    view = view_weights(truth.surface, cameras, uv, options.grazing)
    fields = [
        smooth_photo(photo, camera, blur_mm)
        for photo, camera in zip(photos, cameras, strict=True)
    ]
    X = np.broadcast_to(points, (len(photos), *points.shape))
    values = read_photos(fields, cameras, X, normals, view)[0]
    Y = radiance_transfer(truth.surface, uv, degree, options.shadows).basis(normals)
    lights, albedo, _, _ = estimate_lighting(
        values, view, Y, np.zeros((len(photos), Y.shape[1])), np.ones(len(uv)),
        options.noise, rounds=ROUNDS, ridge=options.light_ridge,
    )  # fmt: skip
    return Shading(lights, albedo)


@contextmanager
def shading_held(
    truth: Truth,
    cameras: Sequence[Camera],
    photos: Sequence[Photo],
    options: joint_stage.JointOptions,
    lights: bool,
    albedo: bool,
) -> Iterator[None]:
    """The joint stage with true lights, true albedo or both.

    A photo's intensities are relative to its median over the points that it sees, which
    the estimated geometry changes a little: held lights keep a factor for each photo.
    """
    take = joint_stage.sample_surface
    equations = joint_stage.normal_equations
    priors = joint_stage._add_photo_priors
    known: list[Shading] = []
    blur = {level.grid: level.blur_mm for level in options.levels}

    def note(template, reference, surface, grid, own, degree, shadows):
        at = take(template, reference, surface, grid, own, degree, shadows)
        found = shading_on(truth, cameras, photos, at.uv, blur[grid], degree, options)
        known[:] = [found]
        return at

    def estimate(values, view, Y, start, rho, noise, *, ridge):
        true = known[0]
        first = bool((rho == 1).all())
        found = true.lights if lights or not start.any() else start
        rho = true.albedo if albedo or first else rho
        Y = np.broadcast_to(Y, (len(values), *Y.shape[-2:]))
        s = np.einsum("ik,ipk->ip", found, Y)
        for _ in range(ALTERNATIONS):
            W = robust_weights(view, values - rho * s, noise)
            if lights:
                model = rho * s
                top, down = (W * model * values).sum(1), (W * model**2).sum(1)
                found = found * (top / np.maximum(down, 1e-9))[:, None]
            else:
                found = solve_lights(values, W, Y, rho, ridge)
            s = np.einsum("ik,ipk->ip", found, Y)
            if not albedo:
                rho = solve_albedo(values, W, s)
        r = values - rho * s
        return found, rho, robust_weights(view, r, noise), r

    def unprojected(T, c, h, s, W, r):
        # an albedo that is known takes nothing up
        return equations(T, c, h, 0 * s if albedo else s, W, r)

    def hold(blocks, at, options) -> None:
        priors(blocks, at, options)
        if lights:
            hold_photos(blocks.H, len(at), slice(PARAMETERS, None))

    with (
        mock.patch.object(joint_stage, "take_samples", note),
        mock.patch.object(joint_stage, "estimate_lighting", estimate),
        mock.patch.object(joint_stage, "normal_equations", unprojected),
        mock.patch.object(joint_stage, "_add_photo_priors", hold),
    ):
        yield
