"""How well landmarks fix the surface: against dense algebra, and against draws."""

import numpy as np
import pytest
from bsface.problem import Constraint, PhotoCollection, Problem
from bsface.settings import Settings
from bsface.solve.landmark_deviation import NormalDisplacement, landmark_deviation
from bsface.solve.landmark_system import LandmarkModel
from bsface.solve.motion import MotionOptions, estimate_motion
from bsface.surface.alignment import fit_similarity
from bsface.surface.bspline import basis_matrix
from bsface.surface.prior import shape_prior
from few_modes import few_modes
from observed_landmarks import observe, true_cameras

SHAPE = (9, 10)
SIZE = SHAPE[0] * SHAPE[1]
SETTINGS = Settings(
    method="motion",
    control_points=SHAPE,
    expressions=False,
    landmark_noise_mm=0.3,
    landmark_offset_mm=0.4,
)


@pytest.fixture(scope="module")
def template():
    return few_modes(SHAPE, identity=6, expression=2)


@pytest.fixture(scope="module")
def prior(template):
    return shape_prior(template, 1.0, 0.0, 1.5, 0.15)


@pytest.fixture(scope="module")
def index(template):
    return np.flatnonzero(template.landmark_reliable)[::9]


def covariance_of(prior):
    """Of all control points, coordinates interleaved, (3 M*N, 3 M*N)."""
    modes = prior.modes.reshape(len(prior.modes), -1)
    smooth = np.linalg.inv(prior.smooth.toarray())
    return modes.T @ modes + np.kron(smooth, np.eye(3))


def without_similarity(displacement, surface, template):
    """What of a displacement (M*N, 3) no similarity of the control points does."""
    X = surface.vector
    move = fit_small_similarity(X, displacement, template.inside(surface.greville))
    return displacement - move


def fit_small_similarity(X, displacement, weights):
    """The closest ``t + w x X + s X``, as it displaces the points."""
    columns = [np.tile(axis, (len(X), 1)) for axis in np.eye(3)]
    columns += [np.cross(axis, X) for axis in np.eye(3)] + [X]
    A = np.stack([c.ravel() for c in columns], 1)
    w = np.repeat(weights.astype(float), 3)
    found = np.linalg.lstsq(
        np.sqrt(w)[:, None] * A, np.sqrt(w) * displacement.ravel(), rcond=None
    )
    return (A @ found[0]).reshape(X.shape)


def problem_of(template, prior, landmarks, **changes):
    collection = PhotoCollection(photos=(), landmarks=())
    return Problem(collection, template, prior, landmarks, SETTINGS, **changes)


def estimated(template, prior, landmarks, cameras):
    options = MotionOptions.from_settings(SETTINGS)
    *_, last = estimate_motion(template, prior, landmarks, cameras, options)
    return last.estimate


@pytest.fixture(scope="module")
def seen(template, prior, index):
    cameras = true_cameras(3)
    landmarks = observe(template.landmark_xyz[index], cameras, index, noise=0.5)
    return landmarks, estimated(template, prior, landmarks, cameras)


def test_deviation_is_that_of_the_dense_posterior(template, prior, seen):
    landmarks, estimate = seen
    surface = estimate.surface
    found = landmark_deviation(problem_of(template, prior, landmarks), estimate)
    T = np.kron(basis_matrix(SHAPE, *landmarks.uv.T).toarray(), np.eye(3))
    before = covariance_of(prior)
    options = MotionOptions.from_settings(SETTINGS)
    model = LandmarkModel.of(template, prior, landmarks, options)
    marks = T @ before @ T.T + options.offset_mm**2 * np.eye(len(T))
    np.testing.assert_allclose(model.precision @ marks, np.eye(len(T)), atol=1e-8)
    moved = estimate.landmarks_xyz - model.start
    given = model.linearise(estimate.cameras, moved, np.zeros((3, 0))).precision
    # What the photos alone say of the landmarks is an observation of T b + offset.
    photos = given - model.precision
    joint = np.linalg.inv(photos + 1e-9 * np.eye(len(T))) + marks
    after = before - before @ T.T @ np.linalg.solve(joint, T @ before)
    normals = surface.normals(*surface.greville.T)
    ways = np.eye(3 * SIZE).reshape(-1, SIZE, 3)
    A = np.stack(
        [(normals * without_similarity(w, surface, template)).sum(1) for w in ways], 1
    )
    expected = np.sqrt(np.diag(A @ after @ A.T)).reshape(SHAPE)
    np.testing.assert_allclose(found, expected, rtol=1e-3)


def test_similarities_have_no_deviation(template):
    surface = template.surface
    shape = NormalDisplacement.of(surface, template)
    rng = np.random.default_rng(0)
    t, w, s = rng.normal(size=3), rng.normal(size=3), rng.normal()
    moved = t + np.cross(w, surface.vector) + s * surface.vector
    along = (shape.normals * moved).sum(1)
    taken = shape.similarity @ np.einsum("acx,cx->a", shape.fit, moved)
    np.testing.assert_allclose(taken, along, atol=1e-9)


def test_draws_of_the_prior_are_as_far_away_as_stated(template, prior, index):
    rng = np.random.default_rng(3)
    root = np.linalg.cholesky(covariance_of(prior))
    T = basis_matrix(SHAPE, *template.landmark_uv[index].T)
    inside = template.inside(template.surface.greville)
    ratios = []
    for draw in range(30):
        d = (root @ rng.normal(size=len(root))).reshape(-1, 3)
        offset = SETTINGS.landmark_offset_mm * rng.normal(size=(len(index), 3))
        cameras = true_cameras(4, seed=draw)
        Q = template.landmark_xyz[index] + T @ d + offset
        landmarks = observe(Q, cameras, index)
        # the detector's noise in millimetres, as the options have it
        options = MotionOptions.from_settings(SETTINGS)
        size = options.sigma(template, index)[:, None]
        for i, camera in enumerate(cameras):
            noise = camera.s * size * rng.normal(size=landmarks.pixels[i].shape)
            landmarks.pixels[i] += noise
        estimate = estimated(template, prior, landmarks, cameras)
        stated = landmark_deviation(problem_of(template, prior, landmarks), estimate)
        surface = estimate.surface
        truth = template.surface.vector + d
        move = fit_similarity(truth, surface.vector, inside.astype(float))
        away = move(truth) - surface.vector
        along = (away * surface.normals(*surface.greville.T)).sum(1)
        ratios.append((along / stated.ravel())[inside])
    size = np.sqrt(np.mean(np.square(ratios)))
    assert 0.8 < size < 1.2


def test_more_photos_leave_less_open(template, prior, index):
    def spread(count):
        cameras = true_cameras(count)
        landmarks = observe(template.landmark_xyz[index], cameras, index)
        estimate = estimated(template, prior, landmarks, cameras)
        found = landmark_deviation(problem_of(template, prior, landmarks), estimate)
        return np.median(found.ravel()[template.inside(template.surface.greville)])

    assert spread(9) < spread(3) < spread(1)


def test_held_points_are_as_sure_as_they_are_held(template, prior, seen):
    landmarks, estimate = seen
    points = np.zeros(SHAPE, bool)
    points[3, 4] = True
    free = landmark_deviation(problem_of(template, prior, landmarks), estimate)
    for softness in (0.0, 0.1):
        held = problem_of(
            template, prior, landmarks, constraint=Constraint(points, softness)
        )
        found = landmark_deviation(held, estimate)
        assert found[3, 4] == softness
        np.testing.assert_array_equal(found[~points], free[~points])
