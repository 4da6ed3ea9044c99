"""Sentences on what the photos cannot tell."""

import numpy as np
import pytest
from bsface.camera.coverage import shortcomings

VARIED = np.array([1.0, 0.25, 0.15, 0.1])
ALL_SIDES = np.array([[y, 0, 0] for y in (-30, -20, 0, 0, 20, 30)], float)


def test_nothing_is_missing():
    assert shortcomings(ALL_SIDES, VARIED) == ()


@pytest.mark.parametrize(("sign", "side"), [(1, "left"), (-1, "right")])
def test_missing_side(sign, side):
    (sentence,) = shortcomings(sign * np.abs(ALL_SIDES), VARIED)
    assert f"turned to the {side} of the picture" in sentence


def test_all_frontal():
    assert len(shortcomings(ALL_SIDES * 0.1, VARIED)) == 2


def test_same_light():
    (sentence,) = shortcomings(ALL_SIDES, np.array([1.0, 0.01, 0.01]))
    assert "light" in sentence


def test_few_photos():
    assert "one photo" in shortcomings(ALL_SIDES[:1])[0]
    assert "Only 3 photos" in shortcomings(ALL_SIDES[:3], VARIED)[0]
    assert "Only 2 different photos" in shortcomings(ALL_SIDES[:3], copies=1)[0]
    assert "one photo" in shortcomings(ALL_SIDES[:3], copies=2)[0]


@pytest.mark.parametrize("count", range(7))
@pytest.mark.parametrize("values", [None, np.ones(1), VARIED])
def test_sentences_end_properly(count, values):
    for sentence in shortcomings(np.zeros((count, 3)), values):
        assert sentence[0].isupper()
        assert sentence.endswith(".")


def test_profiles_only():
    sides = np.array([[y, 0, 0] for y in (-80, -70, -60, 60, 70)], float)
    (sentence,) = shortcomings(sides, VARIED)
    assert "from the front" in sentence
    assert shortcomings(np.vstack([sides, np.zeros((1, 3))]), VARIED) == ()
