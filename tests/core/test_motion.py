"""Cameras and structure from made-up landmarks of known cameras."""

from dataclasses import replace

import hypothesis
import numpy as np
import pytest
from bsface.camera.camera import PARAMETERS
from bsface.camera.linear_pose import linear_pose
from bsface.camera.prior import FOCAL_SPREAD, CameraPrior
from bsface.solve.expression import expression_offsets
from bsface.solve.landmark_term import facing_weight, landmark_rows
from bsface.solve.motion import MotionOptions, estimate_motion, initial_cameras
from bsface.surface.alignment import fit_similarity
from bsface.surface.bspline import basis_matrix
from bsface.surface.prior import shape_prior
from few_modes import few_modes
from hypothesis import strategies as st
from observed_landmarks import observations, observe, true_cameras
from scipy.spatial.transform import Rotation

SHAPE = (12, 13)
RIGID = MotionOptions(expression=0.0, noise_mm=0.05, offset_mm=0.3, iterations=40)


@pytest.fixture(scope="module")
def template():
    return few_modes(SHAPE, identity=20, expression=4)


@pytest.fixture(scope="module")
def prior(template):
    return shape_prior(template, 1.0, 0.5, 1.0, 0.15)


@pytest.fixture(scope="module")
def index(template):
    return np.flatnonzero(template.landmark_reliable)[::4]


def person(template, prior, index, seed=0):
    """A draw of the prior: control points and landmarks."""
    rng = np.random.default_rng(seed)
    d = np.einsum("k,kbx->bx", rng.normal(size=len(prior.modes)), prior.modes)
    T = basis_matrix(SHAPE, *template.landmark_uv[index].T)
    return template.surface.vector + d, template.landmark_xyz[index] + T @ d


def last(*args):
    """The estimate that motion ends with."""
    *_, iteration = estimate_motion(*args)
    return iteration.estimate


def rows_of(found, template, seen, options):
    """Residuals (mm) and weights of all landmarks at an estimate, (n, f) each."""
    k = found.expressions.shape[1]
    offsets = expression_offsets(template, seen.uv, k)
    normals = template.surface.normals(*seen.uv.T)
    rows = []
    for i, camera in enumerate(found.cameras):
        Q = found.landmarks_xyz + offsets @ found.expressions[i]
        weight = seen.weight[i] * facing_weight(camera, Q, normals)
        sigma = options.sigma(template, seen.index)
        rows.append(landmark_rows(camera, Q, seen.pixels[i], weight, sigma))
    return np.stack([r.distance for r in rows]), np.stack([r.weight for r in rows])


def start(template, seen, kappa=1 / 1200):
    Q = template.landmark_xyz[seen.index]
    poses = [
        linear_pose(q, Q, w, (300, 250))
        for q, w in zip(seen.pixels, seen.weight, strict=True)
    ]
    return [replace(pose, kappa=kappa) for pose in poses]


def structure_error(estimate, Q):
    move = fit_similarity(estimate.landmarks_xyz, Q)
    return np.linalg.norm(move(estimate.landmarks_xyz) - Q, axis=1)


def test_template_itself_is_found_at_once(template, prior, index):
    """Landmarks of the template: no displacement, and the cameras come back."""
    Q, cameras = template.landmark_xyz[index], true_cameras()
    seen = observe(Q, cameras, index)
    found = last(template, prior, seen, start(template, seen), RIGID)
    assert structure_error(found, Q).max() < 0.1
    residual, weight = rows_of(found, template, seen, RIGID)
    assert residual[weight > 0.5 * weight.max()].max() < 0.1
    for camera, truth in zip(found.cameras, cameras, strict=True):
        assert np.degrees(Rotation.from_matrix(camera.R @ truth.R.T).magnitude()) < 0.3
        assert camera.s == pytest.approx(truth.s, rel=5e-3)


