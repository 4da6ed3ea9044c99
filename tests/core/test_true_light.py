"""The error budget's held light and albedo: they stay what they were on the face."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest
from bsface.prepare import collect_photos
from bsface.reconstruct import observations, solve
from bsface.settings import Settings
from bsface.solve.joint import refine as joint
from bsface.surface.template import load_template

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "benchmarks"))

_true_light = importlib.import_module("_true_light")
_truth = importlib.import_module("_truth")

SETTINGS = Settings(control_points=(12, 13), iterations=1, light_degree=2)
NAMES = ("000.jpg", "011.jpg", "023.jpg")


@pytest.fixture(scope="module")
def known():
    """Three example photos, and some face and cameras that stand for the truth."""
    collection = collect_photos(
        [ROOT / "examples" / "photos" / n for n in NAMES], SETTINGS
    )
    template = load_template().resampled(SETTINGS.control_points)
    seen = observations(collection, template)
    module = sys.modules["bsface.reconstruct"]
    cameras = module._linear_cameras(collection, template, seen, SETTINGS)
    same = (1.0, np.eye(3), np.zeros(3))
    truth = _truth.Truth(template.surface, np.zeros(0), np.zeros(0), same)
    return collection, template, truth, cameras


def last_state(known, monkeypatch, lights, albedo):
    """The joint stage's last state, and the light and albedo that were held."""
    collection, template, truth, cameras = known
    states, held = [], []
    shading_on = _true_light.shading_on
    monkeypatch.setattr(
        _true_light,
        "shading_on",
        lambda *args: held.append(shading_on(*args)) or held[-1],
    )
    module = sys.modules["bsface.reconstruct"]

    def noted(*args, **kwargs):
        for state in joint.refine(*args, **kwargs):
            states.append(state)
            yield state

    monkeypatch.setattr(module, "refine", noted)
    before = dict(vars(joint))
    options = module.joint_options(SETTINGS)
    photos = collection.photos
    with _true_light.shading_held(truth, cameras, photos, options, lights, albedo):
        solve(collection, SETTINGS, template)
    assert all(before[name] is value for name, value in vars(joint).items())
    return states[-1], held[-1]


def test_held_lights_keep_their_direction(known, monkeypatch):
    state, true = last_state(known, monkeypatch, lights=True, albedo=False)
    factor = (state.lights * true.lights).sum(1) / (true.lights**2).sum(1)
    np.testing.assert_allclose(state.lights, factor[:, None] * true.lights, atol=1e-6)
    assert np.abs(factor - 1).max() < 0.5
    assert not np.allclose(state.albedo, true.albedo, rtol=1e-3)


def test_held_albedo_stays(known, monkeypatch):
    state, true = last_state(known, monkeypatch, lights=False, albedo=True)
    np.testing.assert_array_equal(state.albedo, true.albedo)
    factor = (state.lights * true.lights).sum(1) / (true.lights**2).sum(1)
    assert not np.allclose(state.lights, factor[:, None] * true.lights, atol=1e-3)
