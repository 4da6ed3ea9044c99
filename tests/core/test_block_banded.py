"""The factor of net matrices against dense algebra."""

import numpy as np
import pytest
from bsface.solve.joint.block_banded import block_cholesky
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
def test_solutions_and_halves(shape):
    A = normal_matrix(shape)
    dense = A.toarray()
    factor = block_cholesky(A, shape)
    B = np.random.default_rng(1).normal(size=(len(dense), 5))
    np.testing.assert_allclose(factor.solve(B), np.linalg.solve(dense, B), rtol=1e-8)
    np.testing.assert_allclose(factor.solve(B[:, 0]), factor.solve(B)[:, 0])
    half = factor.half(B)
    np.testing.assert_allclose(half.T @ half, B.T @ factor.solve(B), rtol=1e-8)
    np.testing.assert_allclose(factor.other_half(half), factor.solve(B))


@pytest.mark.parametrize("shape", SHAPES)
def test_the_factor_is_that_of_the_matrix(shape):
    A = normal_matrix(shape, seed=2)
    L = np.linalg.cholesky(A.toarray())
    factor = block_cholesky(A, shape)
    np.testing.assert_allclose(factor.half(L), np.eye(len(L)), atol=1e-8)


def test_right_sides_stay_as_they_are():
    A = normal_matrix((8, 9))
    B = np.ones((72, 2))
    block_cholesky(A, (8, 9)).solve(B)
    assert (B == 1).all()


def test_not_positive_definite():
    A = sparse.csr_array(-normal_matrix((8, 9)))
    with pytest.raises(np.linalg.LinAlgError):
        block_cholesky(A, (8, 9))
