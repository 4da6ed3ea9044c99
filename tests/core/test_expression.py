"""Which expression the result has; analytic estimates, no photos."""

import numpy as np
import pytest
from bsface.camera.camera import Camera
from bsface.landmarks.observations import LandmarkObservations
from bsface.problem import FaceEstimate, PhotoCollection, Problem
from bsface.settings import Settings
from bsface.solve.expression import (
    expression_displacements,
    move_to_neutral,
    select_neutral,
)
from bsface.surface.prior import shape_prior
from few_modes import few_modes
from scipy.spatial.transform import Rotation

COUNT, MODES = 12, 3


@pytest.fixture(scope="module")
def template():
    return few_modes((14, 16), identity=2, expression=MODES)


def given(template, expressions, yaw=0.0, scale=0.7):
    """A problem and the template itself as its estimate, with these expressions."""
    prior = shape_prior(template, 1.0, scale, 1.5, 0.2)
    index = np.flatnonzero(template.landmark_reliable)[::5]
    uv = template.landmark_uv[index]
    n = len(expressions)
    landmarks = LandmarkObservations(
        np.zeros((n, len(index), 2)),
        np.ones((n, len(index))),
        index,
        uv,
        np.zeros((n, 2)),
    )
    photos = PhotoCollection(tuple(range(n)), ())
    problem = Problem(photos, template, prior, landmarks, Settings())
    angles = np.broadcast_to(yaw, n)
    cameras = [
        Camera(
            Rotation.from_euler("y", a, degrees=True).as_matrix(),
            1.5,
            np.zeros(2),
            1 / 900,
            (100, 100),
        )
        for a in angles
    ]
    estimate = FaceEstimate(
        surface=template.surface,
        cameras=tuple(cameras),
        landmarks_xyz=template.landmark_xyz[index],
        expressions=np.asarray(expressions, float),
        modes=np.zeros(len(prior.modes)),
        smooth=np.zeros((len(template.surface.vector), 3)),
        photo_weights=np.ones(n),
    )
    return problem, estimate


def mixed():
    """Half of the photos nearly neutral, half with a strong expression."""
    e = np.random.default_rng(0).normal(0, 0.05, (COUNT, MODES))
    e[::2, 0] += 3.0
    return e


def faces(problem, estimate):
    moves = expression_displacements(problem.template, estimate.expressions)
    return estimate.surface.control_points + moves


def test_photos_that_agree_have_no_expressions(template):
    shared = np.tile([3.0, 0.0, 0.0], (COUNT, 1))
    problem, estimate = given(template, shared)
    found = select_neutral(problem, estimate)
    assert not found.expressions.any()
    assert found.surface is estimate.surface


def test_mixed_photos_give_the_neutral_face(template):
    problem, estimate = given(template, mixed())
    found = select_neutral(problem, estimate)
    neutral = estimate.expressions[1::2]
    moved = found.surface.control_points - estimate.surface.control_points
    most = np.abs(expression_displacements(template, neutral)).max()
    assert np.abs(moved).max() <= most
    assert found.photo_weights[::2].max() < 0.3 < 0.9 < found.photo_weights[1::2].min()


def test_faces_of_the_photos_do_not_move_with_the_neutral_face(template):
    problem, estimate = given(template, mixed() + [0.5, 0.2, 0.0])
    found = select_neutral(problem, estimate)
    assert not np.allclose(
        found.surface.control_points, estimate.surface.control_points
    )
    np.testing.assert_allclose(
        faces(problem, found), faces(problem, estimate), atol=1e-9
    )
    again = move_to_neutral(problem, found)
    np.testing.assert_allclose(again.expressions, found.expressions, atol=1e-12)


def test_modes_say_what_the_surface_has_of_an_expression(template):
    problem, estimate = given(template, mixed() + [0.5, 0.2, 0.0])
    found = select_neutral(problem, estimate)
    change = np.einsum("k,kbx->bx", found.modes, problem.prior.modes)
    moved = found.surface.vector - estimate.surface.vector
    np.testing.assert_allclose(moved, change, atol=1e-9)


def test_landmark_noise_of_turned_faces_is_no_expression(template):
    """The same coefficients, with the strong ones seen from the side or the front."""
    e = np.random.default_rng(0).normal(0, 0.05, (COUNT, MODES))
    e[:4, 0] += 3.0
    yaw = np.where(np.arange(COUNT) < 4, 50.0, 0.0)
    problem, estimate = given(template, e, yaw)
    assert not select_neutral(problem, estimate).expressions.any()
    problem, estimate = given(template, e)
    assert select_neutral(problem, estimate).expressions.any()


def test_nothing_to_move_for_a_shared_expression(template):
    problem, estimate = given(template, np.zeros((COUNT, MODES)))
    assert move_to_neutral(problem, estimate) is estimate