def test_person_is_recovered_up_to_a_similarity(template, prior, index):
    _, Q = person(template, prior, index)
    before = Q - template.landmark_xyz[index]
    assert np.linalg.norm(before, axis=1).mean() > 2
    seen = observe(Q, true_cameras(), index)
    found = last(template, prior, seen, start(template, seen), RIGID)
    residual, weight = rows_of(found, template, seen, RIGID)
    assert np.median(residual[weight > 0]) < 0.05
    assert (
        structure_error(found, Q).mean() < 0.15 * np.linalg.norm(before, axis=1).mean()
    )


def test_surface_follows_the_landmarks(template, prior, index):
    """The surface is the template moved by the two parts, and like the person's."""
    b, Q = person(template, prior, index)
    seen = observe(Q, true_cameras(), index)
    found = last(template, prior, seen, start(template, seen), RIGID)
    d = np.einsum("k,kbx->bx", found.modes, prior.modes) + found.smooth
    np.testing.assert_allclose(found.surface.vector, template.surface.vector + d)
    move = fit_similarity(found.landmarks_xyz, Q)
    marks = template.landmark_uv[index]
    T = basis_matrix(SHAPE, *marks.T)
    away = np.linalg.norm(move(T @ found.surface.vector) - T @ b, axis=1)
    plain = np.linalg.norm(T @ (template.surface.vector - b), axis=1)
    assert away.mean() < 0.3 * plain.mean()


def test_perspective_of_one_camera_does_not_shape_the_face(template, prior, index):
    """Taken from 400 mm or from far away: the same person."""
    _, Q = person(template, prior, index)
    for kappa in (1 / 400, 0.0):
        cameras = [replace(c, kappa=kappa) for c in true_cameras()]
        seen = observe(Q, cameras, index)
        # the prior of the distance is told the truth: it is not what is tested
        options = replace(RIGID, camera=CameraPrior(400.0))
        found = last(template, prior, seen, start(template, seen, kappa), options)
        assert structure_error(found, Q).mean() < 0.5


def test_a_known_focal_length_gives_the_distance(template, prior, index):
    """Photos at arm's length: the usual distance is far from theirs."""
    _, Q = person(template, prior, index)
    cameras = true_cameras(between=(350, 500))
    seen = observe(Q, cameras, index, noise=0.5)
    told = replace(seen, focal_px=tuple(camera.focal_px for camera in cameras))
    options = replace(RIGID, noise_mm=0.7, offset_mm=1.2)
    off = {}
    for name, marks in (("unknown", seen), ("known", told)):
        begin = initial_cameras(template, marks, options.camera)
        found = last(template, prior, marks, begin, options)
        ratios = [
            f.distance_mm / c.distance_mm
            for f, c in zip(found.cameras, cameras, strict=True)
        ]
        off[name] = float(np.median(np.abs(np.log(ratios))))
    assert off["known"] < 0.05 < 0.1 < off["unknown"]


@pytest.mark.parametrize("focal_px", [None, 900.0])
def test_the_pull_of_a_camera_is_the_slope_of_its_prior(focal_px):
    """Central differences of the logarithm of the density, twice."""
    prior = CameraPrior(1000.0, 0.3, 0.0, focal_px)
    camera = replace(true_cameras(1)[0], kappa=1 / 700)

    def density(step):
        moved = camera.moved(step)
        if focal_px is None:
            return -0.5 * (np.log(moved.distance_mm / 1000) / 0.3) ** 2
        return -0.5 * (np.log(moved.focal_px / focal_px) / FOCAL_SPREAD) ** 2

    h = 1e-3
    steps = h * np.eye(PARAMETERS)
    slope = [(density(s) - density(-s)) / (2 * h) for s in steps]
    np.testing.assert_allclose(prior.pull(camera), slope, atol=1e-5)
    bend = [
        [
            (density(a + b) - density(a - b) - density(b - a) + density(-a - b))
            / (4 * h * h)
            for b in steps
        ]
        for a in steps
    ]
    np.testing.assert_allclose(prior.precision(), -np.array(bend), atol=1e-3)


