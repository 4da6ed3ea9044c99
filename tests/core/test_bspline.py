"""The surface: against the definition, against scipy, and in closed form."""

import copy
import pickle

import numpy as np
import pytest
import reference
from bsface.surface.bspline import (
    BSplineSurface,
    basis_matrix,
    grid_parameters,
    grid_triangles,
    segment_basis,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline

SHAPES = [(4, 4), (4, 9), (7, 5)]
unit = st.floats(0, 1, allow_nan=False)


@pytest.fixture
def rng():
    return np.random.default_rng(3)


def wavy(shape=(8, 9), seed=1) -> BSplineSurface:
    """A face-sized sheet with gentle bumps, x right, y up (v runs down)."""
    u = (np.arange(shape[0]) - 1) / (shape[0] - 3)
    v = (np.arange(shape[1]) - 1) / (shape[1] - 3)
    u, v = np.meshgrid(u, v, indexing="ij")
    z = 60 * (1 - (2 * u - 1) ** 2) + 30 * (1 - (2 * v - 1) ** 2)
    z = z + np.random.default_rng(seed).normal(0, 3, shape)
    return BSplineSurface(np.stack([140 * u - 70, 80 - 180 * v, z], -1))


def dense(count, x, order):
    first, value = segment_basis(count, x, order)
    out = np.zeros((len(first), count))
    np.put_along_axis(out, first[:, None] + np.arange(4), value, 1)
    return out


@pytest.mark.parametrize("count", [4, 5, 8, 13])
@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_basis_is_that_of_cox_and_de_boor(rng, count, order):
    # Derivatives of the third order jump at the knots, so those are left to the others.
    knots = np.linspace(0, 1, count - 2)
    x = rng.random(12) if order == 3 else np.concatenate([knots, rng.random(12)])
    expected = np.array([reference.basis_row(count, value, order) for value in x])
    np.testing.assert_allclose(dense(count, x, order), expected, atol=1e-9)


@given(count=st.integers(4, 60), x=unit)
def test_partition_of_unity(count, x):
    value = dense(count, [x], 0)
    assert value.min() >= -1e-15  # rounding of the local polynomials
    np.testing.assert_allclose(value.sum(), 1, rtol=1e-13)
    for order in (1, 2, 3):
        scale = float(count - 3) ** order
        assert abs(dense(count, [x], order).sum()) <= 1e-12 * scale


@pytest.mark.parametrize("count", [4, 6, 11])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_agrees_with_scipy(rng, count, order):
    b, x = rng.normal(size=(count, 3)), rng.random(30)
    spline = BSpline(np.arange(count + 4.0), b, 3)
    expected = spline(3 + x * (count - 3), order) * float(count - 3) ** order
    np.testing.assert_allclose(dense(count, x, order) @ b, expected, atol=1e-9)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("derivative", [(0, 0), (1, 0), (0, 1), (2, 0), (0, 2), (1, 1)])
def test_coefficient_matrices(rng, shape, derivative):
    u, v = (
        np.append(rng.random(9), [0, 1, 0, 1]),
        np.append(rng.random(9), [0, 0, 1, 1]),
    )
    T = basis_matrix(shape, u, v, *derivative)
    assert T.shape == (13, shape[0] * shape[1])
    expected = reference.dense_matrix(shape, u, v, *derivative)
    np.testing.assert_allclose(T.toarray(), expected, atol=1e-10)


@pytest.mark.parametrize("shape", SHAPES)
def test_derivatives_are_those_of_the_surface(rng, shape):
    surface = BSplineSurface(rng.normal(size=(*shape, 3)))
    for u, v in rng.uniform(0.05, 0.95, (6, 2)):

        def at(e, u=u, v=v):
            return surface.evaluate(u + e[0], v + e[1])

        first = reference.numerical_derivative(at, 2, 1e-5)
        np.testing.assert_allclose(surface.evaluate(u, v, 1, 0), first[:, 0], atol=1e-5)
        np.testing.assert_allclose(surface.evaluate(u, v, 0, 1), first[:, 1], atol=1e-5)


@pytest.mark.parametrize("shape", SHAPES)
def test_polynomials_up_to_cubic_are_exact(rng, shape):
    """The control points of a polynomial are its polar form at the knots."""
    terms = {
        (i, j): rng.normal(size=3) for i in range(4) for j in range(4) if i + j <= 4
    }
    surface = BSplineSurface(reference.polynomial_control_points(shape, terms))
    u, v = rng.random((2, 40))
    expected = sum(c * (u**i * v**j)[:, None] for (i, j), c in terms.items())
    np.testing.assert_allclose(surface.evaluate(u, v), expected, atol=1e-12)


def test_normal_of_a_plane_looks_to_the_camera(rng):
    """u to the right and v down span a sheet that is seen from +z."""
    plane = {(0, 0): (-50, 40, 3), (1, 0): (100, 0, 0), (0, 1): (0, -80, 0)}
    surface = BSplineSurface(reference.polynomial_control_points((6, 5), plane))
    normals = surface.normals(*rng.random((2, 20)))
    np.testing.assert_allclose(normals, np.tile([0, 0, 1.0], (20, 1)), atol=1e-13)


@given(a=st.floats(-2, 2), b=st.floats(-2, 2), c=st.floats(-2, 2), u=unit, v=unit)
def test_normals_of_a_paraboloid_in_closed_form(a, b, c, u, v):
    """z = a x^2 + b x y + c y^2 over x = u, y = 1 - v."""
    square = np.array([0.0, 0, 1])
    terms = {
        (0, 0): np.array([0, 1, c]),
        (1, 0): np.array([1, 0, b]),
        (0, 1): np.array([0, -1, -2 * c]),
        (2, 0): a * square,
        (1, 1): -b * square,
        (0, 2): c * square,
    }
    surface = BSplineSurface(reference.polynomial_control_points((6, 7), terms))
    x, y = u, 1 - v
    point = [x, y, a * x * x + b * x * y + c * y * y]
    np.testing.assert_allclose(surface.evaluate(u, v), point, atol=1e-12)
    n = np.array([-2 * a * x - b * y, -b * x - 2 * c * y, 1])
    expected = n / np.linalg.norm(n)
    np.testing.assert_allclose(surface.normals(u, v), expected, atol=1e-11)


def test_second_derivatives_are_continuous_at_the_knots(rng):
    surface = BSplineSurface(rng.normal(size=(9, 6, 3)))
    for knot in np.arange(1, 6) / 6:
        for order in (0, 1, 2):
            below, above = surface.evaluate(
                [np.nextafter(knot, 0), np.nextafter(knot, 1)], [0.3, 0.3], du=order
            )
            np.testing.assert_allclose(below, above, atol=1e-9)


def test_moving_one_control_point_moves_only_its_neighbourhood():
    base = wavy((10, 12))
    b = base.control_points.copy()
    b[5, 6] += 7
    moved = np.linalg.norm(BSplineSurface(b).grid(71, 91) - base.grid(71, 91), axis=-1)
    u, v = np.linspace(0, 1, 71), np.linspace(0, 1, 91)
    # the support of N_5 is the knots 5 to 9, of N_6 the knots 6 to 10
    far_u = (u <= 2 / 7) | (u >= 6 / 7)
    far_v = (v <= 3 / 9) | (v >= 7 / 9)
    assert moved[far_u].max() < 1e-12
    assert moved[:, far_v].max() < 1e-12
    assert moved.max() > 2


@pytest.mark.parametrize("shape", SHAPES)
def test_clamped_form_is_the_same_surface(rng, shape):
    surface = BSplineSurface(rng.normal(size=(*shape, 3)))
    b, knots_u, knots_v = surface.clamped()
    assert b.shape == surface.control_points.shape
    for knots, count in ((knots_u, shape[0]), (knots_v, shape[1])):
        assert len(knots) == count + 4
        np.testing.assert_allclose(knots[:4], 0, atol=1e-15)
        np.testing.assert_allclose(knots[-4:], 1, atol=1e-15)
        np.testing.assert_allclose(knots[3:-3], np.linspace(0, 1, count - 2))
    u, v = rng.random((2, 30))
    along_u = BSpline(knots_u, b, 3)(u)
    expected = np.stack(
        [BSpline(knots_v, row, 3)(y) for row, y in zip(along_u, v, strict=True)]
    )
    np.testing.assert_allclose(surface.evaluate(u, v), expected, atol=1e-12)
    corners = surface.evaluate([0, 0, 1, 1], [0, 1, 0, 1])
    np.testing.assert_allclose(b[[0, 0, -1, -1], [0, -1, 0, -1]], corners, atol=1e-12)


def test_resampling_is_exact_where_the_knots_nest(rng):
    surface = BSplineSurface(rng.normal(size=(6, 7, 3)))
    finer = surface.resampled((9, 15))  # 3 -> 6 spans, 4 -> 12 spans
    assert finer.shape == (9, 15)
    u, v = rng.random((2, 50))
    np.testing.assert_allclose(finer.evaluate(u, v), surface.evaluate(u, v), atol=1e-9)
    back = finer.resampled((6, 7))
    np.testing.assert_allclose(back.control_points, surface.control_points, atol=1e-8)


def test_resampling_keeps_planes_and_the_same_net():
    plane = {(0, 0): (1, 2, 3), (1, 0): (9, 0, 1), (0, 1): (0, -8, 2)}
    surface = BSplineSurface(reference.polynomial_control_points((9, 8), plane))
    smaller = surface.resampled((5, 6))
    expected = reference.polynomial_control_points((5, 6), plane)
    np.testing.assert_allclose(smaller.control_points, expected, atol=1e-10)
    assert np.array_equal(
        surface.resampled((9, 8)).control_points, surface.vector.reshape(9, 8, 3)
    )


@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(0.1, 10))
@settings(max_examples=25)
def test_similarity_of_control_points_is_similarity_of_the_surface(seed, scale):
    rng = np.random.default_rng(seed)
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    R *= np.sign(np.linalg.det(R))
    t, (u, v) = rng.normal(size=3), rng.random((2, 8))
    base = wavy()
    moved = base.transformed(scale, R, t)
    expected = scale * base.evaluate(u, v) @ R.T + t
    np.testing.assert_allclose(moved.evaluate(u, v), expected, atol=1e-10 * scale)
    np.testing.assert_allclose(
        moved.normals(u, v), base.normals(u, v) @ R.T, atol=1e-11
    )


