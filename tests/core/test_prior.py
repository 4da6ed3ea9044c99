"""The shape prior: a Gaussian, so everything is a dense matrix away."""

from dataclasses import replace

import numpy as np
import pytest
from bsface.surface.bending import bending_matrix
from bsface.surface.bspline import basis_matrix
from bsface.surface.prior import ASYMMETRY, shape_prior
from few_modes import few_modes
from scipy import sparse

SHAPE = (8, 9)
COUNT = SHAPE[0] * SHAPE[1]


@pytest.fixture(scope="module")
def template():
    return few_modes(SHAPE, identity=3, expression=2)


@pytest.fixture(scope="module")
def prior(template):
    return shape_prior(template, 1.5, 0.5, smooth_mm=2.0, smooth_length=0.3)


def dense_covariance(prior):
    """Covariance of all control points, x y z interleaved."""
    smooth = np.linalg.inv(prior.smooth.toarray())
    flat = prior.modes.reshape(len(prior.modes), -1)
    return flat.T @ flat + np.kron(smooth, np.eye(3))


def test_covariance_is_the_inverse_precision_plus_the_modes(prior):
    rng = np.random.default_rng(0)
    near, far = rng.random((2, 4, 2))
    rows = basis_matrix(SHAPE, *far.T)
    T_near, T_far = (
        np.kron(basis_matrix(SHAPE, *uv.T).toarray(), np.eye(3)) for uv in (near, far)
    )
    expected = T_far @ dense_covariance(prior) @ T_near.T
    found = prior.displacement_covariance(near, rows)
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
    control = prior.displacement_covariance(near, sparse.eye_array(COUNT, format="csr"))
    np.testing.assert_allclose(
        control, dense_covariance(prior) @ T_near.T, atol=1e-9 * np.abs(control).max()
    )


def test_modes_have_their_factors(prior, template):
    modes = prior.modes.reshape(5, *SHAPE, 3)
    np.testing.assert_allclose(modes[:3], 1.5 * template.identity_modes)
    np.testing.assert_allclose(modes[3:], 0.5 * template.expression_modes)


@pytest.mark.parametrize("length", [0.05, 0.12, 0.6])
@pytest.mark.parametrize("size", [0.1, 3.0])
def test_smooth_part_has_the_wanted_size(template, size, length):
    """Its standard deviation in the middle of the face is as asked, in each axis."""
    prior = shape_prior(template, 0.0, 0.0, size, length)
    middle = np.array([[0.5, 0.5]])
    covariance = prior.displacement_covariance(middle, basis_matrix(SHAPE, *middle.T))
    np.testing.assert_allclose(covariance, size**2 * np.eye(3), rtol=1e-6, atol=1e-9)


def test_smooth_part_fades_over_its_length(template):
    def correlation(length, away):
        prior = shape_prior(template, 0.0, 0.0, 1.0, length)
        uv = np.array([[0.5, 0.5], [0.5 + away, 0.5]])
        c = prior.displacement_covariance(uv, basis_matrix(SHAPE, *uv.T))[::3, ::3]
        return c[0, 1] / np.sqrt(c[0, 0] * c[1, 1])

    assert correlation(0.4, 0.3) > correlation(0.15, 0.3) > correlation(0.05, 0.3) - 0.1
    assert abs(correlation(0.1, 0.45)) < 0.2
    assert correlation(0.6, 0.1) > 0.9


def test_smooth_part_prefers_what_bends_less(prior):
    """Of two displacements of one size the wavy one is the less likely."""
    u = (np.arange(SHAPE[0]) - 1) / (SHAPE[0] - 3)
    flat = np.repeat(u, SHAPE[1])
    wavy = np.repeat((-1.0) ** np.arange(SHAPE[0]), SHAPE[1])
    cost = [d @ (prior.smooth @ d) / (d @ d) for d in (flat, wavy)]
    assert cost[0] < 0.1 * cost[1]
    K = bending_matrix(SHAPE)
    assert cost[1] > (wavy @ (K @ wavy)) / (wavy @ wavy) * 1e-9


def test_what_differs_between_the_halves_is_less_likely(prior):
    d = np.random.default_rng(5).normal(size=SHAPE)
    alike, different = (d + d[::-1]).ravel(), (d - d[::-1]).ravel()
    for part, factor in ((alike, 1.0), (different, ASYMMETRY**-2)):
        found = part @ (prior.along_normals @ part)
        assert found == pytest.approx(factor * (part @ (prior.smooth @ part)))
    assert abs(alike @ (prior.along_normals @ different)) < 1e-9 * found


def test_mean_given_landmarks(prior):
    """The two parts add up to the covariance times the forces."""
    rng = np.random.default_rng(1)
    uv, forces = rng.random((6, 2)), rng.normal(size=(6, 3))
    modes, smooth = prior.split(uv, forces)
    together = np.einsum("k,kbx->bx", modes, prior.modes) + smooth
    T = np.kron(basis_matrix(SHAPE, *uv.T).toarray(), np.eye(3))
    expected = dense_covariance(prior) @ T.T @ forces.ravel()
    np.testing.assert_allclose(together.ravel(), expected, rtol=1e-8)


def test_without_modes(template):
    bare = replace(
        template,
        identity_modes=np.zeros((0, *SHAPE, 3)),
        expression_modes=np.zeros((0, *SHAPE, 3)),
    )
    prior = shape_prior(bare, 1.0, 1.0, 1.0, 0.2)
    assert prior.modes.shape == (0, COUNT, 3)
    uv = np.array([[0.3, 0.4]])
    modes, smooth = prior.split(uv, np.ones((1, 3)))
    assert modes.shape == (0,)
    assert np.isfinite(smooth).all()
