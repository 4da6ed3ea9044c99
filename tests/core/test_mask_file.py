"""Mask files beside photos: what is read of them, and what they change."""

import os
from dataclasses import replace

import cv2
import numpy as np
import pytest
from bsface.errors import PhotoFailure
from bsface.images.folder import scan_folder
from bsface.images.mask_file import (
    decode_mask,
    encode_mask,
    mask_file_beside,
    with_mask,
)
from bsface.images.photo import cut
from bsface.images.read import read_photo
from bsface.landmarks.candidates import files_beside
from bsface.photometry.skin import skin_masks
from bsface.prepare import Inputs, collect_photos
from bsface.settings import Settings
from bsface.surface.template import load_template
from fake_face import person_folder
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from skin_scenes import at_sides, masks_of, scene

GREY = 128


@pytest.fixture
def photo(tmp_path):
    """A photo of 60 x 40 pixels on disk."""
    path = tmp_path / "me 1.jpg"
    cv2.imwrite(str(path), np.full((40, 60, 3), 90, np.uint8))
    return path


@pytest.mark.parametrize("kind", ["link", "folder", "pipe"])
def test_a_mask_that_is_no_file_leaves_its_photo_out(photo, kind):
    """A link that broke when the folder was copied: not used without a word."""
    path = photo.with_suffix(".mask.png")
    if kind == "link":
        path.symlink_to(photo.with_name("gone.png"))
    elif kind == "folder":
        path.mkdir()
    else:
        os.mkfifo(path)
    found = with_mask(read_photo(photo))
    assert isinstance(found, PhotoFailure)
    assert "me 1.mask.png" in found.reason


def paint(photo, values):
    path = photo.with_name(f"{photo.stem}.mask.png")
    cv2.imwrite(str(path), np.asarray(values, np.uint8))
    return path


def test_a_mask_is_found_by_its_name_and_is_no_photo(photo):
    assert mask_file_beside(photo) is None
    path = paint(photo, np.zeros((40, 60)))
    assert mask_file_beside(photo) == path
    scan = scan_folder(photo.parent)
    assert scan.photos == (photo,) and not scan.passed_over and not scan.others


def test_a_mask_of_a_few_pixels_is_not_judged_as_a_face(photo):
    paint(photo, np.zeros((4, 4)))
    found = with_mask(read_photo(photo))
    assert found.reason == (
        "me 1.mask.png has only 4 x 4 pixels and needs 32 on each side; use a larger "
        "picture."
    )


@pytest.mark.parametrize("ending", [".MASK.PNG", ".Mask.png"])
def test_a_mask_whose_ending_is_in_capitals_is_found(photo, ending):
    path = paint(photo, np.zeros((40, 60)))
    path = path.rename(photo.with_name(f"me 1{ending}"))
    assert mask_file_beside(photo).name.lower() == "me 1.mask.png"
    assert (with_mask(read_photo(photo)).mask == 0).all()
    # A photo of another name, if only by its case, has none.
    assert mask_file_beside(photo.with_name("Me 2.jpg")) is None
    assert not scan_folder(photo.parent).passed_over


def test_landmarks_and_mask_lie_beside_a_photo(photo):
    assert files_beside(photo) == ()
    mask, points = paint(photo, np.zeros((40, 60))), photo.with_suffix(".pts")
    points.write_text("")
    assert files_beside(photo) == (points, mask)


def test_a_mask_or_landmark_file_without_a_photo_is_named(photo):
    paint(photo.with_name("you.jpg"), np.zeros((40, 60)))
    (passed_over,) = scan_folder(photo.parent).passed_over
    assert passed_over.name == "you.mask.png"
    assert passed_over.reason.startswith("you.mask.png is the mask of no photo")
    for name in ("you.pts", "me 1.PTS"):
        (photo.parent / name).touch()
    _, landmarks = scan_folder(photo.parent).passed_over
    assert landmarks.reason == (
        "you.pts is the landmark file of no photo here; name it as its photo."
    )


