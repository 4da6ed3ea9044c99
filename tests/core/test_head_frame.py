"""The frame of results: eyes on the x axis, the wanted size, the template's pitch."""

import numpy as np
import pytest
from bsface.surface.alignment import eye_centres, fit_similarity, head_frame
from bsface.surface.bspline import BSplineSurface
from bsface.surface.template import load_template
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def template():
    return load_template()


def similarity(seed, largest_turn=1.0):
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    turn = largest_turn * rng.random() * axis / np.linalg.norm(axis)
    R = Rotation.from_rotvec(turn).as_matrix()
    return float(rng.uniform(0.2, 5)), R, rng.normal(0, 100, 3)


def person(template, seed):
    """A face that is not the template: a draw of its modes."""
    k = np.random.default_rng(seed).normal(size=len(template.identity_modes))
    b = template.surface.control_points + np.tensordot(k, template.identity_modes, 1)
    return BSplineSurface(b)


@given(seed=seeds)
def test_similarity_of_moved_points_is_the_move(seed):
    rng = np.random.default_rng(seed)
    x, w = rng.normal(0, 50, (9, 3)), rng.random(9) + 0.1
    scale, R, t = similarity(seed, np.pi)
    found = fit_similarity(x, scale * x @ R.T + t, w)
    assert found.scale == pytest.approx(scale)
    np.testing.assert_allclose(found.R, R, atol=1e-9)
    np.testing.assert_allclose(found(x), scale * x @ R.T + t, atol=1e-8)


@given(seed=seeds)
@settings(max_examples=20)
def test_similarity_is_the_least_squares_one(seed):
    """No small change of it brings noisy points nearer; mirroring is not allowed."""
    rng = np.random.default_rng(seed)
    x, y, w = rng.normal(size=(7, 3)), rng.normal(size=(7, 3)), rng.random(7) + 0.1
    best = fit_similarity(x, y, w)
    assert np.linalg.det(best.R) == pytest.approx(1)

    def cost(scale, R, t):
        return w @ ((scale * x @ R.T + t - y) ** 2).sum(1)

    least = cost(best.scale, best.R, best.t)
    for _ in range(20):
        turn = Rotation.from_rotvec(rng.normal(0, 1e-2, 3)).as_matrix()
        grown = best.scale * np.exp(rng.normal(0, 1e-2))
        shifted = best.t + rng.normal(0, 1e-2, 3)
        assert cost(grown, turn @ best.R, shifted) >= least - 1e-12


def test_weight_zero_leaves_a_point_out():
    x = np.random.default_rng(0).normal(size=(8, 3))
    y = 2 * x + 1
    y[3] = 1e6
    w = np.ones(8)
    w[3] = 0
    found = fit_similarity(x, y, w)
    assert found.scale == pytest.approx(2)
    np.testing.assert_allclose(found.R, np.eye(3), atol=1e-12)


def test_template_has_its_own_eyes(template):
    np.testing.assert_allclose(
        eye_centres(template.surface, template), template.eye_centres, atol=1e-9
    )


@given(seed=seeds)
@settings(max_examples=10)
def test_eyes_move_with_the_face(template, seed):
    face = person(template, seed)
    scale, R, t = similarity(seed, np.pi)
    expected = scale * eye_centres(face, template) @ R.T + t
    moved = eye_centres(face.transformed(scale, R, t), template)
    np.testing.assert_allclose(moved, expected, atol=1e-6 * scale)


@pytest.mark.parametrize("size", [62.0, 50.0])
@given(seed=seeds)
@settings(max_examples=10)
def test_frame_of_results(template, size, seed):
    face = person(template, seed).transformed(*similarity(seed))
    move = head_frame(face, template, size)
    np.testing.assert_allclose(move.R @ move.R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(move.R) == pytest.approx(1)
    right, left = eye_centres(face.transformed(move.scale, move.R, move.t), template)
    np.testing.assert_allclose(right, [-size / 2, 0, 0], atol=1e-6)
    np.testing.assert_allclose(left, [size / 2, 0, 0], atol=1e-6)


@given(seed=seeds)
@settings(max_examples=10)
def test_result_does_not_depend_on_where_the_face_stood(template, seed):
    face = person(template, seed)
    moved = face.transformed(*similarity(seed, np.pi * 0.9))
    one, two = (head_frame(f, template, 62) for f in (face, moved))
    np.testing.assert_allclose(
        two(moved.control_points), one(face.control_points), atol=1e-6
    )


def test_frame_of_the_template_only_scales(template):
    move = head_frame(template.surface, template, 62)
    np.testing.assert_allclose(move.R, np.eye(3), atol=1e-3)
    np.testing.assert_allclose(move.t, 0, atol=1e-2)
    assert move.scale == pytest.approx(62 / template.eye_distance)
