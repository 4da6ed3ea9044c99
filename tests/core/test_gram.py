"""Products by SciPy's BLAS are those of the definition."""

import numpy as np
import pytest
from bsface.gram import gram, product

RANDOM = np.random.default_rng(4)


@pytest.mark.parametrize("shape", [(1, 1), (7, 3), (3, 7), (200, 60)])
def test_gram(shape):
    A = RANDOM.normal(size=shape)
    found = gram(A)
    np.testing.assert_allclose(found, np.einsum("pi,pj->ij", A, A), atol=1e-12)
    assert np.array_equal(found, found.T)


def test_gram_of_a_part_of_an_array():
    whole = RANDOM.normal(size=(20, 9))
    before = whole.copy()
    np.testing.assert_array_equal(gram(whole[:, :-1]), gram(whole[:, :-1].copy()))
    assert np.array_equal(whole, before)


@pytest.mark.parametrize("turned", [False, True])
def test_product(turned):
    A, B = RANDOM.normal(size=(8, 5)), RANDOM.normal(size=(5, 11))
    A = np.asfortranarray(A) if turned else A
    found = product(A, B)
    np.testing.assert_allclose(found, np.einsum("pq,qr->pr", A, B), atol=1e-12)
    assert found.flags.c_contiguous
