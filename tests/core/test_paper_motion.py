"""Eq. 8 against its definition, known shapes and a dense oracle."""

import numpy as np
import pytest
from bsface.camera.camera import Camera
from bsface.errors import PhotoFailure
from bsface.landmarks.observations import LandmarkObservations
from bsface.solve.paper.motion import (
    RIDGE,
    estimate_poses,
    motion_vector,
    warp,
)
from bsface.surface.bending import bending_matrix
from bsface.surface.bspline import basis_matrix
from scipy.spatial.transform import Rotation

SHAPE = (8, 9)


def net(depth=30.0, shape=SHAPE):
    """A paraboloid cap as control points, (M*N, 3); v runs down, z to the camera."""
    m, n = shape
    u, v = np.meshgrid(
        (np.arange(m) - 1) / (m - 3), (np.arange(n) - 1) / (n - 3), indexing="ij"
    )
    x, y = 140 * (u - 0.5), -180 * (v - 0.5)
    z = -depth * ((x / 70) ** 2 + (y / 90) ** 2)
    return np.stack([x, y, z], -1).reshape(-1, 3)


def observations(pixels, weight, uv, principal):
    index = np.arange(pixels.shape[1])
    return LandmarkObservations(pixels, weight, index, uv, principal)


def scene(b, photos=6, points=40, seed=0, shape=SHAPE):
    rng = np.random.default_rng(seed)
    uv = rng.uniform(0.05, 0.95, (points, 2))
    Q = basis_matrix(shape, *uv.T) @ b
    cameras = []
    for yaw, pitch, roll in rng.uniform(-1, 1, (photos, 3)) * [40, 20, 10]:
        R = Rotation.from_euler("YXZ", [yaw, pitch, roll], degrees=True).as_matrix()
        t = rng.uniform(-20, 20, 2)
        cameras.append(Camera(R, rng.uniform(0.5, 4), t, 0.0, np.array([200, 150.0])))
    q = np.stack([c.project(Q) for c in cameras])
    principal = np.tile([200.0, 150.0], (photos, 1))
    return cameras, observations(
        q, rng.uniform(0.3, 1, (photos, points)), uv, principal
    )


def landmark_rms(b, cameras, landmarks):
    """Root mean square landmark residual of control points, mm on the face."""
    f, P, w = motion_vector(cameras, landmarks)
    points = basis_matrix(SHAPE, *landmarks.uv.T) @ b
    residual = f - np.einsum("nia,fa->nfi", P, points)
    return np.sqrt((w * (residual**2).sum(2)).sum())


def test_motion_vector_is_the_projection_without_translation():
    cameras, landmarks = scene(net())
    f, P, w = motion_vector(cameras, landmarks)
    Q = basis_matrix(SHAPE, *landmarks.uv.T) @ net()
    assert np.allclose(f, np.einsum("nia,fa->nfi", P, Q))
    assert w.sum() == pytest.approx(1)


def test_poses_of_the_true_shape_are_exact():
    cameras, landmarks = scene(net())
    for true, found in zip(
        cameras, estimate_poses(net(), SHAPE, landmarks), strict=True
    ):
        assert isinstance(found, Camera)
        assert np.allclose(found.R, true.R)
        assert found.s == pytest.approx(true.s)
        assert np.allclose(found.t, true.t)


def test_zero_residual_returns_b0():
    b = net() + np.random.default_rng(3).normal(size=(72, 3))
    cameras, landmarks = scene(b)
    warped, figures = warp(b, SHAPE, cameras, landmarks)
    assert np.allclose(warped, b, atol=1e-8)
    assert figures["landmark_rms_mm"] < 1e-8
    assert figures["bending"] < 1e-12


@pytest.mark.parametrize("zeta", [1e-5, 1e-2])
def test_equals_the_dense_closed_form(zeta):
    cameras, landmarks = scene(net(35), points=25)
    b0 = net() + np.random.default_rng(4).normal(size=(72, 3))
    got, _ = warp(b0, SHAPE, cameras, landmarks, zeta)

    f, P, w = motion_vector(cameras, landmarks)
    T = np.kron(basis_matrix(SHAPE, *landmarks.uv.T).toarray(), np.eye(3))
    n, count = w.shape
    Pd = np.concatenate([np.kron(np.eye(count), P[i]) for i in range(n)])
    W = np.repeat(w.ravel(), 2)
    PT = Pd @ T
    KtK = zeta * np.kron(bending_matrix(SHAPE).toarray(), np.eye(3))
    KtK += RIDGE * zeta * np.eye(len(KtK))
    expected = np.linalg.solve(
        (PT.T * W) @ PT + KtK, (PT.T * W) @ f.ravel() + KtK @ b0.ravel()
    )
    assert np.allclose(got.ravel(), expected, atol=1e-6)