@given(seed=st.integers(0, 2**32 - 1), height=st.floats(-6, 6))
@settings(max_examples=25)
def test_closest_point_of_a_known_offset(seed, height):
    """A point on the normal, nearer than the radii of curvature, goes back."""
    surface = wavy()
    uv = np.random.default_rng(seed).uniform(0.05, 0.95, (12, 2))
    normals, points = surface.normals(*uv.T), surface.evaluate(*uv.T)
    found, distance = surface.closest_point(points + height * normals)
    np.testing.assert_allclose(distance, abs(height), atol=1e-4)
    np.testing.assert_allclose(surface.evaluate(*found.T), points, atol=0.05)
    signed = surface.signed_distance(points + height * normals)
    np.testing.assert_allclose(signed, height, atol=1e-4)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_no_surface_point_is_closer_than_the_closest(seed):
    surface = wavy(seed=seed % 5)
    q = np.random.default_rng(seed).normal(0, 90, (8, 3))
    uv, distance = surface.closest_point(q)
    assert ((uv >= 0) & (uv <= 1)).all()
    np.testing.assert_allclose(
        np.linalg.norm(surface.evaluate(*uv.T) - q, axis=1), distance, rtol=1e-12
    )
    everywhere = surface.grid(60, 70).reshape(-1, 3)
    nearest = np.linalg.norm(everywhere - q[:, None], axis=2).min(1)
    assert (distance <= nearest + 1e-6).all()