def test_a_focal_length_is_not_asked_under_orthography(template, index):
    cameras = true_cameras(3, kappa=False)
    seen = observe(template.landmark_xyz[index], cameras, index)
    told = replace(seen, focal_px=(900.0,) * 3)
    poses = initial_cameras(template, told, CameraPrior(np.inf))
    assert all(pose.kappa == 0 for pose in poses)


def test_scaled_orthography_stays_that(template, prior, index):
    seen = observe(template.landmark_xyz[index], true_cameras(kappa=False), index)
    found = last(template, prior, seen, start(template, seen, 0.0), RIGID)
    assert all(camera.kappa == 0 for camera in found.cameras)


def test_wrong_landmarks_are_outvoted(template, prior, index):
    _, Q = person(template, prior, index)
    seen = observe(Q, true_cameras(), index, noise=0.3)
    options = replace(RIGID, noise_mm=0.5)
    clean = last(template, prior, seen, start(template, seen), options)
    bad = np.random.default_rng(4).random(seen.weight.shape) < 0.08
    spoilt = replace(seen, pixels=seen.pixels + 25.0 * bad[..., None])
    found = last(template, prior, spoilt, start(template, spoilt), options)
    assert structure_error(found, Q).mean() < 2 * structure_error(clean, Q).mean() + 0.1
    _, weight = rows_of(found, template, spoilt, options)
    assert np.median(weight[bad]) < 0.1 * np.median(weight[~bad])


def test_unseen_landmarks_count_nothing(template, prior, index):
    _, Q = person(template, prior, index)
    seen = observe(Q, true_cameras(), index)
    weight = seen.weight.copy()
    weight[:, ::3] = 0
    weight[2, 1::3] = 0
    garbage = np.where(weight[..., None] > 0, seen.pixels, 1e4)
    one, two = (
        last(template, prior, s, start(template, replace(seen, weight=weight)), RIGID)
        for s in (
            replace(seen, weight=weight),
            observations(garbage, weight, index),
        )
    )
    np.testing.assert_allclose(one.surface.vector, two.surface.vector, atol=1e-9)


def test_order_of_the_photos_does_not_matter(template, prior, index):
    _, Q = person(template, prior, index)
    seen = observe(Q, true_cameras(), index, noise=0.5)
    cameras = start(template, seen)
    order = np.random.default_rng(5).permutation(len(cameras))
    mixed = observations(seen.pixels[order], seen.weight[order], index)
    options = replace(RIGID, noise_mm=1.0)
    one = last(template, prior, seen, cameras, options)
    two = last(template, prior, mixed, [cameras[k] for k in order], options)
    np.testing.assert_allclose(one.surface.vector, two.surface.vector, atol=1e-6)
    for k, camera in zip(order, two.cameras, strict=True):
        np.testing.assert_allclose(one.cameras[k].R, camera.R, atol=1e-6)


def test_size_of_the_photos_does_not_matter(template, prior, index):
    _, Q = person(template, prior, index)
    seen = observe(Q, true_cameras(), index, noise=0.5)
    half = replace(seen, pixels=seen.pixels / 2)
    options = replace(RIGID, noise_mm=1.0)
    one = last(template, prior, seen, start(template, seen), options)
    cameras = [
        replace(c, s=c.s / 2, t=c.t / 2, principal=c.principal / 2)
        for c in start(template, seen)
    ]
    two = last(template, prior, half, cameras, options)
    np.testing.assert_allclose(one.surface.vector, two.surface.vector, atol=1e-6)


