"""All faces of one photo."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from bsface.errors import PhotoFailure, ReconstructionError
from bsface.landmarks.all_faces import faces_in
from bsface.landmarks.face_models import find_models

PHOTOS = Path(__file__).resolve().parents[2] / "examples" / "photos"


@pytest.fixture(scope="module")
def picture():
    try:
        find_models()
    except ReconstructionError as error:
        pytest.skip(f"no face models: {error}")
    return cv2.imread(str(PHOTOS / "000.jpg"))[..., ::-1]


def test_two_faces_come_from_left_to_right(picture):
    pair = np.concatenate([picture, picture[:, ::-1]], axis=1)
    found = faces_in(pair, "pair")
    assert len(found) == 2 and all(face.faces == 2 for face in found)
    left, right = (face.points[:, 0].mean() for face in found)
    width = picture.shape[1]
    assert left < width < right


def test_no_face_is_a_failure_with_a_sentence(picture):
    found = faces_in(np.full((200, 200, 3), 128, np.uint8), "wall")
    assert isinstance(found, PhotoFailure) and "wall" in found.reason
