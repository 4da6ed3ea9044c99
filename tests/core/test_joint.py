"""The joint system: its derivative rows, its elimination, its step, its fixed point.

The photos are analytic waves, so value and gradient are exact at any place, and the
residual can be differentiated numerically. The surface is a plane, where the linear
model of a displacement along the normals is exact, or the template, where it is not.
"""

from dataclasses import dataclass, fields, replace

import numpy as np
import pytest
import reference
from bsface.camera.camera import PARAMETERS, Camera
from bsface.photometry import harmonics
from bsface.solve.joint import refine as joint
from bsface.solve.joint import samples
from bsface.solve.joint import system as joint_system
from bsface.solve.joint.refine import JointOptions, Level, refine
from bsface.solve.joint.samples import sample_grid
from bsface.solve.motion import Bundle, LandmarkObservations
from bsface.surface.bspline import BSplineSurface, basis_matrix
from bsface.surface.prior import shape_prior
from bsface.surface.template import load_template
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


def wave(seed):
    rng = np.random.default_rng(seed)
    return Wave(rng.normal(0, 0.03, (4, 2)), rng.uniform(0, 6, 4))


@pytest.fixture(scope="module")
def template():
    base = load_template()
    few = replace(
        base,
        identity_modes=base.identity_modes[:3],
        expression_modes=base.expression_modes[:1],
    )
    return few.resampled(SHAPE)


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


def start(template, prior, surface, views, expression=0.0):
    """A motion result that stands at ``surface``, and landmarks that agree with it."""
    index = np.flatnonzero(template.landmark_reliable)[::20]
    structure = surface.evaluate(*template.landmark_uv[index].T)
    pixels = np.stack([c.project(structure) for c in views])
    known = {
        "surface": surface,
        "cameras": tuple(views),
        "structure": structure,
        "modes": np.zeros(len(prior.modes)),
        "smooth": np.zeros((len(surface.vector), 3)),
        "expressions": expression * np.arange(len(views))[:, None],
        "expression_scale": 0.5,
        "residual": np.zeros(pixels.shape[:2]),
        "weight": np.ones(pixels.shape[:2]),
        "history": (),
    }
    bundle = Bundle(**{f.name: known.get(f.name) for f in fields(Bundle)})
    return bundle, LandmarkObservations(pixels, np.ones(pixels.shape[:2]), index)


@dataclass
class Seen:
    """What `refine` handed to its parts in its first iteration, and its state."""

    T: list
    c: np.ndarray
    h: np.ndarray
    s: np.ndarray
    weights: np.ndarray
    r: np.ndarray
    values: np.ndarray
    lights: np.ndarray
    albedo: np.ndarray
    radiance_transfer: object
    own: np.ndarray  # displacement of the control points in each photo
    state: object
    options: JointOptions


def first_step(monkeypatch, template, prior, surface, views, pictures, expression=0.0):
    """Run one iteration on analytic pictures and look inside."""
    options = replace(
        JointOptions(),
        levels=(Level(3.0, 1, 14),),
        landmark_weight=0.0,
        max_step_mm=1e9,
    )
    bundle, marks = start(template, prior, surface, views, expression)
    inside: dict = {}
    lighting, equations = joint.estimate_lighting, joint.normal_equations

    def spy_lighting(values, *args, **kwargs):
        found = lighting(values, *args, **kwargs)
        inside.update(values=values, lights=found[0], albedo=found[1])
        return found

    def spy_equations(*args):
        inside["rows"] = args
        return equations(*args)

    monkeypatch.setattr(joint, "smooth_photo", lambda photo, *_: pictures[photo])
    monkeypatch.setattr(joint, "estimate_lighting", spy_lighting)
    monkeypatch.setattr(joint, "normal_equations", spy_equations)
    radiance_transfer = samples.radiance_transfer
    monkeypatch.setattr(
        samples, "sky", lambda *a: inside.setdefault("sky", radiance_transfer(*a))
    )
    (state,) = refine(template, prior, bundle, range(len(views)), marks, options)
    own = np.tensordot(bundle.expressions, template.expression_modes, 1)
    found = (inside[k] for k in ("values", "lights", "albedo", "sky"))
    return Seen(*inside["rows"], *found, own, state, options)


