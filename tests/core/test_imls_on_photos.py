"""The method "imls": its normals, its two equations, its way back to a known surface.

Pictures are given by a formula, so that intensities are exact at any place.
"""

from dataclasses import replace

import numpy as np
import pytest
from bsface.camera.camera import Camera
from bsface.landmarks.observations import LandmarkObservations
from bsface.problem import FaceEstimate, PhotoCollection, Problem
from bsface.progress import never_cancelled
from bsface.settings import Settings
from bsface.solve.joint.options import JointOptions, Level
from bsface.solve.joint.refine import JointParts
from bsface.solve.joint.samples import contravariant, sample_grid
from bsface.solve.joint.state import DisplacementModel
from bsface.solve.paper.imls import ShapeSolver, SlopeField, imls, schedule
from bsface.surface.bspline import basis_matrix
from bsface.surface.prior import shape_prior
from domes import PictureOfADome, bumped, dome, relief
from few_modes import few_modes
from joint_waves import SHAPE
from scipy import sparse


@pytest.fixture(scope="module")
def template():
    return few_modes(SHAPE, identity=3, expression=1)


@pytest.fixture(scope="module")
def prior(template):
    return shape_prior(template, 1.0, 0.5, 1.0, 0.2)


def scene(template, prior, surface, photos=10):
    """The dome under several lights, and an estimate that stands at ``surface``."""
    rng = np.random.default_rng(4)
    view = Camera(np.eye(3), 1.5, (0, 0), 0.0, (200, 200))
    pictures = []
    for _ in range(photos):
        light = np.zeros(9)
        light[0], light[1:4] = 0.8, rng.normal(0, 0.25, 3) + (0, 0, 0.3)
        pictures.append(PictureOfADome(view, light))
    index = np.flatnonzero(template.landmark_reliable)[::20]
    uv = template.landmark_uv[index]
    structure = surface.evaluate(*uv.T)
    pixels = np.stack([view.project(structure)] * photos)
    landmarks = LandmarkObservations(
        pixels, np.ones(pixels.shape[:2]), index, uv, np.zeros((photos, 2))
    )
    collection = PhotoCollection(tuple(range(photos)), ())
    problem = Problem(collection, template, prior, landmarks, Settings())
    estimate = FaceEstimate(
        surface=surface,
        cameras=(view,) * photos,
        landmarks_xyz=structure,
        expressions=np.zeros((photos, 1)),
        modes=np.zeros(len(prior.modes)),
        smooth=np.zeros((len(surface.vector), 3)),
        photo_weights=np.ones(photos),
    )
    return problem, estimate, lambda photo, camera, blur_mm: pictures[photo]


def test_slopes_are_the_normal_that_they_stand_for():
    """``delta_u = -F_u . h``, and the metric turns slopes into the angle."""
    surface = dome()
    uv = sample_uv()
    T1, T2 = (basis_matrix(SHAPE, *uv.T, *k) for k in ((1, 0), (0, 1)))
    fu, fv = T1 @ surface.vector, T2 @ surface.vector
    change = 1e-4 * np.random.default_rng(0).normal(size=(len(surface.vector), 3))
    moved = surface.vector + change
    h = np.cross(T2 @ moved, T1 @ moved)
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    asked = -np.stack([(fu * h).sum(1), (fv * h).sum(1)], 1)
    normals = surface.normals(*uv.T)
    along = [((t @ (moved - surface.vector)) * normals).sum(1) for t in (T1, T2)]
    np.testing.assert_allclose(asked, np.stack(along, 1), atol=1e-7)
    g = np.stack(contravariant(fu, fv), 1)
    metric = np.einsum("pax,pbx->pab", g, g)
    angle = np.linalg.norm(h - normals, axis=1)
    field = SlopeField(asked, metric, metric, np.zeros(len(uv)))
    length = np.sqrt(np.einsum("pa,pab,pb->p", asked, metric, asked))
    np.testing.assert_allclose(length, angle, rtol=1e-3)
    expected = np.degrees(np.sqrt((angle**2).mean()))
    assert field.rms_degrees() == pytest.approx(expected, rel=1e-3)