def test_expressions_of_single_photos_do_not_shape_the_face(template, prior, index):
    """Two of ten photos smile: their coefficients say so, the face stays calm."""
    _, Q = person(template, prior, index)
    cameras = true_cameras()
    T = basis_matrix(SHAPE, *template.landmark_uv[index].T)
    smile = 2.0 * (T @ template.expression_modes[0].reshape(-1, 3))
    assert np.linalg.norm(smile, axis=1).max() > 1.5
    pixels = np.stack(
        [c.project(Q + smile * (i in (3, 6))) for i, c in enumerate(cameras)]
    )
    seen = observations(pixels, np.ones(pixels.shape[:2]), index)
    options = replace(RIGID, expression=1.0)
    found = last(template, prior, seen, start(template, seen), options)
    e = found.expressions[:, 0]
    assert e.shape == (10,)
    others = np.delete(e, [3, 6])
    assert min(e[3], e[6]) - others.max() > 0.8
    assert structure_error(found, Q).mean() < 1.0


@pytest.mark.parametrize("count", [1, 2])
def test_few_photos_stay_plausible(template, prior, index, count):
    """What the photos do not tell comes from the prior: finite and face-sized."""
    _, Q = person(template, prior, index)
    seen = observe(Q, true_cameras(10)[4 : 4 + count], index, noise=1.0)
    found = last(
        template, prior, seen, start(template, seen), replace(RIGID, noise_mm=1.0)
    )
    assert np.isfinite(found.surface.vector).all()
    uv = template.landmark_uv.T
    here, usual = found.surface.evaluate(*uv), template.surface.evaluate(*uv)
    away = np.linalg.norm(fit_similarity(here, usual)(here) - usual, axis=1)
    assert away.max() < 15


def test_residual_falls(template, prior, index):
    _, Q = person(template, prior, index)
    seen = observe(Q, true_cameras(), index)
    history = [
        iteration.residual
        for iteration in estimate_motion(
            template, prior, seen, start(template, seen), RIGID
        )
    ]
    assert history[-1] < 0.1 * history[0]
    assert np.diff(history).max() < 0.05 * history[0]


@hypothesis.given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 4),
    noise=st.sampled_from([1.0, 30.0, 300.0]),
    flat=st.booleans(),
    known=st.sampled_from([0.1, 0.6, 1.0]),
)
@hypothesis.settings(
    max_examples=25,
    deadline=None,
    suppress_health_check=[hypothesis.HealthCheck.function_scoped_fixture],
)
def test_any_landmarks_end_finite(
    template, prior, index, seed, count, noise, flat, known
):
    """Scattered over the picture, on a line, mostly hidden: what comes is a surface."""
    index = index[::3]
    rng = np.random.default_rng(seed)
    cameras = true_cameras(count, seed=int(rng.integers(99)))
    seen = observe(template.landmark_xyz[index], cameras, index, noise, seed)
    pixels = np.clip(seen.pixels, -200, 900)
    if flat:
        pixels[..., 1] = 250.0
    weight = rng.random(seen.weight.shape) * (rng.random(seen.weight.shape) < known)
    options = replace(RIGID, expression=1.0, noise_mm=1.0, iterations=15)
    seen = replace(seen, pixels=pixels, weight=weight)
    views = [replace(c, kappa=1 / 1200) for c in cameras]
    found = last(template, prior, seen, views, options)
    assert np.isfinite(found.surface.vector).all()
    assert np.isfinite(found.landmarks_xyz).all()
    for camera in found.cameras:
        np.testing.assert_allclose(camera.R @ camera.R.T, np.eye(3), atol=1e-9)
        assert np.isfinite([camera.s, camera.kappa, *camera.t]).all() and camera.s > 0


def test_landmarks_on_a_line_end_finite(template, prior):
    """Six landmarks of the profile line: most is open, nothing breaks."""
    middle = np.abs(template.landmark_xyz[:, 0]) < 0.5
    index = np.flatnonzero(middle & template.landmark_reliable)
    Q = template.landmark_xyz[index]
    assert len(Q) >= 6
    cameras = true_cameras(4)
    seen = observe(Q, cameras, index)
    found = last(
        template, prior, seen, [replace(c, kappa=1 / 1200) for c in cameras], RIGID
    )
    assert np.isfinite(found.surface.vector).all()
    assert np.isfinite([c.R for c in found.cameras]).all()
