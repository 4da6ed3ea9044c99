"""The size that a coded frame states, of real streams and of any bytes."""

import cv2
import numpy as np
import pytest
from bsface.images.capture import opened
from bsface.images.frame_size import size_change, stated_size
from hypothesis import given
from hypothesis import strategies as st
from videos_for_tests import write_clip

# Sequence parameter sets that x264 and x265 wrote: with profile, size and what is
# special. The sizes are those of whole blocks.
H264 = {
    "high": ("6764000dacd94141fb011000000300100000030320f142996000", (320, 240)),
    "4:4:4, scalings": (
        "67f4000d919b28283f6022000003000200000300641e28532c00",
        (320, 240),
    ),
    "interlaced": (
        "67f40015919b282821f89c0440000003004000000c87c50a658000",
        (320, 256),
    ),
}
HEVC = {
    "main": (
        "42010101600000030090000003000003005aa0050201e165959a4932bc05a0200000030020000003"
        "032100",
        (640, 480),
    ),
    "ten bits, 318 x 238": (
        "42010102200000030090000003000003003ca00a080f1d5365959a4932bc05a02000000300200000"
        "03032100",
        (320, 240),
    ),
}


@pytest.mark.parametrize("name", [*H264, *HEVC])
def test_parameter_sets_of_real_encoders(name):
    hevc = name in HEVC
    stored, size = (HEVC if hevc else H264)[name]
    unit = bytes.fromhex(stored)
    frame = bytes.fromhex("26010a" if hevc else "65888400")
    for start in (b"\0\0\1", b"\0\0\0\1"):
        assert stated_size(start + unit + start + frame, hevc=hevc) == size
        assert stated_size(start + frame, hevc=hevc) is None
        assert stated_size(start + unit[:5], hevc=hevc) is None


@pytest.mark.parametrize(
    "ending, code", [(".webm", "VP80"), (".webm", "VP90"), (".avi", "MJPG")]
)
def test_key_frames_of_clips(tmp_path, ending, code):
    path = tmp_path / f"clip{ending}"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*code), 10, (80, 48))
    assert writer.isOpened()
    for level in (0, 100, 200):
        writer.write(np.full((48, 80, 3), level, np.uint8))
    writer.release()
    with opened(path, coded=True) as video:
        assert video.grab()
        assert stated_size(video.retrieve()[1].tobytes()) == (80, 48)
    assert size_change(path) is None


def test_a_codec_that_does_not_tell(tmp_path):
    clip = write_clip(tmp_path / "clip.mp4", [np.zeros((48, 48, 3), np.uint8)] * 3)
    assert size_change(clip) is None


HEADS = (b"", b"\0\0\1\x67", b"\0\0\0\1\x42\1", b"\x82\x49\x83\x42", b"\xff\xd8\xff")


@given(st.sampled_from(HEADS), st.binary(max_size=200), st.booleans())
def test_any_bytes(head, data, hevc):
    size = stated_size(head + data, hevc=hevc)
    assert size is None or (len(size) == 2 and min(size) >= 0)
