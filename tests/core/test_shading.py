"""Eq. 6 and 7 against closed forms and a dense oracle."""

import numpy as np
import pytest
from bsface.solve.paper.shading import (
    NormalField,
    NormalRows,
    ShadingParameters,
    cross_matrix,
    left_matrix,
    normal_rms_degrees,
    normals_of,
    right_matrix,
    shading_step,
    solve_eq6,
    solve_eq7,
)
from bsface.surface.bspline import BSplineSurface, grid_parameters


def face_like(shape=(9, 10), depth=30.0):
    """A paraboloid cap as control points, (M*N, 3); v runs down, z to the camera."""
    m, n = shape
    u = (np.arange(m) - 1) / (m - 3)
    v = (np.arange(n) - 1) / (n - 3)
    u, v = np.meshgrid(u, v, indexing="ij")
    x, y = 140 * (u - 0.5), -180 * (v - 0.5)
    z = -depth * ((x / 70) ** 2 + (y / 90) ** 2)
    return np.stack([x, y, z], -1).reshape(-1, 3)


@pytest.fixture
def rows():
    u, v = grid_parameters(25, 25)
    return NormalRows.at((9, 10), np.stack([u, v], 1))


def test_cross_matrix_is_the_cross_product():
    rng = np.random.default_rng(0)
    w, x = rng.normal(size=(2, 7, 3))
    assert np.allclose(cross_matrix(w) @ x.ravel(), np.cross(w, x).ravel())


def test_left_and_right_give_the_normals_of_b_itself(rows):
    b = face_like() + np.random.default_rng(1).normal(size=(90, 3))
    expected = BSplineSurface(b.reshape(9, 10, 3)).normals(*grid_parameters(25, 25))
    assert np.allclose(normals_of(b, rows), expected)
    assert np.allclose(left_matrix(b, rows) @ b.ravel(), expected.ravel())
    assert np.allclose(right_matrix(b, rows) @ b.ravel(), expected.ravel())
    # Out of the face means towards the camera.
    assert (expected[:, 2] > 0).all()


def test_normals_of_a_paraboloid_in_closed_form(rows):
    # Cubic B-splines reproduce quadratics when the constant -1/(3 spans^2) of the
    # Greville values is taken off; a constant shift leaves the normals alone.
    b = face_like()
    u, v = grid_parameters(25, 25)
    x, y = 140 * (u - 0.5), -180 * (v - 0.5)
    n = np.stack([2 * 30 * x / 70**2, 2 * 30 * y / 90**2, np.ones_like(x)], 1)
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    assert np.allclose(normals_of(b, rows), n)


@pytest.mark.parametrize("side", ["left", "right"])
def test_derivative_of_the_unnormalised_normal(rows, side):
    """L is linear in the factor it solves for: moving only F_v (F_u) is exact."""
    b = face_like()
    u, v = grid_parameters(25, 25)
    # A displacement that depends on v alone has F_u' = 0 (and the other way round).
    profile = np.repeat(np.sin(np.arange(10.0))[None], 9, 0)
    if side == "right":
        profile = np.repeat(np.sin(np.arange(9.0))[:, None], 10, 1)
    moved = b + np.array([0, 0, 5.0]) * profile.reshape(-1, 1)
    make = left_matrix if side == "left" else right_matrix
    Fu, Fv = rows.T1 @ b, rows.T2 @ b
    expected = np.cross(rows.T2 @ moved, rows.T1 @ moved)
    expected /= np.linalg.norm(np.cross(Fu, Fv), axis=1, keepdims=True)
    assert np.allclose(make(b, rows) @ moved.ravel(), expected.ravel())


@pytest.mark.parametrize("reference", ["previous", "template"])
@pytest.mark.parametrize("equation", ["6", "7"])
def test_equals_the_dense_normal_equations(rows, equation, reference):
    rng = np.random.default_rng(2)
    bt = face_like()
    b0 = bt + rng.normal(size=bt.shape)
    h = normals_of(face_like(depth=25), rows)
    par = ShadingParameters(0.7, 0.3, 1.24, reference, ridge=1e-3)
    weights = rng.uniform(0.2, 1, len(h))
    solve, make, frozen = {
        "6": (solve_eq6, left_matrix, rows.T1),
        "7": (solve_eq7, right_matrix, rows.T2),
    }[equation]
    got = solve(b0, NormalField(h, weights), bt, rows, par).x

    w = np.repeat(weights / weights.sum(), 3)
    G = make(b0, rows).toarray()
    T = np.kron(rows.T.toarray(), np.diag([1.0, 1.0, 0.0]))
    D = np.kron(frozen.toarray(), np.eye(3))
    ref = b0 if reference == "previous" else bt
    lam = 0.7 / np.average(((frozen @ bt) ** 2).sum(1), weights=weights)
    xy, eps = 0.3 / 1.24**2, 1e-3 / 1.24**2 / len(bt)
    A = (
        (G.T * w) @ G
        + xy * (T.T * w) @ T
        + lam * (D.T * w) @ D
        + eps * np.eye(3 * len(bt))
    )
    y = (
        (G.T * w) @ h.ravel()
        + xy * (T.T * w) @ T @ bt.ravel()
        + lam * (D.T * w) @ D @ ref.ravel()
        + eps * b0.ravel()
    )
    assert np.allclose(got, np.linalg.solve(A, y), atol=1e-6)


def test_own_normals_are_a_fixed_point(rows):
    b = face_like()
    own = normals_of(b, rows)
    b2, figures = shading_step(b, NormalField(own, np.ones(len(own))), b, rows)
    assert np.allclose(b2, b, atol=1e-6)
    assert figures["normal_rms_deg"] < 1e-4


def test_alternation_reaches_the_given_normals():
    """From a flatter cap to a deeper one with the same x, y: depth must follow."""
    shape = (14, 14)
    u, v = grid_parameters(40, 40)
    rows = NormalRows.at(shape, np.stack([u, v], 1))
    bt, truth = face_like(shape, 30), face_like(shape, 40)
    h = NormalField(normals_of(truth, rows), np.ones(len(u)))
    exact = ShadingParameters(lam=1.0, derivative_reference="previous")
    before = normal_rms_degrees(h, normals_of(bt, rows))
    b0, angles = bt, [before]
    for _ in range(25):
        b0, figures = shading_step(b0, h, bt, rows, exact)
        angles.append(figures["normal_rms_deg"])
    assert angles[-1] < 0.1 * before
    assert np.all(np.diff(angles) < 1e-3)
    depth = (rows.T @ b0)[:, 2] - (rows.T @ truth)[:, 2]
    start = (rows.T @ bt)[:, 2] - (rows.T @ truth)[:, 2]
    # A constant shift of z is invisible to normals.
    assert np.std(depth) < 0.15 * np.std(start)


def test_parameters_are_checked():
    with pytest.raises(ValueError, match="previous"):
        ShadingParameters(derivative_reference="other")
    with pytest.raises(ValueError, match="negative"):
        ShadingParameters(lam=-1)
    with pytest.raises(ValueError, match="positive"):
        ShadingParameters(frontal_scale_mm=0)
