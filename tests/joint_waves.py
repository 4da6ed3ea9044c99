"""The joint method on photos that are waves: value and gradient are exact anywhere.

The surface is a plane, where the linear model of a displacement along the normals is
exact, or the template, where it is not.
"""

from dataclasses import dataclass

import numpy as np
import reference
from bsface.camera.camera import Camera
from bsface.landmarks.observations import LandmarkObservations
from bsface.problem import FaceEstimate, PhotoCollection, Problem
from bsface.progress import never_cancelled
from bsface.settings import Settings
from bsface.solve.joint.options import JointOptions, Level
from bsface.solve.joint.refine import JointParts, Refinement, refine
from bsface.solve.joint.state import DisplacementModel, State
from bsface.solve.joint.terms import default_terms
from bsface.surface.bspline import BSplineSurface
from scipy.spatial.transform import Rotation

SHAPE = (8, 9)
PHOTOS = 3


@dataclass(frozen=True)
class Wave:
    """A picture given by a formula: a sum of plane waves."""

    k: np.ndarray
    phase: np.ndarray
    size: float = 0.05

    def value(self, xy):
        return 0.6 + self.size * np.sin(xy @ self.k.T + self.phase).sum(1)

    def read(self, xy):
        slope = self.size * np.cos(xy @ self.k.T + self.phase) @ self.k
        return self.value(xy)[:, None], slope[:, None], np.ones(len(xy), bool)

    def around(self, xy, margin):
        return self


def wave(seed):
    rng = np.random.default_rng(seed)
    return Wave(rng.normal(0, 0.03, (4, 2)), rng.uniform(0, 6, 4))


def plane():
    corners = {(0, 0): (-70, 90, 5), (1, 0): (140, 0, 0), (0, 1): (0, -190, 0)}
    return BSplineSurface(reference.polynomial_control_points(SHAPE, corners))


def cameras(count=PHOTOS, spread=25, kappa=1 / 900):
    rng = np.random.default_rng(7)
    out = []
    for _ in range(count):
        angles = rng.uniform(-spread, spread, 3) * (1, 0.6, 0.3)
        R = Rotation.from_euler("yxz", angles, degrees=True).as_matrix()
        out.append(Camera(R, 1.5, rng.normal(0, 9, 2), kappa, (200, 200)))
    return out


def directions(surface):
    """Normals at the Greville abscissae: the ways in which control points move."""
    g = [np.clip((np.arange(c) - 1.0) / (c - 3), 0, 1) for c in surface.shape]
    return surface.normals(*np.meshgrid(*g, indexing="ij")).reshape(-1, 3)


def given(pictures):
    """A reader of photos whose place in the list is their picture."""
    return lambda photo, camera, blur_mm: pictures[photo]


def start(template, prior, surface, views, expression=0.0, constraint=None):
    """A problem, an estimate that stands at ``surface`` and agrees with landmarks."""
    index = np.flatnonzero(template.landmark_reliable)[::20]
    uv = template.landmark_uv[index]
    structure = surface.evaluate(*uv.T)
    pixels = np.stack([c.project(structure) for c in views])
    n = len(views)
    landmarks = LandmarkObservations(
        pixels, np.ones(pixels.shape[:2]), index, uv, np.zeros((n, 2))
    )
    photos = PhotoCollection(tuple(range(n)), ())
    problem = Problem(photos, template, prior, landmarks, Settings(), constraint)
    estimate = FaceEstimate(
        surface=surface,
        cameras=tuple(views),
        landmarks_xyz=structure,
        expressions=expression * np.arange(n)[:, None],
        modes=np.zeros(len(prior.modes)),
        smooth=np.zeros((len(surface.vector), 3)),
        photo_weights=np.ones(n),
    )
    return problem, estimate


def iterations(problem, estimate, pictures, options):
    """The joint method on analytic pictures, with all that its steps were made of."""
    model = DisplacementModel.about(problem, estimate)
    terms = default_terms(problem, estimate, model, options)
    work = Refinement(
        problem.photos,
        estimate.photo_weights,
        options,
        terms,
        JointParts(reader=given(pictures)),
    )
    return refine(State.start(model, estimate.cameras), work, never_cancelled)


def first_step(template, prior, surface, views, pictures, expression=0.0):
    """One iteration on analytic pictures, without landmarks."""
    options = JointOptions(
        (Level(3.0, 1, 14, 6),), landmark_weight=0, max_step_mm=1e9, tolerance=1e-9
    )
    problem, estimate = start(template, prior, surface, views, expression)
    (one,) = iterations(problem, estimate, pictures, options)
    return one


class Residual:
    """``r_ij`` as a function of everything that it depends on, from the definition."""

    def __init__(self, one, surface, pictures):
        self.one, self.surface, self.pictures = one, surface, pictures
        self.views = one.before.cameras
        self.samples = one.rows.samples
        raw = self.photos(surface, self.views)
        self.scale = np.median(raw / one.readings.values, 1, keepdims=True)

    def faces(self, surface, expressions=None):
        before = self.one.before
        expressions = before.expressions if expressions is None else expressions
        modes, b = before.model.expression_modes, surface.control_points
        if not len(modes):
            return [surface] * PHOTOS
        return [BSplineSurface(b + np.tensordot(e, modes, 1)) for e in expressions]

    def photos(self, surface, views, expressions=None):
        faces = self.faces(surface, expressions)
        parts = zip(self.pictures, views, faces, strict=True)
        uv = self.samples.uv
        return np.stack([p.value(c.project(f.evaluate(*uv.T))) for p, c, f in parts])

    def __call__(
        self, surface=None, views=None, lights=None, albedo=None, expressions=None
    ):
        surface = self.surface if surface is None else surface
        lights = self.one.before.lights if lights is None else lights
        albedo = self.one.before.albedo if albedo is None else albedo
        views = self.views if views is None else views
        uv, transfer = self.samples.uv, self.samples.transfer
        shading = np.stack(
            [
                transfer.basis(f.normals(*uv.T)) @ light
                for f, light in zip(
                    self.faces(surface, expressions), lights, strict=True
                )
            ]
        )
        values = self.photos(surface, views, expressions) / self.scale
        return values - albedo * shading
