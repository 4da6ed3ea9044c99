"""The focal length that a phone writes into a video, in pixels of its frames."""

import math
import struct

import numpy as np
import pytest
from bsface.images.video import read_video
from bsface.images.video_focal_length import film_focal_mm
from hypothesis import given
from hypothesis import strategies as st
from videos_for_tests import (
    turned_clip,
    with_metadata,
    with_pixel_aspect,
    write_clip,
)

KEY = "com.apple.quicktime.camera.focal_length.35mm_equivalent"
LENS = "com.apple.quicktime.camera.lens_model"
TEXT, SIGNED, UNSIGNED, SINGLE, DOUBLE = 1, 21, 22, 23, 24
DIAGONALS = 26 / math.hypot(36, 24)


def clip(path, width=64, height=48):
    ramp = np.linspace(0, 255, width).astype(np.uint8)
    frame = np.broadcast_to(ramp[:, None], (height, width, 3))
    return write_clip(path, [frame, frame[:, ::-1]])


def focal_of(path):
    return [photo.focal_px for photo in read_video(path).photos()]


@pytest.mark.parametrize("level", ["track", "file"])
@pytest.mark.parametrize("plain", [True, False], ids=["QuickTime", "MP4"])
@pytest.mark.parametrize(
    ("kind", "value"),
    [
        (TEXT, b"26"),
        (TEXT, b"26.00mm"),
        (SIGNED, struct.pack(">b", 26)),
        (SIGNED, struct.pack(">i", 26)),
        (UNSIGNED, struct.pack(">H", 26)),
        (UNSIGNED, struct.pack(">Q", 26)),
        (SINGLE, struct.pack(">f", 26)),
        (DOUBLE, struct.pack(">d", 26)),
    ],
)
def test_every_form_that_it_is_written_in(tmp_path, level, plain, kind, value):
    path = clip(tmp_path / "a.mov")
    said = [(LENS, TEXT, b"front camera 2.71mm f/1.9"), (KEY, kind, value)]
    with_metadata(path, said, level=level, plain=plain)
    assert focal_of(path) == pytest.approx([DIAGONALS * 80] * 2)


def test_a_turned_clip_has_the_same(tmp_path):
    path = clip(tmp_path / "a.mp4")
    with_metadata(path, [(KEY, TEXT, b"26")])
    turned_clip(path)
    assert focal_of(path) == pytest.approx([DIAGONALS * 80] * 2)


def test_pixels_that_are_not_square(tmp_path):
    """The diagonal is that of the frames as they are shown."""
    path = clip(tmp_path / "a.mp4", width=48)
    with_metadata(path, [(KEY, TEXT, b"26")])
    assert focal_of(path) == [None, None]  # 1 : 1
    with_pixel_aspect(path, 4, 3)
    assert focal_of(path) == pytest.approx([DIAGONALS * 80] * 2)


@pytest.mark.parametrize(
    "said",
    [
        [],
        [(LENS, TEXT, b"26")],
        [(KEY, TEXT, b"wide")],
        [(KEY, TEXT, b"0")],
        [(KEY, SINGLE, struct.pack(">f", math.nan))],
        [(KEY, SINGLE, struct.pack(">f", math.inf))],
        [(KEY, SIGNED, struct.pack(">b", -26))],
        [(KEY, SIGNED, b"123")],
        [(KEY, 99, b"26")],
    ],
)
def test_what_is_no_focal_length(tmp_path, said):
    path = clip(tmp_path / "a.mp4")
    with_metadata(path, said)
    assert film_focal_mm(path) == 0
    assert focal_of(path) == [None, None]


def test_a_track_without_it_does_not_hide_the_file(tmp_path):
    path = clip(tmp_path / "a.mp4")
    with_metadata(path, [(LENS, TEXT, b"26")], level="track")
    with_metadata(path, [(KEY, TEXT, b"31")], level="file")
    assert film_focal_mm(path) == 31


@pytest.mark.parametrize("ending", [".avi", ".webm", ".mkv"])
def test_other_files_do_not_say_it(tmp_path, ending):
    assert film_focal_mm(clip(tmp_path / f"a{ending}")) == 0


@pytest.fixture(scope="module")
def phone_clip(tmp_path_factory):
    path = clip(tmp_path_factory.mktemp("phone") / "a.mov")
    with_metadata(path, [(KEY, TEXT, b"26")], plain=True)
    return path.read_bytes()


@given(st.data())
def test_damaged_files_are_read_without_an_error(tmp_path_factory, phone_clip, data):
    file = bytearray(phone_clip)
    first = phone_clip.index(b"moov")
    for _ in range(data.draw(st.integers(1, 6))):
        at = data.draw(st.integers(first, len(file) - 1))
        file[at] = data.draw(st.integers(0, 255))
    path = tmp_path_factory.getbasetemp() / "damaged.mov"
    path.write_bytes(file[: data.draw(st.integers(0, len(file)))])
    found = film_focal_mm(path)
    assert math.isfinite(found) and found >= 0
