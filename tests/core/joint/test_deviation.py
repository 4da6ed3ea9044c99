"""How sure the joint method is of each control point."""

import numpy as np
import pytest
from bsface.solve.joint.marginal import displacement_deviation
from bsface.solve.joint.method import MIXED_POWER, model_error
from bsface.solve.joint.options import JointOptions
from joint_dense import full_system


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
    assert abs(np.median(ratio) - 1) < 0.07


def test_what_the_matrix_cannot_know_grows_with_the_noise_of_mixed_expressions():
    noise = 0.06 * np.array([[0.5], [1.5], [2.5]])
    plain = model_error(noise, 0.06, photos=40, mixed=False)
    found = model_error(noise, 0.06, photos=40, mixed=True)
    assert found > plain
    double = model_error(2 * noise, 0.06, photos=40, mixed=True)
    assert double == pytest.approx(2**MIXED_POWER * found)
    assert model_error(2 * noise, 0.12, photos=40, mixed=True) == pytest.approx(found)
    assert model_error(0.001, 0.06, photos=40, mixed=True) == plain


def test_what_the_matrix_cannot_know_is_less_the_more_photos_there_are():
    errors = [model_error(0.06, 0.06, photos=n, mixed=False) for n in (5, 20, 40, 320)]
    assert errors[0] == pytest.approx(2 * errors[1])
    assert errors[1] > errors[2] == errors[3]  # not measured for more
