"""The joint system: elimination, landmarks and step, against dense matrices."""

from dataclasses import replace

import numpy as np
import pytest
import reference
from bsface.camera.camera import PARAMETERS
from bsface.solve.expression import expression_offsets
from bsface.solve.joint.linearise import Linearisation
from bsface.solve.joint.options import JointOptions, Level
from bsface.solve.joint.samples import Samples
from bsface.solve.joint.state import DisplacementModel, State
from bsface.solve.joint.system import BorderedSystem, assemble
from bsface.solve.joint.terms import LandmarkTerm
from bsface.surface.bspline import basis_matrix
from joint_dense import dense_rows, dense_system, full_system
from joint_waves import (
    PHOTOS,
    SHAPE,
    cameras,
    directions,
    iterations,
    plane,
    start,
    wave,
)


def random_rows(template, prior, hidden=(), n=3, p=40, q=4):
    """A linearisation of noise, and a state that it may belong to."""
    rng = np.random.default_rng(0)
    u, v = rng.random((2, p))
    T = [basis_matrix(SHAPE, u, v, *k) for k in ((0, 0), (1, 0), (0, 1))]
    W = np.abs(rng.normal(size=(n, p)))
    W[:, list(hidden)] = 0
    rows = Linearisation(
        samples=Samples(None, np.stack([u, v], 1), T, np.ones(p), [], None),
        residual=rng.normal(size=(n, p)),
        precision=W,
        by_displacement=rng.normal(size=(3, n, p)),
        by_motion=rng.normal(size=(n, PARAMETERS, p)),
        harmonics=rng.normal(size=(n, p, q)),
        albedo=0.5 + rng.random(p),
        shading=rng.normal(size=(n, p)),
    )
    problem, estimate = start(template, prior, plane(), cameras(n))
    model = DisplacementModel.about(problem, estimate)
    state = State.start(model, estimate.cameras)
    return rows, replace(state, lights=np.zeros((n, q)))


