"""The joint system: its derivative rows, its elimination, its step, its fixed point.

The photos are analytic waves, so value and gradient are exact at any place, and the
residual can be differentiated numerically. The surface is a plane, where the linear
model of a displacement along the normals is exact, or the template, where it is not.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import reference
from bsface.camera.camera import PARAMETERS, Camera
from bsface.landmarks.observations import LandmarkObservations
from bsface.photometry import harmonics
from bsface.photometry.lighting import NOISE_RANGE
from bsface.problem import Constraint, FaceEstimate, PhotoCollection, Problem
from bsface.progress import never_cancelled
from bsface.settings import Settings
from bsface.solve.expression import expression_offsets
from bsface.solve.joint.linearise import Linearisation
from bsface.solve.joint.marginal import displacement_deviation
from bsface.solve.joint.method import MODEL_ERROR_MM, joint, model_error
from bsface.solve.joint.options import JointOptions, Level
from bsface.solve.joint.refine import (
    OVER_RELAXATION,
    JointParts,
    Refinement,
    refine,
    relaxation,
)
from bsface.solve.joint.samples import Samples, sample_grid
from bsface.solve.joint.state import DisplacementModel, State
from bsface.solve.joint.system import BorderedSystem, assemble
from bsface.solve.joint.terms import LandmarkTerm, default_terms
from bsface.surface.bspline import BSplineSurface, basis_matrix
from bsface.surface.prior import shape_prior
from bsface.surface.template import load_template
from few_modes import few_modes
from scipy.spatial.transform import Rotation

SHAPE = (8, 9)
PHOTOS = 3


@dataclass(frozen=True)
class Wave:
    """A picture given by a formula: a sum of plane waves."""

    k: np.ndarray
    phase: np.ndarray
    size: float = 0.05

    def value(self, xy):
        return 0.6 + self.size * np.sin(xy @ self.k.T + self.phase).sum(1)

    def read(self, xy):
        slope = self.size * np.cos(xy @ self.k.T + self.phase) @ self.k
        return self.value(xy)[:, None], slope[:, None], np.ones(len(xy), bool)

    def around(self, xy, margin):
        return self


def wave(seed):
    rng = np.random.default_rng(seed)
    return Wave(rng.normal(0, 0.03, (4, 2)), rng.uniform(0, 6, 4))


@pytest.fixture(scope="module")
def template():
    return few_modes(SHAPE, identity=3, expression=1)


@pytest.fixture(scope="module")
def prior(template):
    return shape_prior(template, 1.0, 0.5, 1.0, 0.2)


def plane():
    corners = {(0, 0): (-70, 90, 5), (1, 0): (140, 0, 0), (0, 1): (0, -190, 0)}
    return BSplineSurface(reference.polynomial_control_points(SHAPE, corners))


def cameras(count=PHOTOS, spread=25, kappa=1 / 900):
    rng = np.random.default_rng(7)
    out = []
    for _ in range(count):
        angles = rng.uniform(-spread, spread, 3) * (1, 0.6, 0.3)
        R = Rotation.from_euler("yxz", angles, degrees=True).as_matrix()
        out.append(Camera(R, 1.5, rng.normal(0, 9, 2), kappa, (200, 200)))
    return out


def directions(surface):
    """Normals at the Greville abscissae: the ways in which control points move."""
    g = [np.clip((np.arange(c) - 1.0) / (c - 3), 0, 1) for c in surface.shape]
    return surface.normals(*np.meshgrid(*g, indexing="ij")).reshape(-1, 3)


def given(pictures):
    """A reader of photos whose place in the list is their picture."""
    return lambda photo, camera, blur_mm: pictures[photo]


def start(template, prior, surface, views, expression=0.0, constraint=None):
    """A problem, an estimate that stands at ``surface`` and agrees with landmarks."""
    index = np.flatnonzero(template.landmark_reliable)[::20]
    uv = template.landmark_uv[index]
    structure = surface.evaluate(*uv.T)
    pixels = np.stack([c.project(structure) for c in views])
    n = len(views)
    landmarks = LandmarkObservations(
        pixels, np.ones(pixels.shape[:2]), index, uv, np.zeros((n, 2))
    )
    photos = PhotoCollection(tuple(range(n)), ())
    problem = Problem(photos, template, prior, landmarks, Settings(), constraint)
    estimate = FaceEstimate(
        surface=surface,
        cameras=tuple(views),
        landmarks_xyz=structure,
        expressions=expression * np.arange(n)[:, None],
        modes=np.zeros(len(prior.modes)),
        smooth=np.zeros((len(surface.vector), 3)),
        photo_weights=np.ones(n),
    )
    return problem, estimate


def iterations(problem, estimate, pictures, options):
    """The joint method on analytic pictures, with all that its steps were made of."""
    model = DisplacementModel.about(problem, estimate)
    terms = default_terms(problem, estimate, model, options)
    work = Refinement(
        problem.photos,
        estimate.photo_weights,
        options,
        terms,
        JointParts(reader=given(pictures)),
    )
    return refine(State.start(model, estimate.cameras), work, never_cancelled)


def first_step(template, prior, surface, views, pictures, expression=0.0):
    """One iteration on analytic pictures, without landmarks."""
    options = JointOptions(
        (Level(3.0, 1, 14, 6),), landmark_weight=0, max_step_mm=1e9, tolerance=1e-9
    )
    problem, estimate = start(template, prior, surface, views, expression)
    (one,) = iterations(problem, estimate, pictures, options)
    return one


class Residual:
    """``r_ij`` as a function of everything that it depends on, from the definition."""

    def __init__(self, one, surface, pictures):
        self.one, self.surface, self.pictures = one, surface, pictures
        self.views = one.before.cameras
        self.samples = one.rows.samples
        raw = self.photos(surface, self.views)
        self.scale = np.median(raw / one.readings.values, 1, keepdims=True)

    def faces(self, surface, expressions=None):
        before = self.one.before
        expressions = before.expressions if expressions is None else expressions
        modes, b = before.model.expression_modes, surface.control_points
        if not len(modes):
            return [surface] * PHOTOS
        return [BSplineSurface(b + np.tensordot(e, modes, 1)) for e in expressions]

    def photos(self, surface, views, expressions=None):
        faces = self.faces(surface, expressions)
        parts = zip(self.pictures, views, faces, strict=True)
        uv = self.samples.uv
        return np.stack([p.value(c.project(f.evaluate(*uv.T))) for p, c, f in parts])

    def __call__(
        self, surface=None, views=None, lights=None, albedo=None, expressions=None
    ):
        surface = self.surface if surface is None else surface
        lights = self.one.before.lights if lights is None else lights
        albedo = self.one.before.albedo if albedo is None else albedo
        views = self.views if views is None else views
        uv, transfer = self.samples.uv, self.samples.transfer
        shading = np.stack(
            [
                transfer.basis(f.normals(*uv.T)) @ light
                for f, light in zip(
                    self.faces(surface, expressions), lights, strict=True
                )
            ]
        )
        values = self.photos(surface, views, expressions) / self.scale
        return values - albedo * shading


@pytest.fixture(scope="module", params=["plane", "template", "expressions"])
def case(request, template, prior):
    """A plane, the template, or the template with another expression in each photo."""
    surface = plane() if request.param == "plane" else template.surface
    own = 1.5 if request.param == "expressions" else 0.0
    views, pictures = cameras(), [wave(k) for k in range(PHOTOS)]
    one = first_step(template, prior, surface, views, pictures, own)
    return request.param, one, Residual(one, surface, pictures), surface


# --- the rows ------------------------------------------------------------------------


def test_residual_is_the_one_of_the_definition(case):
    _, one, residual, _ = case
    np.testing.assert_allclose(residual(), one.rows.residual, atol=1e-9)


def row_errors(one, residual, surface, every):
    """Relative error of the rows of some control points, against the definition."""
    ways, errors, rows = directions(surface), [], one.rows
    used = np.flatnonzero(np.abs(rows.samples.T[0].toarray()).sum(0) > 0.5)
    for k in used[::every]:

        def moved(e, k=k):
            b = surface.vector.copy()
            b[k] += e[0] * ways[k]
            return residual(BSplineSurface(b.reshape(*surface.shape, 3)))

        expected = reference.numerical_derivative(moved, 1, 1e-4)[..., 0]
        T = [t[:, [k]].toarray()[:, 0] for t in rows.samples.T]
        found = sum(rows.by_displacement[a] * T[a] for a in range(3))
        errors.append(np.linalg.norm(found - expected) / np.linalg.norm(expected))
    return errors


def test_rows_of_the_displacement(case):
    """Moving a control point along its direction changes the residual as T c says.

    On the template the directions of neighbours differ, so the model is coarse there.
    """
    kind, one, residual, surface = case
    errors = row_errors(one, residual, surface, 5)
    assert np.median(errors) < (1e-4 if kind == "plane" else 0.3)


def test_rows_of_a_curved_surface_get_better_with_the_net(template):
    medians = []
    views, pictures = cameras(), [wave(k) for k in range(PHOTOS)]
    for shape in (SHAPE, (14, 16)):
        finer = load_template() if shape != SHAPE else template
        finer = replace(
            finer,
            identity_modes=finer.identity_modes[:1],
            expression_modes=finer.expression_modes[:1],
        ).resampled(shape)
        prior = shape_prior(finer, 1.0, 0.5, 1.0, 0.2)
        one = first_step(finer, prior, finer.surface, views, pictures)
        residual = Residual(one, finer.surface, pictures)
        medians.append(np.median(row_errors(one, residual, finer.surface, 7)))
    assert medians[1] < 0.5 * medians[0]
    assert medians[1] < 0.1


def test_rows_of_the_cameras_and_expressions(case):
    kind, one, residual, _ = case
    count = one.before.motions
    assert count == PARAMETERS + (kind == "expressions")
    for i in range(PHOTOS):

        def moved(e, i=i):
            views, own = list(residual.views), one.before.expressions.copy()
            views[i] = views[i].moved(e[:PARAMETERS])
            own[i] += e[PARAMETERS:]
            return residual(views=views, expressions=own)

        expected = reference.numerical_derivative(moved, count, 1e-5)
        found = np.zeros_like(expected)
        found[i] = one.rows.by_photo(i)[:, :count]
        np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


def test_rows_of_the_lights_and_of_the_albedo(case):
    _, one, residual, _ = case
    known, albedo = one.before.lights, one.before.albedo
    for i in range(PHOTOS):

        def moved(e, i=i):
            lights = known.copy()
            lights[i] += e
            return residual(lights=lights)

        expected = reference.numerical_derivative(moved, known.shape[1], 1e-3)
        found = one.rows.by_photo(i)[:, one.before.motions :]
        np.testing.assert_allclose(found, expected[i], atol=1e-8)
        assert np.abs(np.delete(expected, i, 0)).max() == 0
    slope = residual(albedo=albedo + 1e-3) - residual(albedo=albedo - 1e-3)
    np.testing.assert_allclose(one.rows.shading, -slope / 2e-3, atol=1e-9)


# --- the elimination and the step ----------------------------------------------------


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


def dense_rows(rows):
    """Normal matrix and right side with the albedo among the unknowns."""
    n = len(rows.residual)
    T = [t.toarray() for t in rows.samples.T]
    h = np.stack([rows.by_photo(i) for i in range(n)])
    return reference.dense_gauss_newton(
        T,
        np.moveaxis(rows.by_displacement, 0, 2),
        h,
        rows.shading,
        rows.precision,
        rows.residual,
    )


def dense_system(system):
    """Matrix and right side of displacement and photos, without the shape's prior.

    Formed column by column out of the products that are never formed otherwise.
    """
    size, (n, m) = len(system.right), system.photo_right.shape
    A = np.zeros((size + n * m, size + n * m))
    if system.precision:
        A[:size, :size] = sum(system.precision[1:], system.precision[0]).toarray()
    lights = np.zeros((size, n, m - system.state.motions))
    A[:size, size:] = np.concatenate([system.coupling, lights], 2).reshape(size, -1)
    for i in range(n):
        at = slice(size + i * m, size + (i + 1) * m)
        A[at, at] = system.photo_precision[i]
    if system.border is not None:
        A[:size, :size] += system.border.displacement_precision().toarray()
        for i in range(n):
            at = slice(size + i * m, size + (i + 1) * m)
            A[at, at] += system.border.photo_blocks[i]
        for k, z in enumerate(np.eye(n * m).reshape(-1, n, m), start=size):
            sums = system.border.sums(z)
            A[:size, k] += system.border.to_shape(sums)
            nothing = np.zeros(size)
            A[size:, k] -= system.border.to_photos(nothing, sums[3]).ravel()
    A[size:, :size] = A[:size, size:].T
    return A, np.concatenate([system.right, system.photo_right.ravel()])


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


def full_system(one, prior, options):
    """All unknowns at once: displacement, modes, photos, albedo; right side too."""
    n, motions = len(one.before.cameras), one.before.motions
    m = motions + one.before.lights.shape[1]
    D = one.before.model.D
    size, count = D.shape
    A, g = dense_rows(one.rows)
    # the modes move the same displacement: columns [I D]
    change = np.zeros((len(A), len(A) + count))
    change[:size, :size], change[:size, size : size + count] = np.eye(size), D
    change[size:, size + count :] = np.eye(len(A) - size)
    A, g = change.T @ A @ change, change.T @ g
    # nothing is known of the albedo of a point that no photo sees
    A += np.diag(1.0 * (np.diag(A) == 0))
    A[:size, :size] += prior.along_normals.toarray()
    A[size : size + count, size : size + count] += np.eye(count)
    border = slice(size + count, size + count + n * m)
    known = np.full((n, m), options.light_damping)
    known[:, :6] = options.camera_damping
    known[:, 6] = 1 / options.distance_spread**2
    known[:, PARAMETERS:motions] = 1 / options.expression_spread**2
    A[border, border] += np.diag(known.ravel())
    for i, camera in enumerate(one.before.cameras):
        away = np.log(camera.kappa * options.distance_mm)
        g[size + count + i * m + 6] -= away / options.distance_spread**2
    return A, g, border


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


def dense_deviation(one, prior):
    A, _, _ = full_system(one, prior, JointOptions(()))
    D = one.before.model.D
    pick = np.zeros((len(D), len(A)))
    pick[:, : len(D)], pick[:, len(D) : sum(D.shape)] = np.eye(len(D)), D
    return np.sqrt(np.diag(pick @ np.linalg.inv(A) @ pick.T))


def test_deviation_is_the_diagonal_of_the_dense_covariance(case, prior):
    """Here splines span the albedo of all samples, so nothing is left out."""
    _, one, _, _ = case
    np.testing.assert_allclose(
        one.system.deviation(), dense_deviation(one, prior), rtol=1e-3
    )


def test_deviation_with_an_albedo_that_splines_do_not_span(case, prior):
    _, one, _, _ = case
    ratio = displacement_deviation(one.system, 4) / dense_deviation(one, prior)
    assert 0.8 < ratio.min() <= ratio.max() < 1.2
    assert abs(np.median(ratio) - 1) < 0.05


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


# --- how sure it is -------------------------------------------------------------------


def test_what_the_matrix_cannot_know_grows_with_the_noise_of_mixed_expressions():
    noise = 0.06 * np.array([[0.5], [1.5], [2.5]])
    assert model_error(noise, 0.06, mixed=False) == MODEL_ERROR_MM
    found = model_error(noise, 0.06, mixed=True)
    assert found > MODEL_ERROR_MM
    assert model_error(2 * noise, 0.06, mixed=True) == pytest.approx(4 * found)
    assert model_error(2 * noise, 0.12, mixed=True) == pytest.approx(found)
    assert model_error(0.001, 0.06, mixed=True) == MODEL_ERROR_MM


# --- the iteration -------------------------------------------------------------------


class Formula:
    """A picture whose gradient is taken numerically."""

    def read(self, xy):
        slope = reference.numerical_derivative(lambda e: self.value(xy + e), 2, 1e-3)
        return self.value(xy)[:, None], slope[:, None], np.ones(len(xy), bool)

    def around(self, xy, margin):
        return self


@dataclass(frozen=True)
class PictureOfAPlane(Formula):
    """What a camera sees of a textured plane under one light."""

    camera: Camera
    texture: Wave
    shading: float

    def value(self, xy):
        # the ray through a pixel meets z = 5: three linear equations
        c = self.camera
        x, y = (xy - c.principal).T[:, :, None]
        rows = np.stack(
            [
                c.s * c.R[0] + x * c.kappa * c.R[2],
                -c.s * c.R[1] + y * c.kappa * c.R[2],
                np.broadcast_to((0.0, 0, 1), (len(xy), 3)),
            ],
            1,
        )
        right = np.concatenate([x - c.t[0], y - c.t[1], np.full_like(x, 5)], 1)
        at = np.linalg.solve(rows, right[..., None])[:, :2, 0]
        return self.texture.value(at) * self.shading


@dataclass(frozen=True)
class PictureOfADome(Formula):
    """What a frontal camera sees of a shaded dome of one colour."""

    camera: Camera
    light: np.ndarray

    def value(self, xy):
        x, y = ((xy - self.camera.principal) / self.camera.s).T
        u, v = np.clip([(x + 70) / 140, (90 + y) / 190], 0, 1)
        return harmonics.basis(dome().normals(u, v)) @ self.light


def dome():
    """x and y as on the plane, z a paraboloid: known normals, known parameters."""
    corners = {(0, 0): (-70, 90, 0), (1, 0): (140, 0, 200), (2, 0): (0, 0, -200)}
    more = {(0, 1): (0, -190, 220), (0, 2): (0, 0, -220)}
    return BSplineSurface(reference.polynomial_control_points(SHAPE, corners | more))


def bumped(surface, height):
    """The surface with a bump in its middle, too narrow to be taken for a light."""
    b = surface.control_points.copy()
    b[SHAPE[0] // 2, SHAPE[1] // 2, 2] += height
    return BSplineSurface(b)


def relief(surface, truth, uv):
    """Size of what is left of the error in z without its smooth part, mm.

    Photos leave a smooth part open: it belongs to cameras, lights and albedo.
    """
    error = (surface.evaluate(*uv.T) - truth.evaluate(*uv.T))[:, 2]
    u, v = uv.T
    smooth = np.stack([u**i * v**j for i in range(4) for j in range(4 - i)], 1)
    rest = error - smooth @ np.linalg.lstsq(smooth, error, rcond=None)[0]
    return np.sqrt((rest**2).mean())


def textured_plane():
    """Five views of a pattern: it tells by its shift between the photos."""
    views = cameras(5, spread=40)
    rng = np.random.default_rng(3)
    pattern = Wave(rng.normal(0, 0.25, (6, 2)), rng.uniform(0, 6, 6))
    pictures = [PictureOfAPlane(c, pattern, 0.4 + 0.2 * i) for i, c in enumerate(views)]
    return plane(), views, pictures


def shaded_dome():
    """One view under ten lights, no texture: it tells by its shading."""
    rng = np.random.default_rng(4)
    views = [Camera(np.eye(3), 1.5, (0, 0), 0.0, (200, 200))] * 10
    pictures = []
    for c in views:
        light = np.zeros(9)
        light[0], light[1:4] = 0.8, rng.normal(0, 0.25, 3) + (0, 0, 0.3)
        pictures.append(PictureOfADome(c, light))
    return dome(), views, pictures


@pytest.mark.parametrize("scene", [textured_plane, shaded_dome])
def test_surface_comes_back(template, scene):
    """The truth stays, and from a wrong surface the way leads back to it."""
    truth, views, pictures = scene()
    options = JointOptions(
        (Level(3.0, 8, 16, 6),),
        landmark_weight=0.0,
        noise=0.03 / NOISE_RANGE[0],  # of perfect pictures: 0.03
        independence=1.0,
        shadows=False,
    )
    # a prior that allows for the bump
    prior = shape_prior(template, 0.0, 0.0, 30.0, 0.1)
    uv = sample_grid(template, 16)
    *_, last = iterations(*start(template, prior, truth, views), pictures, options)
    assert relief(last.state.surface, truth, uv) < 0.3
    begin = bumped(truth, 8.0)
    found = list(iterations(*start(template, prior, begin, views), pictures, options))
    before = relief(begin, truth, uv)
    assert before > 0.4
    assert relief(found[-1].state.surface, truth, uv) < 0.35 * before
    assert found[-1].residual < 0.5 * found[0].residual


def test_no_step_is_larger_than_allowed(template, prior):
    views, pictures = cameras(), [wave(k) for k in range(PHOTOS)]
    options = JointOptions((Level(3.0, 3, 12, 6),), max_step_mm=0.05)
    problem, begin = start(template, prior, plane(), views)
    before = begin.surface
    uv = sample_grid(template, 12)
    for one in iterations(problem, begin, pictures, options):
        after = one.state.surface
        away = after.evaluate(*uv.T) - before.evaluate(*uv.T)
        assert np.abs(away).max() < 0.051
        assert one.step_mm <= 0.05 + 1e-12
        before = after


@pytest.mark.parametrize(
    "settled, turns", [(1e9, [1, 1, 1, 2, 3]), (0.0, [1, 2, 1, 2, 1, 2, 3])]
)
def test_coarse_levels_end_when_they_are_settled(template, prior, settled, turns):
    """The last level takes all its steps; each has the harmonics of its degree."""
    views, pictures = cameras(), [wave(k) for k in range(PHOTOS)]
    levels = (
        Level(3.0, 2, 8, 2, settled),
        Level(2.0, 2, 9, 2, settled),
        Level(1.0, 3, 10, 3),
    )
    begin = start(template, prior, plane(), views)
    found = list(iterations(*begin, pictures, JointOptions(levels)))
    assert [one.turn for one in found] == turns
    assert [one.level for one in found] == sorted(one.level for one in found)
    for one in found:
        assert one.state.lights.shape[1] == (16 if one.level == 2 else 9)


def test_schedule_of_the_settings():
    levels = JointOptions.from_settings(Settings()).levels
    assert [level.blur_mm for level in levels] == pytest.approx([3.0, 1.52, 0.8])
    assert [level.iterations for level in levels] == [15, 10, 5]
    assert [level.degree for level in levels] == [4, 4, 6]
    assert [level.settled_mm > 0 for level in levels] == [True, True, False]
    few = JointOptions.from_settings(Settings(light_degree=2)).levels
    assert [level.degree for level in few] == [2, 2, 2]


def test_method_yields_estimates_of_the_face(template, prior):
    """Landmarks keep their offset; evidence and deviation come with the last one."""
    views, pictures = cameras(), [wave(k) for k in range(PHOTOS)]
    problem, begin = start(template, prior, plane(), views)
    raised = replace(begin, landmarks_xyz=begin.landmarks_xyz + (0, 0, 2.0))
    levels = (Level(3.0, 3, 8, 2, settled_mm=1e9), Level(2.0, 2, 9, 2))
    parts = JointParts(JointOptions(levels), given(pictures), skin=())
    found = list(joint(problem, raised, never_cancelled, parts))
    assert [(one.stage, one.done, one.total) for one in found] == [
        ("refine", 1, 5),
        ("refine", 4, 5),
        ("refine", 5, 5),
    ]
    for one in found:
        estimate = one.estimate
        on = estimate.surface.evaluate(*problem.landmarks.uv.T)
        np.testing.assert_allclose(estimate.landmarks_xyz - on, [[0, 0, 2.0]] * len(on))
        moved = estimate.smooth + np.einsum("k,kbx->bx", estimate.modes, prior.modes)
        ways = directions(begin.surface)
        total = ((estimate.surface.vector - begin.surface.vector) * ways).sum(1)
        np.testing.assert_allclose((moved * ways).sum(1), total, atol=1e-9)
    *early, last = [one.estimate for one in found]
    assert all(e.photometric is None and e.deviation is None for e in early)
    assert last.deviation.shape == SHAPE
    evidence = last.photometric
    assert evidence.lights.shape == (PHOTOS, 9)
    assert evidence.weights.shape == (PHOTOS, len(evidence.uv))


def test_cancelled_between_the_parts_of_a_step(template, prior):
    """Each call may stop the run: photos, and seven parts of a step."""
    views, pictures = cameras(), [wave(k) for k in range(PHOTOS)]
    problem, begin = start(template, prior, plane(), views)
    options = JointOptions((Level(3.0, 2, 8, 2),))
    parts = JointParts(options, given(pictures), skin=())

    class Stopped(Exception):
        pass

    def stop_at(call):
        calls = iter(range(call + 1))

        def check_cancelled():
            if next(calls) == call:
                raise Stopped

        return check_cancelled

    for call in range(PHOTOS + 7):
        run = joint(problem, begin, stop_at(call), parts)
        with pytest.raises(Stopped):
            next(run)


def test_held_points_go_where_the_template_has_them(template, prior):
    """The start lies beside it and the prior thinks it right."""
    views, pictures = cameras(), [wave(k) for k in range(PHOTOS)]
    options = JointOptions((Level(3.0, 2, 10, 6),), landmark_weight=0.0)
    truth = template.surface
    normals = directions(truth).reshape(*SHAPE, 3)
    begin = BSplineSurface(truth.control_points + 3.0 * normals)

    def result(constraint):
        problem = start(template, prior, begin, views, 0.0, constraint)
        *_, last = iterations(*problem, pictures, options)
        away = last.state.surface.control_points - truth.control_points
        return (away * normals).sum(2), last.system.deviation().reshape(SHAPE)

    one = np.zeros(SHAPE, bool)
    one[3, 4] = True
    away, deviation = result(None)
    hard_away, hard = result(Constraint(one))
    soft_away, soft = result(Constraint(one, 1.0))
    assert abs(away[3, 4]) > 0.5
    assert abs(hard_away[3, 4]) < 0.02
    assert abs(soft_away[3, 4]) < abs(away[3, 4])
    # What is held is known.
    assert hard[3, 4] < 2e-3
    assert soft[3, 4] < min(1.0, deviation[3, 4])


def test_samples_are_skin(template):
    uv = sample_grid(template, 40)
    assert 300 < len(uv) < 1600
    assert template.is_skin(uv).all()
    # the template's mirror image is sampled at the mirrored places
    mirrored = {tuple(np.round(x, 6)) for x in uv * (-1, 1) + (1, 0)}
    same = sum(tuple(np.round(x, 6)) in mirrored for x in uv)
    assert same > 0.95 * len(uv)


def test_steps_in_one_direction_get_longer():
    ahead, aside = np.array([1.0, 0.0]), np.array([0.0, 2.0])
    assert relaxation(ahead, None) == 1.0
    assert relaxation(ahead, 3 * ahead) == pytest.approx(1.0 + OVER_RELAXATION)
    assert relaxation(ahead, aside) == relaxation(ahead, -ahead) == 1.0
    assert relaxation(0 * ahead, ahead) == 1.0