class Residual:
    """``r_ij`` as a function of everything that it depends on, from the definition."""

    def __init__(self, seen, surface, views, pictures):
        self.seen, self.surface = seen, surface
        self.views, self.pictures = views, pictures
        self.uv = seen.state.uv
        raw = self.photos(surface, views)
        self.scale = np.median(raw / seen.values, 1, keepdims=True)

    def faces(self, surface):
        return [BSplineSurface(surface.control_points + e) for e in self.seen.own]

    def photos(self, surface, views):
        parts = zip(self.pictures, views, self.faces(surface), strict=True)
        return np.stack(
            [p.value(c.project(f.evaluate(*self.uv.T))) for p, c, f in parts]
        )

    def __call__(self, surface=None, views=None, lights=None, albedo=None):
        surface = self.surface if surface is None else surface
        lights = self.seen.lights if lights is None else lights
        albedo = self.seen.albedo if albedo is None else albedo
        views = self.views if views is None else views
        shading = np.stack(
            [
                self.seen.radiance_transfer.basis(f.normals(*self.uv.T)) @ light
                for f, light in zip(self.faces(surface), lights, strict=True)
            ]
        )
        return self.photos(surface, views) / self.scale - albedo * shading


@pytest.fixture(params=["plane", "template", "expressions"])
def case(request, monkeypatch, template, prior):
    """A plane, the template, or the template with another expression in each photo."""
    surface = plane() if request.param == "plane" else template.surface
    own = 1.5 if request.param == "expressions" else 0.0
    views, pictures = cameras(), [wave(k) for k in range(PHOTOS)]
    seen = first_step(monkeypatch, template, prior, surface, views, pictures, own)
    return request.param, seen, Residual(seen, surface, views, pictures), surface


# --- the rows ------------------------------------------------------------------------


def test_residual_is_the_one_of_the_definition(case):
    _, seen, residual, _ = case
    np.testing.assert_allclose(residual(), seen.r, atol=1e-9)


def row_errors(seen, residual, surface, every):
    """Relative error of the rows of some control points, against the definition."""
    ways, errors = directions(surface), []
    used = np.flatnonzero(np.abs(seen.T[0].toarray()).sum(0) > 0.5)
    for k in used[::every]:

        def moved(e, k=k):
            b = surface.vector.copy()
            b[k] += e[0] * ways[k]
            return residual(BSplineSurface(b.reshape(*surface.shape, 3)))

        expected = reference.numerical_derivative(moved, 1, 1e-4)[..., 0]
        T = [t[:, [k]].toarray()[:, 0] for t in seen.T]
        found = sum(seen.c[..., a] * T[a] for a in range(3))
        errors.append(np.linalg.norm(found - expected) / np.linalg.norm(expected))
    return errors


def test_rows_of_the_displacement(case):
    """Moving a control point along its direction changes the residual as T c says.

    On the template the directions of neighbours differ, so the model is coarse there.
    """
    kind, seen, residual, surface = case
    errors = row_errors(seen, residual, surface, 5)
    assert np.median(errors) < (1e-4 if kind == "plane" else 0.3)


def test_rows_of_a_curved_surface_get_better_with_the_net(monkeypatch, template):
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
        with monkeypatch.context() as patch:
            seen = first_step(patch, finer, prior, finer.surface, views, pictures)
        residual = Residual(seen, finer.surface, views, pictures)
        medians.append(np.median(row_errors(seen, residual, finer.surface, 7)))
    assert medians[1] < 0.5 * medians[0]
    assert medians[1] < 0.1


def test_rows_of_the_cameras(case):
    _, seen, residual, _ = case
    for i in range(PHOTOS):

        def moved(e, i=i):
            views = list(residual.views)
            views[i] = views[i].moved(e)
            return residual(views=views)

        expected = reference.numerical_derivative(moved, PARAMETERS, 1e-5)
        found = np.zeros_like(expected)
        found[i] = seen.h[i, :, :PARAMETERS]
        np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


def test_rows_of_the_lights_and_of_the_albedo(case):
    _, seen, residual, _ = case
    order = seen.lights.shape[1]
    for i in range(PHOTOS):

        def moved(e, i=i):
            lights = seen.lights.copy()
            lights[i] += e
            return residual(lights=lights)

        expected = reference.numerical_derivative(moved, order, 1e-3)
        np.testing.assert_allclose(seen.h[i, :, PARAMETERS:], expected[i], atol=1e-8)
        assert np.abs(np.delete(expected, i, 0)).max() == 0
    slope = residual(albedo=seen.albedo + 1e-3) - residual(albedo=seen.albedo - 1e-3)
    np.testing.assert_allclose(seen.s, -slope / 2e-3, atol=1e-9)