def test_albedo_is_eliminated_exactly(template, prior):
    """The blocks are the Schur complement of the system that keeps the albedo."""
    rows, state = random_rows(template, prior)
    A, g = dense_system(assemble(rows, state, ()))
    expected, right = reference.schur_complement(*dense_rows(rows), len(A))
    np.testing.assert_allclose(A, expected, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(g, right, atol=1e-9 * np.abs(right).max())


def test_products_with_the_border_are_symmetric(template, prior):
    """What photos do to the face, the face does to the photos."""
    rows, state = random_rows(template, prior)
    border = assemble(rows, state, ()).border
    rng = np.random.default_rng(1)
    z = rng.normal(size=(3, border.size))
    d = rng.normal(size=len(state.smooth))
    there = d @ border.to_shape(border.sums(z))
    back = (z * border.to_photos(d)).sum()
    assert there == pytest.approx(back, rel=1e-12)


def test_albedo_that_is_known_takes_nothing_up(template, prior):
    rows, state = random_rows(template, prior)
    A, g = dense_system(assemble(rows._replace(albedo_precision=1e15), state, ()))
    expected, right = dense_rows(rows)
    expected, right = expected[: len(A), : len(A)], right[: len(A)]
    np.testing.assert_allclose(A, expected, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(g, right, atol=1e-9 * np.abs(right).max())


def test_points_that_no_photo_sees_add_nothing(template, prior):
    rows, state = random_rows(template, prior, hidden=(0, 7, 8))
    keep = np.flatnonzero(rows.precision.any(0))
    T = [t[keep] for t in rows.samples.T]
    fewer = rows._replace(
        samples=rows.samples._replace(T=T),
        residual=rows.residual[:, keep],
        precision=rows.precision[:, keep],
        by_displacement=rows.by_displacement[..., keep],
        by_motion=rows.by_motion[..., keep],
        harmonics=rows.harmonics[:, keep],
        albedo=rows.albedo[keep],
        shading=rows.shading[:, keep],
    )
    one = dense_system(assemble(rows, state, ()))
    two = dense_system(assemble(fewer, state, ()))
    for a, b in zip(one, two, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)


def test_step_is_that_of_the_dense_system(case, prior):
    """Without any elimination, with the albedo among the unknowns: the same step."""
    _, one, residual, surface = case
    n, ways, state = PHOTOS, directions(surface), one.state
    A, g, border = full_system(one, prior, JointOptions(()))
    x = np.linalg.solve(A, g)
    D = one.before.model.D
    size, count = D.shape
    total = x[:size] + D @ x[size : size + count]
    assert np.abs(total).max() > 1e-3
    near = dict(rtol=1e-5, atol=1e-6 * np.abs(x).max())
    np.testing.assert_allclose(
        state.surface.vector, surface.vector + total[:, None] * ways, **near
    )
    np.testing.assert_allclose(state.modes, x[size : size + count], **near)
    own = x[border].reshape(n, -1)
    _, expressions, lights = np.split(own, [PARAMETERS, one.before.motions], axis=1)
    np.testing.assert_allclose(state.lights, one.before.lights + lights, **near)
    expressions = one.before.expressions + expressions
    np.testing.assert_allclose(state.expressions, expressions, **near)
    points = np.random.default_rng(0).normal(0, 50, (5, 3))
    for camera, old, step in zip(state.cameras, residual.views, own, strict=True):
        expected = old.moved(step[:PARAMETERS])
        np.testing.assert_allclose(
            camera.project(points), expected.project(points), atol=1e-3
        )


def test_no_photo_is_preferred(template, prior):
    """The step is the same for another order, however early the gradients stop."""
    views, pictures = cameras(), [wave(k) for k in range(PHOTOS)]
    options = JointOptions((Level(3.0, 1, 14, 6),), max_step_mm=1e9, tolerance=0.1)
    found = []
    for order in (1, -1):
        problem, estimate = start(template, prior, template.surface, views[::order])
        own = 1.5 * np.arange(PHOTOS)[::order, None]
        begin = replace(estimate, expressions=own)
        (one,) = iterations(problem, begin, pictures[::order], options)
        found.append(one.state.surface.vector)
    size = np.abs(found[0] - template.surface.vector).max()
    np.testing.assert_allclose(found[0], found[1], atol=1e-9 * size)


def test_landmark_term(template, prior):
    """Against numerical derivatives of the reprojection with frozen weights."""
    surface, views = plane(), cameras()
    problem, estimate = start(template, prior, surface, views, 1.5)
    model = DisplacementModel.about(problem, estimate)
    marks = problem.landmarks
    rng = np.random.default_rng(0)
    T, ways = basis_matrix(SHAPE, *marks.uv.T), directions(surface)
    on = surface.evaluate(*marks.uv.T)
    offset = rng.normal(0, 2, on.shape)
    modes = expression_offsets(template, marks.uv, 1)
    own = model.expressions
    pixels = np.stack(
        [c.project(on + offset + modes @ e) for c, e in zip(views, own, strict=True)]
    )
    pixels += rng.normal(0, 3, pixels.shape)
    seen = replace(marks, pixels=pixels, weight=rng.random(pixels.shape[:2]))
    sigma, weight = 1.5, 0.3
    state = State.start(model, estimate.cameras)
    system = BorderedSystem(replace(state, lights=np.zeros((PHOTOS, 4))))
    LandmarkTerm(seen, offset, modes, T, sigma, weight).add_to(system)
    motions, size = PARAMETERS + 1, len(ways)
    m = motions + 4

    def residual(i, e):
        d, step = e[:size], e[size:]
        b = surface.vector + d[:, None] * ways
        c = views[i].moved(step[:PARAMETERS])
        Q = T @ b + offset + modes @ (own[i] + step[PARAMETERS:])
        return ((seen.pixels[i] - c.project(Q)) / views[i].s).ravel()

    expected_A = np.zeros((size + 3 * m, size + 3 * m))
    expected_g = np.zeros(size + 3 * m)
    for i, c in enumerate(views):
        r = residual(i, np.zeros(size + motions))
        J = reference.numerical_derivative(
            lambda e, i=i: residual(i, e), size + motions, 1e-5
        )
        facing = np.clip((c.toward(on)[:, 2] - 0.1) / 0.3, 0, 1)
        w = weight * seen.weight[i] * facing / sigma**2
        w = w / (1 + (r.reshape(-1, 2) ** 2).sum(1) / (3 * sigma) ** 2)
        w = np.repeat(w, 2)
        at = np.r_[:size, size + i * m : size + i * m + motions]
        expected_A[np.ix_(at, at)] += J.T @ (w[:, None] * J)
        expected_g[at] -= J.T @ (w * r)
    A, g = dense_system(system)
    np.testing.assert_allclose(A, expected_A, atol=1e-5 * np.abs(expected_A).max())
    np.testing.assert_allclose(g, expected_g, atol=1e-5 * np.abs(expected_g).max())