@pytest.mark.parametrize("ending", [".mask.jpg", ".Mask.TIF"])
def test_a_mask_of_another_format_is_named(photo, ending):
    path = paint(photo, np.zeros((40, 60)))
    path = path.rename(photo.with_name(photo.stem + ending))
    scan = scan_folder(photo.parent)
    (passed_over,) = scan.passed_over
    assert scan.photos == (photo,) and passed_over.name == path.name
    assert passed_over.reason.endswith("export it as .mask.png.")
    # Without the photo it is one, whatever its name.
    photo.unlink()
    assert scan_folder(photo.parent).photos == (path,)


def test_grey_levels_of_a_mask(photo):
    values = np.zeros((40, 60))
    values[:, 20:40], values[:, 40:] = GREY, 255
    paint(photo, values)
    mask = with_mask(read_photo(photo)).mask
    np.testing.assert_array_equal(mask[0, ::20], [0.0, 0.5, 1.0])


@pytest.mark.parametrize("kind", ["RGBA", "LA", "P", "16 bits"])
def test_what_is_transparent_says_nothing(photo, kind):
    """Colours under what is transparent are those of the paint program."""
    pixels = np.zeros((40, 60, 4), np.uint8)
    pixels[:, :20] = 255
    pixels[:, 20:40, 3] = 255
    if kind == "RGBA":
        pixels[:, 40:, 2] = 255
    if kind == "16 bits":
        paint_deep = cv2.imencode(".png", pixels.astype(np.uint16) * 257)[1]
        photo.with_name("me 1.mask.png").write_bytes(paint_deep.tobytes())
    elif kind == "P":
        levels = Image.fromarray(np.repeat(np.uint8([[1, 0, 2]]), 20, 1).repeat(40, 0))
        levels = levels.convert("P")
        levels.putpalette([0, 0, 0, 255, 255, 255, 255, 0, 0])
        levels.save(photo.with_name("me 1.mask.png"), transparency=2)
    else:
        picture = Image.fromarray(pixels, "RGBA").convert(kind)
        picture.save(photo.with_name("me 1.mask.png"))
    mask = with_mask(read_photo(photo)).mask
    np.testing.assert_array_equal(mask[0, ::20], [1.0, 0.0, 0.5])
    assert mask.shape == (40, 60)


def test_a_half_transparent_mask_is_half_of_what_it_says(photo):
    pixels = np.full((40, 60, 4), 255, np.uint8)
    pixels[..., 3] = 51
    Image.fromarray(pixels).save(photo.with_name("me 1.mask.png"))
    mask = with_mask(read_photo(photo)).mask
    np.testing.assert_allclose(mask, 0.2 + 0.8 * 0.5, atol=1e-6)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_a_written_mask_is_read_again(tmp_path_factory, seed):
    path = tmp_path_factory.mktemp("masks") / "a.png"
    cv2.imwrite(str(path), np.full((60, 40, 3), 90, np.uint8))
    mask = np.random.default_rng(seed).choice(
        np.float32([0, 0.2, 0.5, 0.9, 1]), (48, 32)
    )
    path.with_name("a.mask.png").write_bytes(encode_mask(mask))
    read = with_mask(read_photo(path)).mask
    np.testing.assert_allclose(read, mask, atol=0.5 / 255 + 1e-6)
    assert (read[mask == 0.5] == 0.5).all()
    np.testing.assert_array_equal(decode_mask(encode_mask(mask)), read)


def test_a_mask_that_is_given_wins_over_the_file(photo):
    paint(photo, np.zeros((40, 60)))
    found = with_mask(read_photo(photo), np.ones((20, 30), np.float32))
    assert (found.mask == 1).all()
    wrong = with_mask(read_photo(photo), np.ones((20, 20), np.float32))
    assert wrong.code == "unreadable" and "20 x 20" in wrong.reason


def test_a_photo_without_a_mask_stays_as_it_is(photo):
    read = read_photo(photo)
    assert with_mask(read) is read and read.mask is None


