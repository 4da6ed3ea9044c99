"""The factor of net matrices against dense algebra."""

import numpy as np
import pytest
from bsface.solve.joint.banded import banded_cholesky, mirrored_order
from bsface.surface.bending import bending_matrix, mass_matrix
from bsface.surface.bspline import basis_matrix
from scipy import sparse

SHAPES = [(4, 4), (8, 9), (9, 8), (10, 5), (11, 12), (13, 7)]


def normal_matrix(shape, seed=0):
    """As in the joint system: smoothness, and normal equations of random points."""
    rng = np.random.default_rng(seed)
    u, v = rng.random((2, 60))
    total = bending_matrix(shape) + mass_matrix(shape)
    for du, dv in ((0, 0), (1, 0), (0, 1)):
        T = basis_matrix(shape, u, v, du, dv)
        total = total + T.T @ sparse.diags_array(rng.random(60)) @ T
    return sparse.csr_array(total)


@pytest.mark.parametrize("shape", SHAPES)
def test_solutions(shape):
    A = normal_matrix(shape)
    factor = banded_cholesky(A, mirrored_order(shape))
    B = np.random.default_rng(1).normal(size=(A.shape[0], 5))
    expected = np.linalg.solve(A.toarray(), B)
    np.testing.assert_allclose(factor.solve(B), expected, rtol=1e-8)
    np.testing.assert_allclose(factor.solve(B[:, 0]), expected[:, 0], rtol=1e-8)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_factor_is_that_of_the_matrix(shape):
    A = normal_matrix(shape, seed=2)
    factor = banded_cholesky(A, mirrored_order(shape))
    ordered = A.toarray()[factor.order][:, factor.order]
    L = np.linalg.cholesky(ordered)
    for k, diagonal in enumerate(factor.band):
        expected = np.diagonal(L, -k)
        np.testing.assert_allclose(diagonal[: len(expected)], expected, atol=1e-8)


def test_points_coupled_with_their_mirror_images():
    """Far apart in the net, near the diagonal in the factor; the solution is right."""
    shape = (30, 20)
    opposite = np.arange(600).reshape(shape)[::-1].ravel()
    A = normal_matrix(shape)
    A = sparse.csr_array(
        A + 3 * A[opposite][:, opposite] - A[opposite] - A[:, opposite]
    )
    A = sparse.csr_array(A + 20 * sparse.eye_array(600))
    factor = banded_cholesky(A, mirrored_order(shape))
    assert len(factor.band) <= 3 * 30 + 8
    b = np.random.default_rng(3).normal(size=600)
    np.testing.assert_allclose(A @ factor.solve(b), b, atol=1e-9)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_order_has_every_point_beside_its_mirror_image(shape):
    m, n = shape
    order = mirrored_order(shape)
    assert sorted(order) == list(range(m * n))
    u, v = order // n, order % n
    assert (np.diff(v) >= 0).all()
    pairs = u.reshape(n, m)[:, : m // 2 * 2].reshape(-1, 2)
    assert (pairs.sum(1) == m - 1).all()


def test_entries_that_are_stored_twice_add_up():
    A = sparse.coo_array(
        ([1.0, 1.0, 0.5, 0.5, 3.0], ([0, 0, 1, 0, 1], [0, 0, 0, 1, 1])), shape=(2, 2)
    )
    twice = sparse.csr_array(
        (np.array([1.0, 1.0, 0.5, 0.5, 3.0]), [0, 0, 1, 0, 1], [0, 3, 5]), shape=(2, 2)
    )
    x = banded_cholesky(twice, np.array([1, 0])).solve(np.ones(2))
    np.testing.assert_allclose(A.toarray() @ x, np.ones(2))


def test_right_sides_stay_as_they_are():
    A = normal_matrix((8, 9))
    B = np.ones((72, 2))
    banded_cholesky(A, mirrored_order((8, 9))).solve(B)
    assert (B == 1).all()


def test_not_positive_definite():
    A = sparse.csr_array(-normal_matrix((8, 9)))
    with pytest.raises(np.linalg.LinAlgError):
        banded_cholesky(A, mirrored_order((8, 9)))