def test_warp_with_true_poses_recovers_depth():
    truth, b0 = net(40), net(30)
    cameras, landmarks = scene(truth, points=60)
    warped, figures = warp(b0, SHAPE, cameras, landmarks, 1e-6)
    T = basis_matrix(SHAPE, *np.random.default_rng(5).uniform(0.1, 0.9, (2, 200)))
    before = np.linalg.norm(T @ (b0 - truth), axis=1).mean()
    after = np.linalg.norm(T @ (warped - truth), axis=1).mean()
    assert after < 0.05 * before
    assert figures["landmark_rms_mm"] < 0.1 * figures["landmark_rms_before_mm"]
    assert landmark_rms(warped, cameras, landmarks) == pytest.approx(
        figures["landmark_rms_mm"]
    )


def test_size_of_a_photo_does_not_matter():
    cameras, landmarks = scene(net(35))
    landmarks.pixels[0] += np.random.default_rng(6).normal(size=(40, 2))
    a, _ = warp(net(), SHAPE, cameras, landmarks)
    big = 10.0
    c = cameras[0]
    cameras[0] = Camera(c.R, big * c.s, big * c.t, 0.0, big * c.principal)
    q = landmarks.pixels.copy()
    q[0] *= big
    principal = landmarks.principal.copy()
    principal[0] *= big
    scaled = observations(q, landmarks.weight, landmarks.uv, principal)
    b, _ = warp(net(), SHAPE, cameras, scaled)
    assert np.allclose(a, b, atol=1e-8)


def test_missing_landmarks_and_photos_have_no_say():
    cameras, landmarks = scene(net(35))
    q = landmarks.pixels.copy()
    weights = landmarks.weight.copy()
    q[1, :5] = np.nan
    weights[2, :5] = 0
    q[2, :5] = 1e6
    spoilt = observations(q, weights, landmarks.uv, landmarks.principal)
    failed = [*cameras[:-1], PhotoFailure("x", "implausible", "x: no pose.")]
    b, _ = warp(net(), SHAPE, failed, spoilt)
    assert np.isfinite(b).all()
    assert landmark_rms(b, failed, spoilt) < 2
    clean = observations(
        landmarks.pixels[:-1],
        spoilt.weight[:-1],
        landmarks.uv,
        landmarks.principal[:-1],
    )
    assert np.allclose(warp(net(), SHAPE, cameras[:-1], clean)[0], b, atol=1e-8)


def test_mirrored_photos_give_the_mirrored_shape():
    b0, truth = net(), net(35) + [0, 0, 0]
    truth[:, 2] += 0.1 * truth[:, 0]
    cameras, landmarks = scene(truth)
    a, _ = warp(b0, SHAPE, cameras, landmarks)
    flip = np.diag([-1.0, 1, 1])
    other = [
        Camera(flip @ c.R @ flip, c.s, c.t * [-1, 1], 0.0, np.zeros(2)) for c in cameras
    ]
    q = (landmarks.pixels - landmarks.principal[:, None]) * [-1, 1]
    mirrored = observations(
        q,
        landmarks.weight,
        landmarks.uv * [-1, 1] + [1, 0],
        np.zeros_like(landmarks.principal),
    )
    b, _ = warp(b0, SHAPE, other, mirrored)
    back = (b.reshape(*SHAPE, 3)[::-1] * [-1, 1, 1]).reshape(-1, 3)
    assert np.allclose(a, back, atol=1e-8)


def test_refuses_what_cannot_work():
    cameras, landmarks = scene(net())
    with pytest.raises(ValueError, match="zeta"):
        warp(net(), SHAPE, cameras, landmarks, 0.0)
    with pytest.raises(ValueError, match="no data"):
        warp(net(), SHAPE, [PhotoFailure("x", "implausible", "x")] * 6, landmarks)
    with pytest.raises(ValueError, match="landmarks need"):
        observations(
            landmarks.pixels, landmarks.weight, landmarks.uv[:-1], landmarks.principal
        )
