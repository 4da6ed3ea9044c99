"""Photos and landmarks that tell too little: a face is made, or a sentence is said."""

import logging
from dataclasses import replace

import hypothesis
import numpy as np
import pytest
from bsface import ReconstructionError, reconstruct
from drawn_person import MOTION, QUICK, draw, encoded, linear, plausible
from hypothesis import strategies as st


@pytest.mark.parametrize(("count", "words"), [(1, "one photo"), (2, "Only 2 photos")])
def test_one_or_two_photos(drawn, count, words):
    photos, marks = drawn
    assert words in plausible(reconstruct(photos[:count], QUICK, landmarks=marks))


def test_warnings_are_logged_too(drawn, caplog):
    photos, marks = drawn
    with caplog.at_level(logging.WARNING, "bsface"):
        found = reconstruct(photos[:1], MOTION, landmarks=marks)
    assert [record.getMessage() for record in caplog.records] == list(found.warnings)


def test_same_light_everywhere(drawn):
    """One photo with five different exposures and noises: no second view or light."""
    photos, marks = drawn
    rng = np.random.default_rng(0)
    same = [encoded(f * linear(photos[2]) + rng.normal(0, 1e-4)) for f in (1, 0.9, 0.8)]
    given = {
        f"picture {k + 1}": replace(marks["picture 3"], photo=f"picture {k + 1}")
        for k in range(3)
    }
    said = plausible(reconstruct(same, QUICK, landmarks=given))
    assert "light hardly differs" in said
    assert "No photo shows the head turned to the left" in said
    assert "No photo shows the head turned to the right" in said


def test_all_frontal(truth):
    """No photo shows a side: the face is plausible, and both gaps are told."""
    photos, marks = draw(truth, 9)
    middle = {
        f"picture {k + 1}": replace(marks["picture 5"], photo=f"picture {k + 1}")
        for k in range(4)
    }
    rng = np.random.default_rng(0)
    noisy = [encoded(linear(photos[4]) + rng.normal(0, 1e-3)) for _ in range(4)]
    said = plausible(reconstruct(noisy, QUICK, landmarks=middle))
    assert "turned to the left" in said and "turned to the right" in said


def test_grey_faces_without_any_shading(drawn):
    """Flat pictures: landmarks are all there is."""
    photos, marks = drawn
    flat = [np.full_like(p, 30000) for p in photos]
    for k, p in enumerate(flat):  # sharp enough, and no two alike
        p[:: 7 + k, ::3] = 26000
    plausible(reconstruct(flat, QUICK, landmarks=marks))


def test_one_side_only(truth):
    """The unseen cheek is a guess, and its confidence says so."""
    photos, marks = draw(truth, 9)
    keep = slice(5, 9)  # yaw 7 to 28: turned to the right, so its right cheek hides
    given = {
        f"picture {k + 1}": replace(marks[f"picture {k + 6}"], photo=f"picture {k + 1}")
        for k in range(4)
    }
    found = reconstruct(photos[keep], QUICK, landmarks=given)
    assert "No photo shows the head turned to the left" in plausible(found)
    left, right = (
        found.deviation[9:13, 4:11].mean(),
        found.deviation[1:5, 4:11].mean(),
    )
    assert max(left, right) > 1.1 * min(left, right)


@pytest.mark.parametrize(
    "known",
    [[], [30, 31, 32, 33], [27, 28, 29, 30, 33, 51, 57]],
    ids=["none", "four", "the middle line"],
)
def test_landmarks_that_leave_the_pose_open_cost_only_their_photo(drawn, known):
    photos, marks = drawn
    weight = np.zeros(68)
    weight[known] = 1
    some = {**marks, "picture 2": replace(marks["picture 2"], weight=weight)}
    found = reconstruct(photos[:4], MOTION, landmarks=some)
    plausible(found)
    assert found.reports[1].status in ("implausible", "small_face")
    assert [row.status for row in found.reports].count("used") == 3


@hypothesis.given(seed=st.integers(0, 2**32 - 1))
@hypothesis.settings(
    max_examples=15,
    deadline=None,
    suppress_health_check=[hypothesis.HealthCheck.function_scoped_fixture],
)
def test_any_landmarks_end_in_a_finite_face_or_a_sentence(drawn, seed):
    """Noise of any size, any affine distortion, any weights, in some of the photos."""
    photos, marks = drawn
    rng = np.random.default_rng(seed)
    given = {}
    for name, item in list(marks.items())[:3]:
        points = item.points
        if rng.random() < 0.7:
            bend = np.eye(2) + rng.normal(0, rng.choice([0.05, 0.5]), (2, 2))
            points = (points - 100) @ bend + 100 + rng.normal(0, 20, 2)
            points = points + rng.normal(0, rng.choice([0.5, 3, 30]), points.shape)
        weight = rng.random(68) * (rng.random(68) < rng.choice([0.1, 0.6, 1]))
        given[name] = replace(item, points=points, weight=weight)
    try:
        found = reconstruct(photos[:3], MOTION, landmarks=given)
    except ReconstructionError as error:
        assert "None of the 3 photos can" in str(error)
    else:
        assert np.isfinite(found.surface.control_points).all()
        assert np.abs(found.surface.control_points).max() < 400


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e12, -1e12, 0.0])
def test_landmarks_that_are_no_numbers_cost_only_their_photo(drawn, value):
    photos, marks = drawn
    bad = marks["picture 2"].points.copy()
    bad[:40] = value
    some = {**marks, "picture 2": replace(marks["picture 2"], points=bad)}
    found = reconstruct(photos[:4], MOTION, landmarks=some)
    plausible(found)
    assert found.reports[1].status == "implausible"
