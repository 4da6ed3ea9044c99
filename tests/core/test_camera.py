"""The camera: a textbook pinhole, its derivatives, and its invariances."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
import reference
from bsface.camera.camera import PARAMETERS, Camera
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

seeds = st.integers(0, 2**32 - 1)
KINDS = ["perspective", "orthography"]


def camera(seed, kind="perspective") -> Camera:
    rng = np.random.default_rng(seed)
    return Camera(
        Rotation.from_rotvec(rng.normal(0, 0.6, 3)).as_matrix(),
        float(rng.uniform(0.3, 6)),
        rng.normal(0, 60, 2),
        0.0 if kind == "orthography" else float(rng.uniform(1 / 3000, 1 / 400)),
        rng.uniform(100, 2000, 2),
    )


def head_points(seed, count=12):
    return np.random.default_rng(seed).normal(0, 60, (count, 3))


def similarity(seed):
    rng = np.random.default_rng(seed)
    R = Rotation.from_rotvec(rng.normal(0, 0.5, 3)).as_matrix()
    return float(rng.uniform(0.5, 2)), R, rng.normal(0, 30, 3)


def test_frontal_head():
    """Identity: the subject's left is right in the picture, up is up."""
    c = Camera(np.eye(3), 2.0, (10, 20), 0.0, (100, 200))
    pixels = c.project([[0, 0, 0], [5, 0, 0], [0, 5, 0], [0, 0, 50]])
    np.testing.assert_allclose(pixels, [[110, 220], [120, 220], [110, 210], [110, 220]])


@given(seed=seeds)
def test_is_a_pinhole(seed):
    c = camera(seed)
    Q = head_points(seed)
    K = np.array(
        [[c.focal_px, 0, c.principal[0]], [0, c.focal_px, c.principal[1]], [0, 0, 1]]
    )
    # where the ray through the principal point meets the plane of the head's origin
    centre = c.R.T @ [-c.t[0] / c.s, c.t[1] / c.s, c.distance_mm]
    np.testing.assert_allclose(
        c.project(Q), reference.pinhole(Q, K, c.R, centre), rtol=1e-9, atol=1e-7
    )
    ray = centre - Q
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    np.testing.assert_allclose(c.toward(Q), ray, atol=1e-12)


@given(seed=seeds)
def test_orthography_is_the_limit_of_far_cameras(seed):
    near = camera(seed, "orthography")
    far = Camera(near.R, near.s, near.t, 1e-10, near.principal)
    Q = head_points(seed)
    np.testing.assert_allclose(far.project(Q), near.project(Q), rtol=1e-5)
    np.testing.assert_allclose(far.toward(Q), near.toward(Q), atol=1e-6)
    assert near.distance_mm == near.focal_px == np.inf


@pytest.mark.parametrize("kind", KINDS)
@given(seed=seeds)
@settings(max_examples=30)
def test_jacobians_are_the_derivatives(kind, seed):
    c, Q = camera(seed, kind), head_points(seed)
    pixels, by_point, by_camera = c.jacobians(Q)
    np.testing.assert_allclose(pixels, c.project(Q), rtol=1e-13)
    expected = reference.numerical_derivative(lambda e: c.project(Q + e), 3, 1e-3)
    np.testing.assert_allclose(by_point, expected, atol=1e-6 * c.s)
    expected = reference.numerical_derivative(
        lambda e: c.moved(e).project(Q), PARAMETERS, 1e-5
    )
    np.testing.assert_allclose(by_camera, expected, atol=2e-5 * max(1, c.s))


