"""Fixtures that the tests of the library share."""

import pytest
from bsface import ReconstructionError
from bsface.images.read import read_photo
from bsface.landmarks.face_models import find_models
from photo_folders import PHOTOS


@pytest.fixture(scope="session")
def models():
    """Where the networks' files are."""
    try:
        return find_models()
    except ReconstructionError as error:
        pytest.skip(f"the model files are not installed: {error}")


@pytest.fixture(scope="module")
def picture():
    """Pixels of an example photo."""
    return read_photo(PHOTOS / "000.jpg").pixels


@pytest.fixture
def folder(tmp_path):
    """An empty folder for photos."""
    path = tmp_path / "photos"
    path.mkdir()
    return path
