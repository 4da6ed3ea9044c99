"""Drawings and paintings among the photos get a doubt; bad photos get none."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from bsface.errors import ReconstructionError
from bsface.landmarks.candidates import CandidateReader
from bsface.landmarks.drawn import FEW_LEVELS, looks_drawn, missing_levels
from bsface.landmarks.face_models import find_models
from bsface.prepare import collect_photos
from bsface.progress import never_cancelled
from bsface.settings import Settings
from bsface.surface.template import load_template
from drawings_for_tests import DRAWINGS, PHOTOS, few_colours
from hypothesis import given, settings
from hypothesis import strategies as st

EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "photos"
CHOSEN = ("000.jpg", "011.jpg", "020.jpg")


@pytest.fixture(scope="module")
def faces():
    try:
        find_models()
    except ReconstructionError as error:
        pytest.skip(f"no face models: {error}")
    reader = CandidateReader(load_template(), Settings(), {})
    return [reader.read(EXAMPLES / n, n, never_cancelled)[0] for n in CHOSEN]


@pytest.mark.parametrize("style", ["6 colours", "12 colours", "5 levels", "comic"])
def test_drawings_are_told(faces, style):
    """Those that all copies of photos are found of; others: benchmarks/drawn.py."""
    for face in faces:
        drawing = replace(face.photo, pixels=DRAWINGS[style](face.photo.pixels))
        assert looks_drawn(drawing, face.landmarks, face.fit)


@pytest.mark.parametrize("style", PHOTOS)
def test_photos_are_not(faces, style):
    for face in faces:
        photo = replace(face.photo, pixels=PHOTOS[style](face.photo.pixels))
        assert not looks_drawn(photo, face.landmarks, face.fit)


def test_what_surrounds_the_face_does_not_count(faces):
    """A photo in a comic, and a photo on a white page."""
    face = faces[0]
    drawing = DRAWINGS["comic"](face.photo.pixels)
    xy = face.photo.to_window(face.landmarks.points)
    hull = cv2.convexHull(np.rint(xy).astype(np.int32))
    inside = cv2.fillConvexPoly(np.zeros(drawing.shape[:2], np.uint8), hull, 1)
    for around in (drawing, np.full_like(drawing, 255)):
        mixed = np.where(inside[..., None] > 0, face.photo.pixels, around)
        assert not looks_drawn(
            replace(face.photo, pixels=mixed), face.landmarks, face.fit
        )


def test_a_drawing_is_named_and_used(faces):
    pictures = [cv2.imread(str(EXAMPLES / name))[..., ::-1] for name in CHOSEN]
    pictures[1] = few_colours(pictures[1], 10)
    found = collect_photos(pictures)
    assert len(found.photos) == 3
    (said,) = [s for s in found.identity_warnings if "drawn" in s]
    assert said.startswith("picture 2 may be drawn, painted")
    assert "drawn" in found.landmarks[1].note
    assert not found.landmarks[0].note and not found.landmarks[2].note


@settings(max_examples=50)
@given(st.floats(20, 30), st.floats(110, 145), st.integers(0, 99))
def test_levels_of_normal_distributions_and_of_few_values(width, mean, seed):
    values = np.random.default_rng(seed).normal(mean, width, 4000)
    levels = np.clip(np.round(values), 0, 255).astype(np.uint8)
    # A sample of n in k levels seems to have (k - 1) / (2 n ln 2) bits less.
    assert -0.02 < missing_levels(levels) < 0.1
    few = (levels // 32 * 32 + 16).astype(np.uint8)
    assert missing_levels(few) > FEW_LEVELS