def sample_uv():
    x = np.linspace(0.1, 0.9, 9)
    return np.stack(np.meshgrid(x, x, indexing="ij"), -1).reshape(-1, 2)


def test_shape_solver_is_the_dense_system(template, prior):
    problem, estimate, _ = scene(template, prior, dome(), 2)
    model = DisplacementModel.about(problem, estimate)
    uv = np.random.default_rng(1).uniform(0, 1, (30, 2))
    T = basis_matrix(SHAPE, *uv.T)
    S = sparse.csr_array(T.T @ T)
    force = np.random.default_rng(2).normal(size=len(model.D))
    step = ShapeSolver(S, model)(force, 2)
    # unknowns (dd, da); the data see dd + D da
    both = np.hstack([np.eye(len(force)), model.D])
    own = np.zeros((both.shape[1],) * 2)
    own[: len(force), : len(force)] = 0.5 * prior.along_normals.toarray()
    own[len(force) :, len(force) :] = 0.5 * np.eye(model.D.shape[1])
    expected = np.linalg.solve(both.T @ S.toarray() @ both + own, both.T @ force)
    np.testing.assert_allclose(
        np.concatenate([step.smooth, step.modes]), expected, atol=1e-8
    )


def test_surface_comes_back(template):
    """The truth stays, and from a wrong surface the way leads back to it."""
    options = JointOptions(
        (), landmark_weight=0.0, noise=0.03, independence=1.0, shadows=False
    )
    # a prior that allows for the bump
    prior = shape_prior(template, 0.0, 0.0, 30.0, 0.1)
    uv = sample_grid(template, 14)

    def last(begin, passes):
        levels = (Level(3.0, passes, 14, 6),)
        problem, estimate, reader = scene(template, prior, begin)
        parts = JointParts(reader, skin=())
        passes = replace(options, levels=levels)
        *_, end = imls(problem, estimate, never_cancelled, parts, passes)
        return end.estimate.surface

    assert relief(last(dome(), 2), dome(), uv) < 0.3
    begin = bumped(dome(), 8.0)
    assert relief(begin, dome(), uv) > 0.4
    assert relief(last(begin, 10), dome(), uv) < 0.5 * relief(begin, dome(), uv)


def test_iterations_are_those_of_the_table_of_methods(template, prior):
    problem, begin, reader = scene(template, prior, bumped(dome(), 8.0), 4)
    raised = replace(begin, landmarks_xyz=begin.landmarks_xyz + (0, 0, 2.0))
    levels = (Level(3.0, 1, 8, 2), Level(2.0, 2, 9, 2))
    parts = JointParts(reader, skin=())
    options = JointOptions(levels, max_step_mm=0.5)
    found = list(imls(problem, raised, never_cancelled, parts, options))
    assert [one.stage for one in found] == ["shading", "motion"] * 3
    assert [(one.done, one.total) for one in found] == [(k, 6) for k in range(1, 7)]
    for one in found:
        on = one.estimate.surface.evaluate(*problem.landmarks.uv.T)
        away = one.estimate.landmarks_xyz - on
        np.testing.assert_allclose(away, [[0, 0, 2.0]] * len(on))
        assert 0 <= one.residual < 90
        # Eq. 6 and Eq. 7 may take a step each
        assert one.step_mm <= 1.0 + 1e-9
    *early, last = [one.estimate for one in found]
    assert all(e.photometric is None for e in early)
    assert last.photometric.lights.shape == (4, 9)


def test_passes_follow_the_settings():
    levels = schedule(JointOptions.from_settings(Settings()), 2).levels
    assert [level.iterations for level in levels] == [4, 4, 6]