# --- the elimination and the step ----------------------------------------------------


def random_rows(seed=0, n=3, p=40, m=4, hidden=()):
    rng = np.random.default_rng(seed)
    u, v = rng.random((2, p))
    T = [basis_matrix((5, 4), u, v, *k) for k in ((0, 0), (1, 0), (0, 1))]
    c, h = rng.normal(size=(n, p, 3)), rng.normal(size=(n, p, m))
    s, W, r = rng.normal(size=(3, n, p))
    W = np.abs(W)
    W[:, list(hidden)] = 0
    return T, c, h, s, W, r


def assembled(blocks):
    S, gd, B, H, gh = blocks
    dense = sum(S[1:], S[0]).toarray()
    return np.block([[dense, B], [B.T, H]]), np.concatenate([gd, gh])


def test_albedo_is_eliminated_exactly():
    """The blocks are the Schur complement of the system that keeps the albedo."""
    T, c, h, s, W, r = random_rows()
    A, g = assembled(joint_system.normal_equations(T, c, h, s, W, r))
    full = reference.dense_gauss_newton([t.toarray() for t in T], c, h, s, W, r)
    expected, right = reference.schur_complement(*full, len(A))
    np.testing.assert_allclose(A, expected, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(g, right, atol=1e-9 * np.abs(right).max())


def test_points_that_no_photo_sees_add_nothing():
    T, c, h, s, W, r = random_rows(hidden=(0, 7, 8))
    keep = W.any(0)
    one = assembled(joint_system.normal_equations(T, c, h, s, W, r))
    fewer = [t[np.flatnonzero(keep)] for t in T]
    two = assembled(
        joint_system.normal_equations(
            fewer, c[:, keep], h[:, keep], s[:, keep], W[:, keep], r[:, keep]
        )
    )
    for a, b in zip(one, two, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)


def dense_system(seen, prior, ways, views):
    """All unknowns at once: displacement, modes, photos, albedo; right side too."""
    n, p, m = seen.h.shape
    size, count = len(ways), len(prior.modes)
    D = np.einsum("kbx,bx->bk", prior.modes, ways)
    T = [t.toarray() for t in seen.T]
    A, g = reference.dense_gauss_newton(T, seen.c, seen.h, seen.s, seen.weights, seen.r)
    # the modes move the same displacement: columns [I D]
    change = np.zeros((len(A), len(A) + count))
    change[:size, :size], change[:size, size : size + count] = np.eye(size), D
    change[size:, size + count :] = np.eye(len(A) - size)
    A, g = change.T @ A @ change, change.T @ g
    # nothing is known of the albedo of a point that no photo sees
    A += np.diag(1.0 * (np.diag(A) == 0))
    A[:size, :size] += prior.smooth.toarray()
    A[size : size + count, size : size + count] += np.eye(count)
    border = slice(size + count, size + count + n * m)
    held = joint_system.Blocks([], g, g, np.zeros((n * m, n * m)), np.zeros(n * m))
    joint._add_photo_priors(held, views, seen.options)
    A[border, border] += held.H
    g[border] += held.gh
    return A, g, border, D


def test_step_is_that_of_the_dense_system(case, prior):
    """Without any elimination, with the albedo among the unknowns: the same step."""
    _, seen, residual, surface = case
    n, _, m = seen.h.shape
    ways, state = directions(surface), seen.state
    A, g, border, D = dense_system(seen, prior, ways, residual.views)
    x = np.linalg.solve(A, g)
    size, count = D.shape
    total = x[:size] + D @ x[size : size + count]
    assert np.abs(total).max() > 1e-3
    near = dict(rtol=1e-5, atol=1e-7 * np.abs(x).max())
    np.testing.assert_allclose(
        state.surface.vector, surface.vector + total[:, None] * ways, **near
    )
    np.testing.assert_allclose(state.modes, x[size : size + count], **near)
    own = x[border].reshape(n, m)
    np.testing.assert_allclose(state.lights, seen.lights + own[:, PARAMETERS:], **near)
    points = np.random.default_rng(0).normal(0, 50, (5, 3))
    for camera, old, step in zip(state.cameras, residual.views, own, strict=True):
        expected = old.moved(step[:PARAMETERS])
        np.testing.assert_allclose(camera.project(points), expected.project(points))


def test_deviation_is_the_diagonal_of_the_dense_covariance(case, prior):
    _, seen, residual, surface = case
    A, _, _, D = dense_system(seen, prior, directions(surface), residual.views)
    pick = np.zeros((len(D), len(A)))
    pick[:, : len(D)], pick[:, len(D) : sum(D.shape)] = np.eye(len(D)), D
    expected = np.sqrt(np.diag(pick @ np.linalg.inv(A) @ pick.T))
    np.testing.assert_allclose(seen.state.deviation, expected, rtol=1e-5)


def test_landmark_rows(template):
    """Against numerical derivatives of the reprojection with frozen weights."""
    surface, views = plane(), cameras()
    index = np.flatnonzero(template.landmark_reliable)[::40]
    uv = template.landmark_uv[index]
    T, ways = basis_matrix(SHAPE, *uv.T), directions(plane())
    rng = np.random.default_rng(0)
    on = surface.evaluate(*uv.T)
    offset = rng.normal(0, 2, (PHOTOS, len(index), 3))
    pixels = np.stack([c.project(on + o) for c, o in zip(views, offset, strict=True)])
    pixels += rng.normal(0, 3, pixels.shape)
    seen = LandmarkObservations(pixels, rng.random(pixels.shape[:2]), index)
    m, size, sigma, weight = PARAMETERS + 4, len(ways), 1.5, 0.3
    S: list = []
    gd, B = np.zeros(size), np.zeros((size, 3 * m))
    H, gh = np.zeros((3 * m, 3 * m)), np.zeros(3 * m)
    blocks = joint_system.Blocks(S, gd, B, H, gh)
    joint_system.add_landmarks(
        blocks, seen, views, surface, offset, uv, T, ways, sigma, weight
    )

    def residual(i, e):
        d, step = e[:size], e[size:]
        b = surface.vector + d[:, None] * ways
        c = views[i].moved(step)
        return ((seen.pixels[i] - c.project(T @ b + offset[i])) / views[i].s).ravel()

    expected_A = np.zeros((size + 3 * m, size + 3 * m))
    expected_g = np.zeros(size + 3 * m)
    for i, c in enumerate(views):
        r = residual(i, np.zeros(size + PARAMETERS))
        J = reference.numerical_derivative(
            lambda e, i=i: residual(i, e), size + PARAMETERS, 1e-5
        )
        facing = np.clip((c.toward(on)[:, 2] - 0.1) / 0.3, 0, 1)
        w = weight * seen.weight[i] * facing / sigma**2
        w = w / (1 + (r.reshape(-1, 2) ** 2).sum(1) / (3 * sigma) ** 2)
        w = np.repeat(w, 2)
        at = np.r_[:size, size + i * m : size + i * m + PARAMETERS]
        expected_A[np.ix_(at, at)] += J.T @ (w[:, None] * J)
        expected_g[at] -= J.T @ (w * r)
    A, g = assembled(blocks)
    np.testing.assert_allclose(A, expected_A, atol=1e-5 * np.abs(expected_A).max())
    np.testing.assert_allclose(g, expected_g, atol=1e-5 * np.abs(expected_g).max())


# --- the iteration -------------------------------------------------------------------


class Formula:
    """A picture whose gradient is taken numerically."""

    def read(self, xy):
        slope = reference.numerical_derivative(lambda e: self.value(xy + e), 2, 1e-3)
        return self.value(xy)[:, None], slope[:, None], np.ones(len(xy), bool)


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
def test_surface_comes_back(monkeypatch, template, scene):
    """The truth stays, and from a wrong surface the way leads back to it."""
    truth, views, pictures = scene()
    monkeypatch.setattr(joint, "smooth_photo", lambda photo, *_: pictures[photo])
    options = replace(
        JointOptions(),
        levels=(Level(3.0, 8, 16),),
        landmark_weight=0.0,
        noise=0.03,
        independence=1.0,
        shadows=False,
    )
    # a prior that allows for the bump
    prior = shape_prior(template, 0.0, 0.0, 30.0, 0.1)
    uv, photos = sample_grid(template, 16), range(len(views))
    still, marks = start(template, prior, truth, views)
    *_, last = refine(template, prior, still, photos, marks, options)
    assert relief(last.surface, truth, uv) < 0.3
    begin = bumped(truth, 8.0)
    moved, marks = start(template, prior, begin, views)
    states = list(refine(template, prior, moved, photos, marks, options))
    before = relief(begin, truth, uv)
    assert before > 0.4
    assert relief(states[-1].surface, truth, uv) < 0.35 * before
    assert states[-1].residual < 0.5 * states[0].residual


def test_no_step_is_larger_than_allowed(monkeypatch, template, prior):
    views, pictures = cameras(), [wave(k) for k in range(PHOTOS)]
    monkeypatch.setattr(joint, "smooth_photo", lambda photo, *_: pictures[photo])
    options = replace(JointOptions(), levels=(Level(3.0, 3, 12),), max_step_mm=0.05)
    begin, marks = start(template, prior, plane(), views)
    before = begin.surface
    uv = sample_grid(template, 12)
    for state in refine(template, prior, begin, range(PHOTOS), marks, options):
        away = state.surface.evaluate(*uv.T) - before.evaluate(*uv.T)
        assert np.abs(away).max() < 0.051
        assert state.step_mm <= 0.05 + 1e-12
        before = state.surface


@pytest.mark.parametrize(
    "settled, turns", [(1e9, [1, 1, 1, 2, 3]), (0.0, [1, 2, 1, 2, 1, 2, 3])]
)
def test_coarse_levels_end_when_they_are_settled(
    monkeypatch, template, prior, settled, turns
):
    """The last level takes all its steps, with all the harmonics, and the deviation."""
    views, pictures = cameras(), [wave(k) for k in range(PHOTOS)]
    monkeypatch.setattr(joint, "smooth_photo", lambda photo, *_: pictures[photo])
    levels = (Level(3.0, 2, 8), Level(2.0, 2, 9), Level(1.0, 3, 10))
    options = replace(
        JointOptions(), levels=levels, degree=3, coarse_degree=2, settled_mm=settled
    )
    begin, marks = start(template, prior, plane(), views)
    states = list(refine(template, prior, begin, range(PHOTOS), marks, options))
    assert [state.turn for state in states] == turns
    assert [state.level for state in states] == sorted(state.level for state in states)
    for state in states:
        assert state.lights.shape[1] == (16 if state.level == 2 else 9)
    assert [state.deviation is not None for state in states].index(True) == len(
        turns
    ) - 1


def test_held_points_go_where_the_template_has_them(monkeypatch, template, prior):
    """The start lies beside it and the prior thinks it right; one hard, one soft."""
    views, pictures = cameras(), [wave(k) for k in range(PHOTOS)]
    monkeypatch.setattr(joint, "smooth_photo", lambda photo, *_: pictures[photo])
    options = replace(JointOptions(), levels=(Level(3.0, 2, 10),), landmark_weight=0.0)
    truth = template.surface
    normals = directions(truth).reshape(*SHAPE, 3)
    begin = BSplineSurface(truth.control_points + 3.0 * normals)
    bundle, marks = start(template, prior, begin, views)
    weight = np.zeros(SHAPE)
    weight[3, 4], weight[4, 6] = 1 / 1e-3**2, 1 / 1.0**2
    run = refine(
        template, prior, bundle, range(PHOTOS), marks, options, held=weight.ravel()
    )
    *_, last = run
    *_, free = refine(template, prior, bundle, range(PHOTOS), marks, options)
    away = ((last.surface.control_points - truth.control_points) * normals).sum(2)
    without = ((free.surface.control_points - truth.control_points) * normals).sum(2)
    assert abs(without[3, 4]) > 0.5
    assert abs(away[3, 4]) < 0.02
    # What is held is known.
    deviation = last.deviation.reshape(SHAPE)
    assert deviation[3, 4] < 2e-3
    assert deviation[4, 6] < min(1.0, free.deviation.reshape(SHAPE)[4, 6])


def test_samples_are_skin(template):
    uv = sample_grid(template, 40)
    assert 300 < len(uv) < 1600
    assert template.is_skin(uv).all()
    # the template's mirror image is sampled at the mirrored places
    mirrored = {tuple(np.round(x, 6)) for x in uv * (-1, 1) + (1, 0)}
    same = sum(tuple(np.round(x, 6)) in mirrored for x in uv)
    assert same > 0.95 * len(uv)