def test_side_of_a_plane_is_the_sign_of_z():
    plane = {(0, 0): (-50, 50, 0), (1, 0): (100, 0, 0), (0, 1): (0, -100, 0)}
    surface = BSplineSurface(reference.polynomial_control_points((5, 5), plane))
    heights = np.array([-20, -1e-3, 1e-3, 30])
    points = np.stack([[0, 10, -10, 20], [5, 0, -30, 1], heights], 1)
    np.testing.assert_allclose(surface.signed_distance(points), heights, atol=1e-9)


@pytest.mark.parametrize(("nu", "nv"), [(2, 2), (5, 4)])
def test_triangles_cover_the_grid_and_face_outward(nu, nv):
    triangles = grid_triangles(nu, nv)
    assert triangles.shape == (2 * (nu - 1) * (nv - 1), 3)
    u, v = grid_parameters(nu, nv)
    flat = np.stack([u, -v], 1)  # as seen from outside: u right, v down
    a, b, c = (flat[triangles[:, k]] for k in range(3))
    area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    assert (area > 0).all()
    np.testing.assert_allclose(area.sum(), 1)


def test_triangle_normals_agree_with_the_surface():
    surface = wavy()
    points, triangles = surface.grid(40, 40).reshape(-1, 3), grid_triangles(40, 40)
    u, v = grid_parameters(40, 40)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    flat = np.cross(b - a, c - a)
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    centre = np.stack([u[triangles].mean(1), v[triangles].mean(1)])
    assert ((flat * surface.normals(*centre)).sum(1) > 0.99).all()


def test_surface_owns_its_control_points():
    b = wavy().control_points.copy()
    surface = BSplineSurface(b)
    b[0, 0] = 1e9
    assert surface.control_points.max() < 1e6
    with pytest.raises(ValueError, match="read-only"):
        surface.control_points[0, 0, 0] = 1.0


