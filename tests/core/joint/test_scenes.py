"""Whole refinements of made-up scenes: where the surface ends is known."""

from dataclasses import dataclass

import numpy as np
import pytest
from bsface.camera.camera import Camera
from bsface.photometry.lighting import NOISE_RANGE
from bsface.problem import Constraint
from bsface.solve.joint.options import JointOptions, Level
from bsface.solve.joint.samples import sample_grid
from bsface.surface.bspline import BSplineSurface
from bsface.surface.prior import shape_prior
from domes import Formula, PictureOfADome, bumped, dome, relief
from joint_waves import (
    PHOTOS,
    SHAPE,
    Wave,
    cameras,
    directions,
    iterations,
    plane,
    start,
    wave,
)


@dataclass(frozen=True)
class PictureOfAPlane(Formula):
    """What a camera sees of a textured plane under one light."""

    camera: Camera
    texture: Wave
    shading: float

    def value(self, xy):
        # the ray through a pixel meets z = 5: three linear equations
        c = self.camera
        x, y = (xy - c.principal).T[:, :, None]
        rows = np.stack(
            [
                c.s * c.R[0] + x * c.kappa * c.R[2],
                -c.s * c.R[1] + y * c.kappa * c.R[2],
                np.broadcast_to((0.0, 0, 1), (len(xy), 3)),
            ],
            1,
        )
        right = np.concatenate([x - c.t[0], y - c.t[1], np.full_like(x, 5)], 1)
        at = np.linalg.solve(rows, right[..., None])[:, :2, 0]
        return self.texture.value(at) * self.shading


def textured_plane():
    """Five views of a pattern: it tells by its shift between the photos."""
    views = cameras(5, spread=40)
    rng = np.random.default_rng(3)
    pattern = Wave(rng.normal(0, 0.25, (6, 2)), rng.uniform(0, 6, 6))
    pictures = [PictureOfAPlane(c, pattern, 0.4 + 0.2 * i) for i, c in enumerate(views)]
    return plane(), views, pictures


def shaded_dome():
    """One view under ten lights, no texture: it tells by its shading."""
    rng = np.random.default_rng(4)
    views = [Camera(np.eye(3), 1.5, (0, 0), 0.0, (200, 200))] * 10
    pictures = []
    for c in views:
        light = np.zeros(9)
        light[0], light[1:4] = 0.8, rng.normal(0, 0.25, 3) + (0, 0, 0.3)
        pictures.append(PictureOfADome(c, light))
    return dome(), views, pictures


@pytest.mark.parametrize("scene", [textured_plane, shaded_dome])
def test_surface_comes_back(template, scene):
    """The truth stays, and from a wrong surface the way leads back to it."""
    truth, views, pictures = scene()
    options = JointOptions(
        (Level(3.0, 8, 16, 6),),
        landmark_weight=0.0,
        noise=0.03 / NOISE_RANGE[0],  # of perfect pictures: 0.03
        independence=1.0,
        shadows=False,
    )
    # a prior that allows for the bump
    prior = shape_prior(template, 0.0, 0.0, 30.0, 0.1)
    uv = sample_grid(template, 16)
    *_, last = iterations(*start(template, prior, truth, views), pictures, options)
    assert relief(last.state.surface, truth, uv) < 0.3
    begin = bumped(truth, 8.0)
    found = list(iterations(*start(template, prior, begin, views), pictures, options))
    before = relief(begin, truth, uv)
    assert before > 0.4
    assert relief(found[-1].state.surface, truth, uv) < 0.35 * before
    assert found[-1].residual < 0.5 * found[0].residual


def test_held_points_go_where_the_template_has_them(template, prior):
    """The start lies beside it and the prior thinks it right."""
    views, pictures = cameras(), [wave(k) for k in range(PHOTOS)]
    options = JointOptions((Level(3.0, 2, 10, 6),), landmark_weight=0.0)
    truth = template.surface
    normals = directions(truth).reshape(*SHAPE, 3)
    begin = BSplineSurface(truth.control_points + 3.0 * normals)

    def result(constraint):
        problem = start(template, prior, begin, views, 0.0, constraint)
        *_, last = iterations(*problem, pictures, options)
        away = last.state.surface.control_points - truth.control_points
        return (away * normals).sum(2), last.system.deviation().reshape(SHAPE)

    one = np.zeros(SHAPE, bool)
    one[3, 4] = True
    away, deviation = result(None)
    hard_away, hard = result(Constraint(one))
    soft_away, soft = result(Constraint(one, 1.0))
    assert abs(away[3, 4]) > 0.5
    assert abs(hard_away[3, 4]) < 0.02
    assert abs(soft_away[3, 4]) < abs(away[3, 4])
    # What is held is known.
    assert hard[3, 4] < 2e-3
    assert soft[3, 4] < min(1.0, deviation[3, 4])
