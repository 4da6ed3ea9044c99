"""The linear pose is exact for exact data and invariant where it should be."""

import numpy as np
import pytest
from bsface.camera.camera import Camera
from bsface.camera.linear_pose import linear_pose
from scipy.spatial.transform import Rotation


@pytest.fixture
def points():
    rng = np.random.default_rng(5)
    return rng.normal(size=(40, 3)) * [40, 50, 20] + [0, -20, 10]


def camera(yaw, pitch, roll, s=2.3, t=(12.0, -7.0)):
    R = Rotation.from_euler("YXZ", [yaw, pitch, roll], degrees=True).as_matrix()
    return Camera(
        R=R, s=s, t=np.array(t), kappa=0.0, principal=np.array([200.0, 150.0])
    )


@pytest.mark.parametrize("yaw", [-70, 0, 35])
@pytest.mark.parametrize("pitch", [-30, 10])
@pytest.mark.parametrize("roll", [-120, 0, 25])
def test_recovers_a_known_pose(points, yaw, pitch, roll):
    truth = camera(yaw, pitch, roll)
    q = truth.project(points)
    found = linear_pose(q, points, principal=(200.0, 150.0))
    assert isinstance(found, Camera)
    assert np.allclose(found.R, truth.R, atol=1e-10)
    assert found.s == pytest.approx(truth.s)
    assert np.allclose(found.t, truth.t)
    assert found.kappa == 0
    assert np.allclose(found.project(points), q, rtol=0, atol=1e-9)


def test_principal_point_only_moves_t(points):
    q = camera(20, 5, 3).project(points)
    a = linear_pose(q, points)
    b = linear_pose(q, points, principal=(99.0, 12.0))
    assert isinstance(a, Camera) and isinstance(b, Camera)
    assert np.allclose(a.project(points), b.project(points))
    assert np.allclose(a.t - b.t, [99.0, 12.0])


def test_rotation_is_proper_for_noisy_and_mirrored_data(points):
    rng = np.random.default_rng(6)
    q = camera(20, 5, 3).project(points) + rng.normal(size=(40, 2)) * 5
    for picture in (q, q * [-1, 1]):
        found = linear_pose(picture, points)
        assert isinstance(found, Camera)
        assert np.allclose(found.R @ found.R.T, np.eye(3))
        assert np.linalg.det(found.R) == pytest.approx(1)


def test_weights_and_missing_points(points):
    truth = camera(-25, 8, 2)
    q = truth.project(points)
    q[:3] += 80.0
    q[3] = np.nan
    weights = np.ones(40)
    weights[:3] = 0
    found = linear_pose(q, points, weights)
    assert isinstance(found, Camera)
    assert np.allclose(found.R, truth.R, atol=1e-10)
    assert np.allclose(found.project(points[4:]), q[4:], rtol=0, atol=1e-9)


def test_too_few_or_flat_points_are_a_value_with_a_reason(points):
    q = camera(0, 0, 0).project(points)
    few = linear_pose(q[:4], points[:4], name="a.jpg")
    assert not few and "a.jpg: only 4 landmarks" in few.reason
    flat = linear_pose(q, points * [1, 1, 0], name="b.jpg")
    assert not flat and "plane" in flat.reason
    same = linear_pose(np.ones((40, 2)), points, name="c.jpg")
    assert not same and "c.jpg" in same.reason