@pytest.mark.parametrize(
    "b", [np.zeros((3, 4, 3)), np.zeros((4, 4)), np.zeros((4, 4, 2))]
)
def test_wrong_shapes_are_refused(b):
    with pytest.raises(ValueError, match="must be"):
        BSplineSurface(b)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_control_points_must_be_finite(value):
    b = np.zeros((4, 4, 3))
    b[2, 1, 0] = value
    with pytest.raises(ValueError, match="finite"):
        BSplineSurface(b)


def test_parameters_must_match():
    with pytest.raises(ValueError, match="differ in length"):
        basis_matrix((4, 4), [0.1, 0.2], [0.3])
    with pytest.raises(ValueError, match="order of a derivative is 0 or more"):
        basis_matrix((4, 4), [0.1], [0.3], du=-1)
    with pytest.raises(ValueError, match="at least 4"):
        segment_basis(3, [0.1])


def test_degenerate_surface_has_finite_normals():
    """All control points in one place: no direction, but no NaN either."""
    surface = BSplineSurface(np.zeros((4, 4, 3)))
    assert np.isfinite(surface.normals(*np.random.default_rng(0).random((2, 9)))).all()
    assert np.isfinite(surface.closest_point([[1.0, 2, 3]])[1]).all()


@pytest.mark.parametrize("method", ["evaluate", "normals", "matrix"])
@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf, None, "a", 1j, True])
def test_parameters_are_finite_numbers(method, wrong):
    for uv in ((wrong, 0.5), (0.5, wrong), ([0.5, wrong], [0.5, 0.5])):
        if uv[0] == [0.5, True]:
            continue  # NumPy makes it 1.0
        with pytest.raises(ValueError, match=r"[uv] must .*numbers.*\.$"):
            getattr(wavy(), method)(*uv)


def test_parameters_beyond_the_square_continue_the_border():
    surface = wavy()
    assert np.isfinite(surface.evaluate([-0.3, 1.2], [0.5, 7.0])).all()
    assert surface.evaluate([], []).shape == (0, 3)


def test_whole_numbers_are_told_by_name():
    surface = wavy()
    for wrong in (True, 1.5, -1, 4, None):
        with pytest.raises((TypeError, ValueError), match="du must be a whole"):
            surface.evaluate(0.5, 0.5, du=wrong)
        with pytest.raises((TypeError, ValueError), match="dv must be a whole"):
            surface.matrix([0.5], [0.5], dv=wrong)
    with pytest.raises(ValueError, match="nu must be a whole number"):
        surface.grid(-1, 2)
    with pytest.raises(TypeError, match="nv must be a whole number"):
        surface.grid(3, 2.5)
    with pytest.raises(ValueError, match="iterations must be a whole number"):
        surface.closest_point([0.0, 0.0, 0.0], iterations=-1)


@pytest.mark.parametrize("points", [np.zeros((3, 4)), np.zeros(2), 1.0, [["a"] * 3]])
def test_points_have_three_coordinates(points):
    for method in (wavy().closest_point, wavy().signed_distance):
        with pytest.raises(ValueError, match="points must"):
            method(points)
    assert wavy().signed_distance(np.zeros((2, 5, 3))).shape == (10,)


@pytest.mark.parametrize("shape", [(20,), (), 20, (8, 9.5), (8, True), (3, 8), "ab"])
def test_a_net_has_two_whole_numbers(shape):
    with pytest.raises(ValueError, match="shape must be two whole numbers"):
        wavy().resampled(shape)


@pytest.mark.parametrize(
    "wrong, words",
    [
        ({"scale": 0}, "scale must"),
        ({"scale": np.nan}, "scale must"),
        ({"scale": [1.0, 2.0, 3.0]}, "scale must"),
        ({"scale": "2"}, "scale must"),
        ({"R": np.eye(2)}, r"R must be \(3, 3\)"),
        ({"R": [1.0, 2.0, 3.0]}, r"R must be \(3, 3\)"),
        ({"t": [1.0, 2.0]}, r"t \(3,\)"),
        ({"t": np.zeros((8, 9, 3))}, r"t \(3,\)"),
    ],
)
def test_unusable_movements_are_refused(wrong, words):
    with pytest.raises(ValueError, match=words):
        wavy().transformed(**wrong)


@pytest.mark.parametrize("kind", [complex, bool, str, object])
def test_control_points_are_real_numbers(kind):
    with pytest.raises(ValueError, match="control points must hold real numbers"):
        BSplineSurface(np.ones((4, 4, 3)).astype(kind))
    assert BSplineSurface(np.ones((4, 4, 3), int)).control_points.dtype == float


@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy])
def test_copies_of_a_surface_cannot_be_written_either(again):
    for made in (again(wavy()), pickle.loads(pickle.dumps(wavy()))):
        with pytest.raises(ValueError, match="read-only"):
            made.control_points[0, 0, 0] = 1.0
