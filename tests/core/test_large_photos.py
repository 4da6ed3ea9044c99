"""Which of many photos stay large, and which of them a texture is made of."""

from dataclasses import replace

import numpy as np
import pytest
from bsface.errors import PhotoFailure
from bsface.images.photo import reduced
from bsface.landmarks.face_selection import Candidate
from bsface.landmarks.large_photos import SMALL, few_large
from bsface.landmarks.plausibility import fit_landmarks
from bsface.texture.choice import differing_photos, with_photos
from fake_face import painted_reconstruction

TIMES = 4


@pytest.fixture(scope="module")
def painted():
    return painted_reconstruction(count=6)


@pytest.fixture(scope="module")
def faces(painted):
    """A face of each photo, the photos four times as large."""
    template, found = painted.template, []
    for photo, marks in zip(painted.photos, painted.landmarks, strict=True):
        pixels = photo.pixels.repeat(TIMES, axis=0).repeat(TIMES, axis=1)
        large = replace(photo, pixels=pixels, window=(0.0, 0.0, float(TIMES)))
        fit = fit_landmarks(template, marks.points, marks.scheme, marks.weight)
        found.append((Candidate(large, marks, fit),))
    return found


def side(face):
    return max(face.photo.pixels.shape[:2])


def test_few_photos_stay_as_they_are(faces):
    found = [*faces, PhotoFailure("x.jpg", "dark", "x.jpg is dark.")]
    assert few_large(found, most=3, slack=3) == found
    assert few_large(found, most=6, slack=0) == found


def test_of_many_photos_those_that_differ_stay_large(faces):
    """Of near-equal pairs one photo stays."""
    refused = PhotoFailure("x.jpg", "dark", "x.jpg is dark.")
    pairs = [faces[k // 2] for k in range(12)]
    found = few_large([refused, *pairs], most=6, slack=0)
    assert found[0] is refused
    sizes = [side(face) for (face,) in found[1:]]
    assert sorted({k // 2 for k in range(12) if sizes[k] > SMALL}) == list(range(6))
    assert sorted(sizes) == [SMALL] * 6 + [200 * TIMES] * 6


def test_faces_of_no_use_do_not_stay_large(faces):
    dark = PhotoFailure("x.jpg", "dark", "x.jpg is dark.")
    spoilt = [(replace(face, failure=dark),) for (face,) in faces[:3]]
    found = few_large([*spoilt, *faces[3:]], most=3, slack=0)
    sizes = [side(face) for (face,) in found]
    assert sizes == [SMALL] * 3 + [200 * TIMES] * 3


def test_a_smaller_photo_shows_the_same_at_the_same_place(painted, faces):
    found = few_large([faces[0], faces[1]], most=1, slack=0)
    (smaller,) = (face for (face,) in found if side(face) <= SMALL)
    whole = next(p for p in painted.photos if p.name == smaller.photo.name)
    y, x = np.mgrid[40:160:7, 40:160:7]
    at = smaller.photo.to_window(np.stack([x, y], -1))
    column, row = np.round(at).astype(int).transpose(2, 0, 1)
    shown = smaller.photo.pixels[row, column].astype(int)
    assert np.median(np.abs(shown - whole.pixels[y, x])) <= 2


def test_a_texture_is_made_of_photos_that_differ(painted):
    """Every photo three times: each of them is taken once."""
    many = with_photos(painted, [k % 6 for k in range(18)])
    chosen = differing_photos(many, limit=6)
    assert sorted(k % 6 for k in chosen) == list(range(6))
    assert differing_photos(many, limit=18) == list(range(18))
    some = with_photos(many, chosen)
    names = [photo.name for photo in some.photos]
    assert names == [many.photos[k].name for k in chosen]
    assert [found.photo for found in some.landmarks] == names
    np.testing.assert_array_equal(some.expressions, many.expressions[chosen])


def test_large_photos_go_before_small_ones(painted, faces):
    """The same photos, and once more at half the size: the large ones are taken."""
    large = [face.photo for (face,) in faces]
    half = [reduced(photo, 100 * TIMES) for photo in large]
    both = replace(with_photos(painted, [*range(6)] * 2), photos=(*half, *large))
    assert differing_photos(both, limit=6) == list(range(6, 12))