def test_a_mask_stays_with_the_cut_out(photo):
    paint(photo, np.full((40, 60), 255))
    whole = with_mask(read_photo(photo))
    assert cut(whole, (10, 10, 30, 30)).mask is whole.mask


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"no picture", "me 1.mask.png"),
        (b"", "me 1.mask.png"),
        (cv2.imencode(".png", np.zeros((60, 40)))[1].tobytes(), "40 x 60 pixels"),
        # A cut-out of the photo, or a mask painted in red.
        (cv2.imencode(".png", np.full((40, 60, 3), (0, 0, 255)))[1], "a mask is grey"),
    ],
)
def test_a_mask_that_cannot_be_used_is_told(photo, content, words):
    photo.with_name("me 1.mask.png").write_bytes(content)
    found = with_mask(read_photo(photo))
    assert isinstance(found, PhotoFailure)
    assert (found.name, found.code) == ("me 1.jpg", "unreadable")
    assert words in found.reason and "\n" not in found.reason


def test_one_bad_mask_leaves_the_other_photos(tmp_path):
    person_folder(tmp_path, count=3, side=160)
    photos = scan_folder(tmp_path).photos
    photos[1].with_name(f"{photos[1].stem}.mask.png").write_bytes(b"no picture")
    found = collect_photos(tmp_path, Settings(detector=False, one_person=False))
    assert [item.name for item in found.failures] == [photos[1].name]
    assert len(found.photos) == 2


def test_masks_that_are_given_reach_their_photos(tmp_path):
    person_folder(tmp_path, count=2, side=160)
    first, second = scan_folder(tmp_path).photos
    mask = np.full((20, 20), 0.25, np.float32)
    inputs = Inputs(masks={first.name: mask})
    found = collect_photos(
        tmp_path, Settings(detector=False, one_person=False), inputs
    ).photos
    assert found[0].mask is mask and found[1].mask is None


# --- what they change ----------------------------------------------------------------


def with_given(scenes, values):
    """The scenes, the first with this mask of 24 x 24 pixels."""
    (photo, camera), *rest = scenes
    mask = np.broadcast_to(np.float32(values), (24, 24)).copy()
    return [(replace(photo, mask=mask), camera), *rest]


SCENES = [scene(yaw) for yaw in (0, 4, 8)]


def test_half_grey_changes_nothing():
    np.testing.assert_array_equal(at_sides(with_given(SCENES, 0.5)), at_sides(SCENES))


def test_black_is_not_skin_and_white_is_whatever_was_measured():
    measured = at_sides(SCENES)
    black, white = (at_sides(with_given(SCENES, x)) for x in (0.0, 1.0))
    np.testing.assert_allclose(black[0], 0, atol=1e-6)
    np.testing.assert_allclose(white[0], 1, atol=1e-6)
    np.testing.assert_array_equal(black[1:], measured[1:])


def test_what_was_measured_is_kept_beside_the_correction():
    measured, black = masks_of(SCENES)[0], masks_of(with_given(SCENES, 0.0))[0]
    assert measured.measured is None
    np.testing.assert_array_equal(black.measured, measured.values)


@settings(max_examples=5, deadline=None)
@given(st.floats(0, 1, width=32), st.floats(0, 1, width=32))
def test_a_brighter_mask_never_means_less_skin(a, b):
    low, high = (masks_of(with_given(SCENES, x))[0] for x in sorted((a, b)))
    assert (high.values >= low.values - 1e-6).all()
    assert low.values.min() >= 0 and high.values.max() <= 1


def test_a_photo_that_is_not_measured_takes_its_mask_alone():
    (photo, camera), *rest = with_given(SCENES, 0.25)
    away = replace(camera, t=(5000.0, 0.0))
    template = load_template()
    photos = [photo, *(p for p, _ in rest)]
    cameras = [away, *(c for _, c in rest)]
    (mask, *_) = skin_masks(photos, template.surface, cameras, template)
    np.testing.assert_allclose(mask.values, 0.5)
