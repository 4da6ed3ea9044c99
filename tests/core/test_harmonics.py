"""Spherical harmonics of the normal: values, slopes, turns, and what they can shade."""

import numpy as np
import pytest
import reference
from bsface.photometry import harmonics
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

seeds = st.integers(0, 2**32 - 1)
ORDERS = [4, 9]


def directions(seed, count=20):
    n = np.random.default_rng(seed).normal(size=(count, 3))
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def sphere(count=40):
    """Nodes and weights that integrate polynomials over the unit sphere exactly."""
    z, w = np.polynomial.legendre.leggauss(count)
    angle = np.arange(2 * count) * np.pi / count
    r = np.sqrt(1 - z * z)
    n = np.stack(
        [
            np.outer(r, np.cos(angle)),
            np.outer(r, np.sin(angle)),
            np.outer(z, np.ones_like(angle)),
        ],
        -1,
    )
    return n.reshape(-1, 3), np.repeat(w * np.pi / count, 2 * count)


def test_order_of_the_functions():
    x, y, z = n = np.array([0.6, -0.48, 0.64])
    expected = [1, x, y, z, x * y, x * z, y * z, x * x - y * y, 3 * z * z - 1]
    np.testing.assert_allclose(harmonics.basis(n), expected)
    np.testing.assert_allclose(harmonics.basis(n, 4), expected[:4])


def test_functions_are_orthogonal():
    n, w = sphere()
    Y = harmonics.basis(n)
    gram = Y.T @ (w[:, None] * Y)
    np.testing.assert_allclose(gram, np.diag(np.diag(gram)), atol=1e-12)


@pytest.mark.parametrize("order", ORDERS)
@given(seed=seeds)
def test_slope_is_the_derivative(order, seed):
    n = directions(seed)
    expected = reference.numerical_derivative(
        lambda e: harmonics.basis(n + e, order), 3, 1e-5
    )
    np.testing.assert_allclose(harmonics.slope(n, order), expected, atol=1e-8)


@pytest.mark.parametrize("order", ORDERS)
@given(seed=seeds)
def test_light_turned_with_the_head_shades_the_same(order, seed):
    rng = np.random.default_rng(seed)
    R = Rotation.from_rotvec(rng.normal(0, 2, 3)).as_matrix()
    n, lights = directions(seed), rng.normal(size=(3, order))
    turned = lights @ harmonics.rotation(R, order)
    np.testing.assert_allclose(
        turned @ harmonics.basis(n @ R.T, order).T,
        lights @ harmonics.basis(n, order).T,
        atol=1e-10,
    )


@given(seed=seeds)
def test_turns_compose(seed):
    one, two = Rotation.random(2, random_state=seed % 2**32).as_matrix()
    np.testing.assert_allclose(
        harmonics.rotation(one) @ harmonics.rotation(two),
        harmonics.rotation(two @ one),
        atol=1e-10,
    )


@pytest.mark.parametrize(("order", "most"), [(4, 0.13), (9, 0.009)])
def test_what_is_lost_of_a_distant_light(order, most):
    """Basri and Jacobs: 4 functions hold 87.5 % of the cosine lobe, 9 hold 99.2 %."""
    n, w = sphere(80)
    light = np.array([0.36, 0.48, 0.8])
    shading = np.maximum(n @ light, 0)
    root = np.sqrt(w)[:, None]
    Y = harmonics.basis(n, order) * root
    _, rest, *_ = np.linalg.lstsq(Y, shading * root[:, 0], rcond=None)
    assert rest[0] / (w @ shading**2) < most