@pytest.mark.parametrize("kind", KINDS)
@given(seed=seeds)
def test_moving_keeps_a_camera_a_camera(kind, seed):
    c = camera(seed, kind)
    step = np.random.default_rng(seed).normal(0, 0.5, PARAMETERS)
    moved = c.moved(step)
    np.testing.assert_allclose(moved.R @ moved.R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(moved.R) > 0
    assert moved.s > 0
    assert (moved.kappa > 0) == (c.kappa > 0)
    still = c.moved(np.zeros(PARAMETERS))
    np.testing.assert_allclose(still.project(head_points(1)), c.project(head_points(1)))


@pytest.mark.parametrize("kind", KINDS)
@given(seed=seeds)
def test_moved_head_and_rescaled_camera_give_the_same_picture(kind, seed):
    c, Q = camera(seed, kind), head_points(seed)
    factor, R, t = similarity(seed)
    moved = factor * Q @ R.T + t
    other = c.rescaled(factor, R, t)
    np.testing.assert_allclose(other.project(moved), c.project(Q), rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(other.toward(moved), c.toward(Q) @ R.T, atol=1e-10)
    np.testing.assert_allclose(other.focal_px, c.focal_px, rtol=1e-10)


@pytest.mark.parametrize("kind", KINDS)
@given(seed=seeds)
def test_pixels_scale_with_s_and_t(kind, seed):
    """Half the resolution: half of s, t and principal, whatever the pose."""
    c, Q = camera(seed, kind), head_points(seed)
    half = Camera(c.R, c.s / 2, c.t / 2, c.kappa, c.principal / 2)
    np.testing.assert_allclose(half.project(Q), c.project(Q) / 2, rtol=1e-12)


@given(seed=seeds, quarter=st.sampled_from([90, 180, -90, 17]))
def test_a_picture_that_lies_on_its_side_turns_the_head_alike(seed, quarter):
    """Only the roll is another one."""
    c = camera(seed, "perspective")
    turned = Rotation.from_euler("z", quarter, degrees=True).as_matrix() @ c.R
    yaw, pitch, roll = replace(c, R=turned).yaw_pitch_roll
    np.testing.assert_allclose([yaw, pitch], c.yaw_pitch_roll[:2], atol=1e-6)
    away = (roll - (c.yaw_pitch_roll[2] - quarter) + 180) % 360 - 180
    assert abs(away) < 1e-6


@pytest.mark.parametrize(
    ("angles", "axis"), [((30, 0, 0), "y"), ((0, 20, 0), "x"), ((0, 0, 15), "z")]
)
def test_names_of_the_angles(angles, axis):
    """Yaw to the picture's right, pitch up, roll clockwise as seen."""
    sign = {"y": 1, "x": -1, "z": -1}[axis]
    R = Rotation.from_euler(axis, sign * sum(angles), degrees=True).as_matrix()
    c = Camera(R, 1.0, (0, 0))
    np.testing.assert_allclose(c.yaw_pitch_roll, angles, atol=1e-12)
    nose, crown = c.project([[0, 0, 100.0], [0, 100, 0]])
    assert (nose[0] > 1) == (angles[0] > 0)
    assert (nose[1] < -1) == (angles[1] > 0)
    assert (crown[0] > 1) == (angles[2] > 0)


def test_toward_has_the_shape_of_the_points():
    for kind in KINDS:
        for shape in ((3,), (5, 3), (2, 4, 3)):
            ray = camera(3, kind).toward(np.zeros(shape))
            assert ray.shape == shape
            np.testing.assert_allclose(np.linalg.norm(ray, axis=-1), 1)


GOOD = {"R": np.eye(3), "s": 1.0, "t": (0.0, 0.0), "kappa": 0.001, "principal": (1, 2)}


@pytest.mark.parametrize(
    "name, wrong",
    [
        ("R", [1, 0, 0]),
        ("R", np.full((3, 3), np.nan)),
        ("R", np.eye(3, dtype=complex)),
        ("R", None),
        ("s", 0.0),
        ("s", -1.0),
        ("s", np.inf),
        ("s", "1"),
        ("s", [1.0, 2.0]),
        ("t", [0.0, 0.0, 0.0]),
        ("t", [0.0, np.inf]),
        ("kappa", np.nan),
        ("principal", 3.0),
        ("principal", [[0.0, 0.0]]),
    ],
)
def test_what_is_no_camera_is_refused(name, wrong):
    words = f"{name} must|A camera has finite numbers"
    with pytest.raises(ValueError, match=words):
        Camera(**{**GOOD, name: wrong})


@pytest.mark.parametrize(
    "again",
    [lambda c: c, copy.copy, copy.deepcopy, lambda c: pickle.loads(pickle.dumps(c))],
)
def test_a_camera_owns_its_numbers(again):
    given = {n: np.array(v, float) for n, v in GOOD.items()}
    made = again(Camera(**given))
    for name in ("R", "t", "principal"):
        given[name][:] = 7.0
        assert not (getattr(made, name) == 7.0).any()
        with pytest.raises(ValueError, match="read-only"):
            getattr(made, name)[0] = 1.0
    assert type(made.s) is float and type(made.kappa) is float


@pytest.mark.parametrize("points", [[1.0, 2.0], np.zeros((3, 4)), 1.0, [["a"] * 3]])
@pytest.mark.parametrize("kappa", [0.0, 0.001])
def test_points_of_another_shape_are_refused(points, kappa):
    c = Camera(**{**GOOD, "kappa": kappa})
    for method in (c.project, c.toward, c.jacobians):
        with pytest.raises(ValueError, match=r"Q must (be \(\.\.\., 3\)|hold real)"):
            method(points)
    with pytest.raises(ValueError, match=r"\(p, 3\)"):
        c.jacobians([1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    "factor, R, t",
    [
        (0, np.eye(3), np.zeros(3)),
        (-1.0, np.eye(3), np.zeros(3)),
        (np.nan, np.eye(3), np.zeros(3)),
        (1.0, np.eye(2), np.zeros(3)),
        (1.0, np.eye(3), np.zeros(2)),
        (1.0, np.eye(3), (0, 0, -2000.0)),  # behind the camera
    ],
)
def test_unusable_movements_of_the_head_are_refused(factor, R, t):
    with pytest.raises(ValueError, match="must be|positive scale"):
        Camera(**GOOD).rescaled(factor, R, t)
