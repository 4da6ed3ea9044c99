"""The error budget's held light and albedo: they stay what they were on the face."""

import importlib
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from bsface.camera.camera import Camera
from bsface.landmarks.observations import LandmarkObservations
from bsface.problem import FaceEstimate, PhotoCollection, Problem
from bsface.progress import never_cancelled
from bsface.settings import Settings
from bsface.solve.joint.options import JointOptions, Level
from bsface.solve.joint.refine import JointParts, Refinement, refine
from bsface.solve.joint.state import DisplacementModel, State
from bsface.solve.joint.terms import default_terms
from bsface.surface.prior import shape_prior
from bsface.surface.template import load_template
from scipy.spatial.transform import Rotation

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "benchmarks"))

_true_light = importlib.import_module("_true_light")
_truth = importlib.import_module("_truth")

NET = (12, 13)
LEVELS = (Level(3.0, 1, 14, 2), Level(2.0, 1, 16, 2))


@dataclass(frozen=True)
class Ramp:
    """A picture that is brighter to one side, with waves on it."""

    slope: np.ndarray

    def read(self, xy):
        wave = 0.1 * np.sin(xy[:, :1] / 11)
        value = 0.7 + xy @ self.slope[:, None] + wave
        gradient = np.broadcast_to(self.slope, (len(xy), 1, 2)).copy()
        gradient[:, 0, 0] += 0.1 / 11 * np.cos(xy[:, 0] / 11)
        return value, gradient, np.ones(len(xy), bool)

    def around(self, xy, margin):
        return self


@pytest.fixture(scope="module")
def known():
    """Three ramps seen by cameras that stand for the truth, as does the template."""
    template = load_template().resampled(NET)
    prior = shape_prior(template, 1.0, 0.7, 1.5, 0.12)
    turns = [Rotation.from_euler("y", a, degrees=True) for a in (-25, 0, 25)]
    cameras = [Camera(R.as_matrix(), 1.5, (3, 4), 1 / 900, (0, 0)) for R in turns]
    pictures = [Ramp(np.array(s) * 1e-3) for s in ((1, 0.3), (0.2, -1), (-0.8, 0.4))]
    index = np.flatnonzero(template.landmark_reliable)[::20]
    uv = template.landmark_uv[index]
    points = template.surface.evaluate(*uv.T)
    seen = LandmarkObservations(
        np.stack([c.project(points) for c in cameras]),
        np.ones((3, len(uv))),
        index,
        uv,
        np.zeros((3, 2)),
    )
    problem = Problem(PhotoCollection((0, 1, 2), ()), template, prior, seen, Settings())
    estimate = FaceEstimate(
        template.surface,
        tuple(cameras),
        points,
        np.zeros((3, 1)),
        np.zeros(len(prior.modes)),
        np.zeros((len(template.surface.vector), 3)),
        np.ones(3),
    )
    same = (1.0, np.eye(3), np.zeros(3))
    truth = _truth.Truth(template.surface, np.zeros(0), np.zeros(0), same)
    return problem, estimate, truth, lambda photo, camera, blur_mm: pictures[photo]


def last_iteration(known, lights, albedo):
    """The last joint step, and the light and albedo that were held at its level."""
    problem, estimate, truth, reader = known
    options = JointOptions(LEVELS, shadows=False)
    held = _true_light.HeldShading(
        truth, estimate.cameras, problem.photos, options, lights, albedo, reader
    )
    model = DisplacementModel.about(problem, estimate)
    terms = [*default_terms(problem, estimate, model, options), *held.terms]
    work = Refinement(
        problem.photos,
        np.ones(3),
        options,
        terms,
        JointParts(reader=reader, shading=held),
    )
    *_, last = refine(State.start(model, estimate.cameras), work, never_cancelled)
    return last, held.known[LEVELS[-1]]


def test_held_lights_keep_their_direction(known):
    last, true = last_iteration(known, lights=True, albedo=False)
    lights = last.state.lights
    factor = (lights * true.lights).sum(1) / (true.lights**2).sum(1)
    np.testing.assert_allclose(lights, factor[:, None] * true.lights, atol=1e-6)
    assert np.abs(factor - 1).max() < 0.5
    assert not np.allclose(last.state.albedo, true.albedo, rtol=1e-3)
    assert last.step_mm > 1e-3


def test_held_albedo_stays(known):
    last, true = last_iteration(known, lights=False, albedo=True)
    np.testing.assert_array_equal(last.state.albedo, true.albedo)
    lights = last.state.lights
    factor = (lights * true.lights).sum(1) / (true.lights**2).sum(1)
    assert not np.allclose(lights, factor[:, None] * true.lights, atol=1e-3)
    assert last.step_mm > 1e-3
