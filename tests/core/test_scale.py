"""True size from a known length: exact on drawn cameras, with an honest uncertainty."""

from dataclasses import replace

import numpy as np
import pytest
from bsface.camera.camera import Camera
from bsface.drawing.render import yaw_rotation
from bsface.errors import ReconstructionError
from bsface.result import no_photo
from bsface.scale import (
    IRIS_MM,
    TrueSize,
    size_from_eye_distance,
    size_from_iris,
    size_from_points,
)
from bsface.surface.alignment import eye_centres, eye_distance
from bsface.surface.template import load_template
from fake_face import bare_reconstruction
from hypothesis import given, settings
from hypothesis import strategies as st


def photographed(yaw=12.0, scale=4.0):
    template = load_template()
    camera = Camera(yaw_rotation(yaw), scale, np.array([3.0, -5.0]), 1 / 900,
                    np.array([400.0, 420.0]))  # fmt: skip
    return replace(
        bare_reconstruction(),
        surface=template.surface,
        template=template,
        photos=(no_photo("a.jpg", (800, 840)),),
        cameras=(camera,),
    )


@given(st.floats(40, 90))
@settings(max_examples=3, deadline=None)
def test_measured_eye_distance_is_met(measured):
    face = photographed()
    size = size_from_eye_distance(face, measured, 0.5)
    made = size.apply(face)
    assert eye_distance(made.surface, made.template) == pytest.approx(measured)
    assert made.settings.eye_distance_mm == pytest.approx(measured)
    assert size.percent == pytest.approx(100 * 0.5 / measured)


def test_photos_look_the_same_after_scaling():
    face = photographed()
    made = size_from_eye_distance(face, 70.0).apply(face)
    uv = np.random.default_rng(0).uniform(size=(40, 2)).T
    before = face.cameras[0].project(face.surface.evaluate(*uv))
    after = made.cameras[0].project(made.surface.evaluate(*uv))
    np.testing.assert_allclose(after, before, atol=1e-9)


@pytest.mark.parametrize("yaw", [-40.0, 0.0, 25.0])
@pytest.mark.parametrize("pair", [(61, 291), (10, 152), (33, 263)])
def test_two_clicked_points_give_the_size(yaw, pair):
    face = photographed(yaw)
    ends = face.surface.evaluate(*face.template.landmark_uv[list(pair)].T)
    pixels = face.cameras[0].project(ends)
    own = np.linalg.norm(ends[1] - ends[0])
    size = size_from_points(face, "a.jpg", pixels, 1.1 * own)
    assert size.factor == pytest.approx(1.1, rel=1e-3)
    sharper = size_from_points(face, "a.jpg", pixels, 1.1 * own, click_px=0.2)
    assert 0 < sharper.uncertainty < size.uncertainty < 0.1


def test_uncertainty_of_clicks_is_that_of_repeated_clicks():
    face = photographed(10.0)
    ends = face.surface.evaluate(*face.template.landmark_uv[[61, 291]].T)
    pixels = face.cameras[0].project(ends)
    rng = np.random.default_rng(4)
    found = [
        size_from_points(
            face, "a.jpg", pixels + rng.normal(0, 1.0, (2, 2)), 50.0, sigma_mm=0.0
        )
        for _ in range(24)
    ]
    spread = np.std([f.factor for f in found])
    stated = np.mean([f.uncertainty for f in found])
    # The standard deviation of 24 draws is itself known to about 15 %.
    assert 0.55 < spread / stated < 1.5


@pytest.mark.parametrize("eye", [0, 1])
def test_iris_gives_the_size_within_its_uncertainty(eye):
    face = photographed(0.0)
    camera = face.cameras[0]
    centre = eye_centres(face.surface, face.template)[eye]
    true_width = IRIS_MM / 1.05
    edges = camera.project(centre + np.array([[-0.5, 0, 0], [0.5, 0, 0]]) * true_width)
    size = size_from_iris(face, "a.jpg", edges)
    assert size.factor == pytest.approx(1.05, rel=5e-3)
    assert 0.5 / 11.7 < size.uncertainty / size.factor < 0.08
    with pytest.raises(ReconstructionError, match="no edges of an iris"):
        size_from_iris(face, "a.jpg", edges + [[0, 0], [200, 0]])


def test_unusable_measurements_are_refused():
    face = photographed()
    with pytest.raises(ReconstructionError, match="length in millimetres"):
        size_from_eye_distance(face, -3.0)
    with pytest.raises(ReconstructionError, match="length in millimetres"):
        size_from_eye_distance(face, 60.0, 80.0)
    with pytest.raises(ReconstructionError, match="b.jpg: .* not used"):
        size_from_points(face, "b.jpg", [[0, 0], [9, 9]], 10.0)
    with pytest.raises(ReconstructionError, match="not on the face"):
        size_from_points(face, "a.jpg", [[400, 420], [5, 5]], 10.0)
    with pytest.raises(ReconstructionError, match="two places"):
        size_from_points(face, "a.jpg", [[400, 420], [400, 420]], 10.0)


@pytest.mark.parametrize(
    "measured", [True, "63", np.array([63.0, 64.0]), None, np.nan, 0.5, -3]
)
def test_an_eye_distance_is_one_length(measured):
    with pytest.raises((TypeError, ReconstructionError), match=r"must .*\.$"):
        size_from_eye_distance(photographed(), measured, 0.1)


@pytest.mark.parametrize("factor, sigma", [(0, 0.1), (-1, 0), (np.nan, 0), (1, -1)])
def test_a_size_is_positive(factor, sigma):
    with pytest.raises(ValueError, match="factor must be positive"):
        TrueSize(factor, sigma)


@pytest.mark.parametrize(
    "pixels, click, words",
    [
        (np.ones((2, 2)), np.nan, "click_px must be"),
        (np.ones((2, 2)), -1, "click_px must be"),
        (np.ones((2, 2)), "1", "click_px must be"),
        (np.ones(4), 1.0, "must be two finite points"),
        (np.ones((3, 2)), 1.0, "must be two finite points"),
        (np.full((2, 2), np.nan), 1.0, "must be two finite points"),
    ],
)
def test_clicks_are_two_points(pixels, click, words):
    face = photographed()
    with pytest.raises((TypeError, ValueError), match=words):
        size_from_points(face, face.photos[0].name, pixels, 60.0, click_px=click)
    with pytest.raises((TypeError, ValueError), match=words):
        size_from_iris(face, face.photos[0].name, pixels, click_px=click)
