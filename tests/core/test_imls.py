"""Algorithm 1 on data that fulfil its assumptions: Lambertian, orthographic."""

from dataclasses import replace

import numpy as np
import pytest
from bsface.camera.camera import Camera
from bsface.errors import PhotoFailure, ReconstructionError
from bsface.landmarks.observations import LandmarkObservations
from bsface.solve.paper.algorithm1 import Limits, algorithm1, paper_steps
from bsface.solve.paper.shading import NormalField, ShadingParameters
from bsface.surface.bspline import BSplineSurface
from scipy.spatial.transform import Rotation

SHAPE = (14, 14)
PHOTOS = 16


def cap(depth, bump=0.0):
    """Paraboloid cap with a smooth relief, as a surface."""
    m, n = SHAPE
    u, v = np.meshgrid(
        (np.arange(m) - 1) / (m - 3), (np.arange(n) - 1) / (n - 3), indexing="ij"
    )
    x, y = 140 * (u - 0.5), -180 * (v - 0.5)
    z = -depth * ((x / 70) ** 2 + (y / 90) ** 2)
    z = z + bump * np.cos(3 * np.pi * u) * np.sin(2 * np.pi * v)
    return BSplineSurface(np.stack([x, y, z], -1))


@pytest.fixture(scope="module")
def case():
    rng = np.random.default_rng(0)
    template, truth = cap(40), cap(45, 3.0)
    uv = rng.uniform(0.03, 0.97, (900, 2))
    feature = rng.uniform(0.05, 0.95, (40, 2))
    Q = truth.evaluate(*feature.T)
    q = []
    for yaw, pitch, roll in rng.uniform(-1, 1, (PHOTOS, 3)) * [35, 20, 10]:
        R = Rotation.from_euler("YXZ", [yaw, pitch, roll], degrees=True).as_matrix()
        q.append(Camera(R, rng.uniform(1, 3), rng.uniform(-9, 9, 2)).project(Q))
    landmarks = LandmarkObservations(
        np.stack(q),
        np.ones((PHOTOS, 40)),
        np.arange(40),
        feature,
        np.zeros((PHOTOS, 2)),
    )
    direction = rng.normal(size=(PHOTOS, 3)) + [0, 0, 1]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    normals = truth.normals(*uv.T)
    # Ambient above direct light: no shadow, so rank 4 is exact.
    M = 1.2 + direction @ normals.T
    steps = paper_steps(
        landmarks,
        SHAPE,
        uv,
        lambda surface, cameras: (M, np.ones_like(M)),
        zeta=1e-5,
        shading=ShadingParameters(lam=1.0),
    )
    return template, truth, uv, steps, normals


def distance(surface, truth, uv):
    """Mean distance after the best rigid motion and scale."""
    a, b = surface.evaluate(*uv.T), truth.evaluate(*uv.T)
    a, b = a - a.mean(0), b - b.mean(0)
    U, d, Vt = np.linalg.svd(b.T @ a)
    scale = d.sum() / (a**2).sum()
    return np.linalg.norm(scale * a @ (U @ Vt).T - b, axis=1).mean()


def angle(surface, truth, uv):
    cosine = (surface.normals(*uv.T) * truth.normals(*uv.T)).sum(1)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean()


def test_converges_on_an_ideal_set(case):
    template, truth, uv, steps, _ = case
    states = list(algorithm1(template, uv, steps, Limits(8, 15, 100, motion_mm=0.02)))
    last = states[-1]
    assert last.finished and last.converged
    assert distance(last.surface, truth, uv) < 0.15 * distance(template, truth, uv)
    assert angle(last.surface, truth, uv) < 0.25 * angle(template, truth, uv)
    # Every loop ends by its test, not by its limit.
    assert all(s.converged for s in states if s.last)


def test_order_of_the_states_is_that_of_the_algorithm(case):
    template, _, uv, steps, _ = case
    states = list(algorithm1(template, uv, steps, Limits(2, 3, 4, 0.0, 0.0, 0.0)))
    one_pass = ["shading"] * 3 + ["motion"] * 4 + ["outer"]
    assert [s.stage for s in states] == one_pass * 2
    assert [s.inner for s in states[:8]] == [1, 2, 3, 1, 2, 3, 4, 0]
    assert [s.outer for s in states] == [1] * 8 + [2] * 8
    assert [s.finished for s in states] == [False] * 15 + [True]
    assert not any(s.converged for s in states)
    assert all(np.isfinite(s.change_mm) for s in states)
    assert "normal_rms_deg" in states[0].figures
    assert "landmark_rms_mm" in states[3].figures
    done = [Limits(2, 3, 4).progress(s) for s in states]
    assert done == [(k, 14) for k in [*range(1, 8), 7, *range(8, 15), 14]]
    # The surface of a pass is that of its last warp.
    assert np.array_equal(
        states[7].surface.control_points, states[6].surface.control_points
    )


def test_the_truth_is_a_fixed_point(case):
    _, truth, uv, steps, _ = case
    first = next(algorithm1(truth, uv, steps))
    assert first.change_mm < 1e-3
    for state in algorithm1(truth, uv, steps):
        assert state.change_mm < 1e-2
    assert state.finished and state.converged


def test_nothing_is_computed_that_is_not_asked_for(case):
    template, _, uv, steps, normals = case
    calls = []

    def counted(surface, reference, cameras):
        calls.append(surface)
        return NormalField(normals, np.ones(len(normals)))

    run = algorithm1(template, uv, replace(steps, photometric=counted))
    next(run)
    next(run)
    assert len(calls) == 2
    # The normals are asked for with the surface of the moment.
    assert np.array_equal(calls[0].control_points, template.control_points)
    assert not np.array_equal(calls[1].control_points, template.control_points)


def test_no_pose_at_all_fails_with_the_reasons(case):
    template, _, uv, steps, _ = case
    lost = replace(
        steps, poses=lambda b: (PhotoFailure("a.jpg", "implausible", "a.jpg: lost."),)
    )
    with pytest.raises(ReconstructionError, match="a.jpg: lost"):
        next(algorithm1(template, uv, lost))


def test_singular_system_fails_with_a_remedy(case):
    template, _, uv, steps, _ = case

    def fail(*_):
        raise np.linalg.LinAlgError("singular")

    with pytest.raises(ReconstructionError, match="singular.*regularisation"):
        next(algorithm1(template, uv, replace(steps, shading=fail)))


def test_limits_are_checked():
    with pytest.raises(ValueError, match="at least one turn"):
        Limits(outer=0)
    with pytest.raises(ValueError, match="negative"):
        Limits(motion_mm=-1)
