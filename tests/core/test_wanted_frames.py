"""Chosen frames of a video: held, sought or decoded again, always the same pixels."""

import numpy as np
import pytest
from bsface.images.decode import Limits
from bsface.images.frames import Frame, FrameGroups, choose_frames
from bsface.images.video import read_video
from bsface.images.wanted_frames import HeldFrames, wanted_frames
from hypothesis import given, settings
from hypothesis import strategies as st
from videos_for_tests import with_times, write_clip

SIDE = 48
SCENES, EACH = 4, 75
RNG = np.random.default_rng(2)


def scenes() -> list[np.ndarray]:
    """So many scenes, of which only noise changes for longer than is sought across."""
    bases = RNG.integers(0, 230, (SCENES, 6, 6, 3))
    coarse = [np.kron(base, np.ones((8, 8, 1))) for base in bases]
    noise = RNG.integers(0, 3, (SCENES * EACH, SIDE, SIDE, 3))
    return [
        (coarse[k // EACH] + noise[k]).astype(np.uint8) for k in range(SCENES * EACH)
    ]


@pytest.fixture(scope="module")
def clips(tmp_path_factory):
    place = tmp_path_factory.mktemp("clips")
    frames = scenes()
    found = {e: write_clip(place / f"a{e}", frames, 30) for e in (".mp4", ".avi")}
    # Every frame of the second half is shown for three times as long.
    uneven = write_clip(place / "uneven.mp4", frames, 30)
    half = SCENES * EACH // 2
    with_times(uneven, [256] * half + [768] * half)
    return {**found, "uneven": uneven}


def read(path, held_bytes: int, calls: list | None = None):
    video = read_video(path, limits=Limits(held_bytes=held_bytes))
    calls = [] if calls is None else calls
    photos = list(video.photos(lambda: calls.append(1)))
    assert [photo.name for photo in photos] == list(video.names)
    return video, photos


@pytest.mark.parametrize("kind", [".mp4", ".avi", "uneven"])
@pytest.mark.parametrize("room", [0, 2])
def test_frames_are_the_same_whether_they_were_held_or_not(clips, kind, room):
    every, expected = read(clips[kind], 10**9)
    assert len(every.held) == len(every.frames) == SCENES
    some, found = read(clips[kind], room * SIDE * SIDE * 3)
    assert len(some.held) <= room
    assert [f.number for f in some.frames] == [f.number for f in every.frames]
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.pixels, other.pixels)


def test_far_frames_are_sought_and_not_reached_through_all_others(clips):
    calls: list[int] = []
    video, _ = read(clips[".mp4"], 0, calls)
    # Where a version of OpenCV lands before a frame differs.
    assert len(calls) < 0.75 * video.frames[-1].number


def test_what_is_found_elsewhere_is_not_taken_for_the_frame(clips):
    """Seeking is believed only where the frame looks as it was measured."""
    video, photos = read(clips[".mp4"], 10**9)
    last = video.frames[-1]
    other = Frame(last.number, last.seconds, last.sharpness + 1, last.thumbnail)
    calls: list[int] = []
    path = clips[".mp4"]
    ((_, bgr),) = wanted_frames(path, [other], {}, lambda: calls.append(1))
    assert len(calls) > last.number
    np.testing.assert_array_equal(bgr[..., ::-1], photos[-1].pixels)


frames_at = st.lists(
    st.tuples(st.integers(0, 255), st.floats(0, 1)), min_size=1, max_size=40
)


def drawn(looks) -> list[Frame]:
    return [
        Frame(k, k / 10, sharp, np.full((32, 32), grey, np.uint8))
        for k, (grey, sharp) in enumerate(looks)
    ]


@settings(deadline=None)
@given(frames_at, st.integers(0, 12))
def test_never_more_is_held_than_there_is_room_for(looks, room):
    pixels = np.zeros((4, 4, 3), np.uint8)
    held = HeldFrames(room * pixels.nbytes)
    for frame in drawn(looks):
        held.add(frame, pixels)
        assert len(held.pictures) <= room


@settings(deadline=None)
@given(frames_at)
def test_groups_say_which_frame_is_out_of_the_choice(looks):
    groups, left = FrameGroups(), []
    frames = drawn(looks)
    for frame in frames:
        out = groups.add(frame)
        left = [f for f in [*left, frame] if f is not out]
    assert sorted(f.number for f in left) == [
        f.number for f in choose_frames(frames, len(frames))
    ]
