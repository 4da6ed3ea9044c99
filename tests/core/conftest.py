"""Fixtures that the tests of the library share."""

import pytest
from bsface import ReconstructionError
from bsface.landmarks.face_models import find_models


@pytest.fixture(scope="session")
def models():
    """Where the networks' files are."""
    try:
        return find_models()
    except ReconstructionError as gone:
        pytest.skip(f"the model files are not installed: {gone}")
