"""The number of threads of the dense algebra."""

import numpy as np
import pytest
from bsface.threads import _controls, one_blas_thread


def counts():
    return [get() for get, _ in _controls()]


def test_wheels_of_numpy_and_scipy_are_found():
    """NumPy's, SciPy's, or the one that they share."""
    config = np.show_config(mode="dicts")
    blas = config["Build Dependencies"]["blas"]["name"]
    if "openblas" not in blas:
        pytest.skip(f"NumPy is built with {blas}")
    assert len(_controls()) >= 1


def test_one_thread_inside_and_the_old_number_after():
    before = counts()
    for _, set_ in _controls():
        set_(2)
    try:
        with one_blas_thread():
            assert set(counts()) <= {1}
            with one_blas_thread():
                assert set(counts()) <= {1}
            assert set(counts()) <= {1}
        assert set(counts()) <= {2}
        with pytest.raises(KeyError), one_blas_thread():
            raise KeyError
        assert set(counts()) <= {2}
    finally:
        for (_, set_), count in zip(_controls(), before, strict=True):
            set_(count)
    assert counts() == before
