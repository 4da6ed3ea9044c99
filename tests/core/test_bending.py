"""Bending energy and mass: what they integrate, and what they leave alone."""

import numpy as np
import pytest
import reference
from bsface.surface.bending import bending_matrix, mass_matrix

SHAPES = [(4, 4), (5, 8), (9, 6)]


def energy(matrix, d):
    d = d.reshape(matrix.shape[0], -1)
    return float((d * (matrix @ d)).sum())


def integrals(shape, d):
    """Bending energy and mass by a Gauss rule on the dense basis functions."""
    rules = [reference.quadrature(s - 3, 5) for s in shape]
    (x, wx), (y, wy) = rules
    weight = wx[:, None] * wy

    def field(du, dv):
        left = np.array([reference.basis_row(shape[0], t, du) for t in x])
        right = np.array([reference.basis_row(shape[1], t, dv) for t in y])
        return np.einsum("pm,mnk,qn->pqk", left, d, right)

    square = [(field(*k) ** 2).sum(-1) for k in ((2, 0), (1, 1), (0, 2), (0, 0))]
    bending = (weight * (square[0] + 2 * square[1] + square[2])).sum()
    return bending, (weight * square[3]).sum()


@pytest.mark.parametrize("shape", SHAPES)
def test_equal_to_quadrature_of_the_definition(shape):
    d = np.random.default_rng(0).normal(size=(*shape, 3))
    bending, mass = integrals(shape, d)
    np.testing.assert_allclose(energy(bending_matrix(shape), d), bending, rtol=1e-10)
    np.testing.assert_allclose(energy(mass_matrix(shape), d), mass, rtol=1e-10)


@pytest.mark.parametrize("shape", SHAPES)
def test_linear_fields_do_not_bend(shape):
    for term in ((0, 0), (1, 0), (0, 1)):
        d = reference.polynomial_control_points(shape, {term: (3.0, -2, 1)})
        assert abs(energy(bending_matrix(shape), d)) < 1e-9


@pytest.mark.parametrize("shape", SHAPES)
def test_energies_of_polynomials_in_closed_form(shape):
    """uv twists by 1 everywhere: 2; u^2 bends by 2: 4; their masses are 1/9 and 1/5."""
    for term, bending, mass in (((1, 1), 2.0, 1 / 9), ((2, 0), 4.0, 1 / 5)):
        d = reference.polynomial_control_points(shape, {term: (1.0, 0, 0)})
        np.testing.assert_allclose(energy(bending_matrix(shape), d), bending)
        np.testing.assert_allclose(energy(mass_matrix(shape), d), mass)


@pytest.mark.parametrize("shape", SHAPES)
def test_null_space_is_the_planes_and_nothing_else(shape):
    K = bending_matrix(shape).toarray()
    np.testing.assert_allclose(K, K.T, atol=1e-9 * np.abs(K).max())
    values = np.linalg.eigvalsh(K)
    assert np.abs(values[:3]).max() < 1e-9 * values[-1]
    assert values[3] > 1e-7 * values[-1]
    assert np.linalg.eigvalsh(mass_matrix(shape).toarray()).min() > 0


def test_energy_does_not_depend_on_the_net():
    """One surface, two nets: the integral is the same."""
    terms = {(2, 1): (1.0, 2, 0), (1, 2): (0.5, 0, 1), (3, 0): (0, 0, 2.0)}
    values = [
        energy(bending_matrix(s), reference.polynomial_control_points(s, terms))
        for s in ((4, 4), (7, 12))
    ]
    np.testing.assert_allclose(*values, rtol=1e-9)


def test_mirroring_does_not_change_the_energy():
    d = np.random.default_rng(1).normal(size=(6, 8, 3))
    K = bending_matrix((6, 8))
    np.testing.assert_allclose(energy(K, d[::-1]), energy(K, d))
    np.testing.assert_allclose(energy(K, d[:, ::-1]), energy(K, d))
    turned = energy(bending_matrix((8, 6)), d.transpose(1, 0, 2))
    np.testing.assert_allclose(turned, energy(K, d))
