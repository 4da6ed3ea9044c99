"""Fixtures that the tests of the whole way from photos to a face share."""

import pytest
from bsface import reconstruct
from drawn_person import QUICK, draw, person


@pytest.fixture(scope="session")
def truth():
    return person()


@pytest.fixture(scope="session")
def drawn(truth):
    return draw(truth)


@pytest.fixture(scope="session")
def result(drawn):
    photos, marks = drawn
    return reconstruct(photos, QUICK, landmarks=marks)
