"""Videos: which frames are chosen, when they were shown, and what is no video."""

import os
import struct
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from bsface.errors import Cancelled, PhotoFailure
from bsface.images.decode import Limits
from bsface.images.folder import list_photos
from bsface.images.frames import ALIKE, choose_frames, far_apart, look, time_code
from bsface.images.keep_frames import keep_frames
from bsface.images.read import read_photo
from bsface.images.video import VideoFrames, read_video
from videos_for_tests import (
    CODECS,
    turned_clip,
    with_pixel_aspect,
    with_times,
    write_changing_clip,
    write_clip,
)

EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "photos"
RNG = np.random.default_rng(5)


def example(number: int, size: tuple[int, int] = (240, 240)) -> np.ndarray:
    bgr = cv2.imread(str(EXAMPLES / f"{number:03d}.jpg"))
    return cv2.resize(bgr, size, interpolation=cv2.INTER_AREA)[..., ::-1]


PICTURES = [example(k) for k in range(8)]


def noisy(picture: np.ndarray) -> np.ndarray:
    noise = RNG.normal(0, 3, picture.shape)
    return np.clip(picture + noise, 0, 255).astype(np.uint8)


def differences(found: VideoFrames) -> np.ndarray:
    looks = np.stack([f.thumbnail.ravel() for f in found.frames]).astype(float)
    return np.abs(looks[:, None] - looks[None]).mean(axis=2)


@pytest.mark.parametrize("ending", CODECS)
def test_every_frame_of_a_clip_of_photos_is_found(tmp_path, ending):
    path = write_clip(tmp_path / f"clip{ending}", PICTURES)
    found = read_video(path)
    assert found.names[:2] == (f"clip{ending} 00:00.000", f"clip{ending} 00:00.100")
    photos = list(found.photos())
    assert [photo.name for photo in photos] == list(found.names)
    assert len(photos) == len(PICTURES)
    for photo, picture in zip(photos, PICTURES, strict=True):
        assert photo.path is None and photo.size == (240, 240) and photo.note == ""
        # The codec's loss; another photo is ten times as far.
        assert np.abs(photo.pixels.astype(int) - picture).mean() < 5


def test_alike_frames_are_one_and_the_sharpest_stands_for_them(tmp_path):
    frames = []
    for picture in PICTURES[:3]:
        soft = cv2.GaussianBlur(picture, (0, 0), 1.5)
        frames += [noisy(soft), noisy(picture), noisy(soft)]
    # The first scene comes again, and is not taken twice.
    frames += [noisy(cv2.GaussianBlur(PICTURES[0], (0, 0), 1.5))]
    found = read_video(write_clip(tmp_path / "a.avi", frames))
    assert [frame.number for frame in found.frames] == [1, 4, 7]


def test_a_slow_turn_is_not_one_scene():
    """Each frame is like the one before, the last not like the first."""
    base = np.tile(np.arange(320) % 80 // 2, (240, 1)).astype(np.uint8)
    turn = [np.roll(base, k, axis=1) for k in range(0, 41)]
    frames = [look(np.dstack([p] * 3), k, k / 10) for k, p in enumerate(turn)]
    found = choose_frames(frames, 60)
    assert 5 < len(found) < 41
    looks = [f.thumbnail.astype(float) for f in found]
    for k, one in enumerate(looks):
        assert all(np.abs(one - other).mean() > ALIKE / 2 for other in looks[:k])


def test_more_scenes_than_wanted(tmp_path):
    found = read_video(write_clip(tmp_path / "a.avi", PICTURES), count=4)
    assert len(found.frames) == 4
    numbers = [frame.number for frame in found.frames]
    assert numbers == sorted(numbers)


def test_far_apart_covers_and_prefers_sharp_ones():
    """On a line with pairs, one sharp and one blurred, at each place."""
    places = np.repeat(np.arange(10.0), 2)[:, None]
    sharpness = np.tile([1.0, 0.2], 10)
    chosen = far_apart(places, sharpness, 10)
    assert sorted(chosen) == list(range(0, 20, 2))
    assert far_apart(places, sharpness, 50)[:10] == chosen


def test_a_long_video_is_measured_at_equal_steps(tmp_path):
    frames = [noisy(PICTURES[k % 8]) for k in range(40)]
    told = []
    path = write_clip(tmp_path / "a.avi", frames)
    found = read_video(path, measured=9, watched=told.append)
    assert {frame.number % 4 for frame in found.frames} == {0}
    assert told == sorted(told) and told[0] >= 0 and told[-1] <= 1


@pytest.mark.parametrize("claimed", [8, 100, 2**31 - 1])
def test_a_claimed_length_loses_no_frames(tmp_path, claimed):
    path = write_changing_clip(tmp_path / "a.avi", PICTURES, claimed)
    assert len(read_video(path, measured=40).frames) == len(PICTURES)


def test_the_turn_of_the_file_is_made(tmp_path):
    pictures = [example(k, (160, 120)) for k in range(2)]
    path = write_clip(tmp_path / "a.mp4", pictures)
    turned_clip(path)
    found = read_video(path)
    for photo, picture in zip(found.photos(), pictures, strict=True):
        assert photo.size == (120, 160)
        right = np.rot90(picture, -1).astype(int)
        assert np.abs(photo.pixels - right).mean() < 6


@pytest.mark.parametrize("turn", [False, True])
def test_pixels_that_are_not_square_become_square(tmp_path, turn):
    """As of camcorders: 1440 x 1080 pixels are shown as 16 : 9."""
    pictures = [example(k, (180, 240)) for k in range(2)]
    path = write_clip(tmp_path / "a.mp4", pictures)
    with_pixel_aspect(path, 4, 3)
    if turn:
        turned_clip(path)
    photos = list(read_video(path).photos())
    for photo, picture in zip(photos, [example(0), example(1)], strict=True):
        # The same picture of square pixels, turned at 180 pixels of width if at all.
        seen = np.rot90(picture, -1) if turn else picture
        h, w = photo.pixels.shape[:2]
        assert photo.size == (w, h) and abs(w / h - 1) < 0.01
        seen = cv2.resize(np.ascontiguousarray(seen), (w, h))
        assert np.abs(photo.pixels.astype(int) - seen).mean() < 6
    small = read_video(path, limits=Limits(full_size_pixels=20_000))
    first = next(small.photos())
    assert first.pixels.shape[0] < 130 and first.window[2] == 0.5


def test_times_of_a_variable_frame_rate(tmp_path):
    path = write_clip(tmp_path / "a.mp4", PICTURES[:4], rate=1)
    # Four seconds in all, as before: the file also says how long it is.
    unit = struct.unpack(">I", path.read_bytes().split(b"stts")[1][12:16])[0]
    with_times(path, [unit // 10, 3 * unit // 10, 26 * unit // 10, unit])
    names = read_video(path).names
    assert names == ("a.mp4 00:00.000", "a.mp4 00:00.100", "a.mp4 00:00.400",
                     "a.mp4 00:03.000")  # fmt: skip


@pytest.mark.parametrize(
    "seconds, code",
    [(0, "00:00.000"), (12.4326, "00:12.433"), (59.9999, "01:00.000"),
     (3732.5, "1:02:12.500"), (-1, "00:00.000")],
)  # fmt: skip
def test_time_codes(seconds, code):
    assert time_code(seconds) == code


def test_frames_without_times_still_have_names_of_their_own(tmp_path):
    path = write_clip(tmp_path / "a.mp4", PICTURES[:3])
    with_times(path, [0, 0, 0])
    names = read_video(path).names
    assert len(set(names)) == 3 and all(name.startswith("a.mp4 0") for name in names)


def test_large_frames_are_made_smaller_and_keep_their_coordinates(tmp_path):
    path = write_clip(tmp_path / "a.avi", PICTURES[:2])
    found = read_video(path, limits=Limits(full_size_pixels=20_000))
    photo = next(found.photos())
    assert photo.pixels.shape == (120, 120, 3)
    assert photo.size == (240, 240) and photo.window == (0.0, 0.0, 0.5)


def test_frames_are_kept_as_photos(tmp_path):
    found = read_video(write_clip(tmp_path / "a.avi", PICTURES))
    folder = tmp_path / "new" / "frames"
    paths = keep_frames(found, folder, found.names[1:4])
    assert [path.name for path in paths] == [
        f"a.avi 00-00.{k}00.png" for k in (1, 2, 3)
    ]
    assert list_photos(folder) == paths
    for path, photo in zip(paths, list(found.photos())[1:4], strict=True):
        np.testing.assert_array_equal(read_photo(path).pixels, photo.pixels)


def test_cancelling(tmp_path):
    path = write_clip(tmp_path / "a.avi", PICTURES)
    calls = []

    def cancel():
        calls.append(1)
        if len(calls) > 3:
            raise Cancelled

    with pytest.raises(Cancelled):
        read_video(path, check_cancelled=cancel)
    found = read_video(path)
    with pytest.raises(Cancelled):
        list(found.photos(cancel))


def test_what_is_no_video_is_told_in_a_sentence(tmp_path):
    good = write_clip(tmp_path / "good.mp4", PICTURES[:3]).read_bytes()
    small = write_clip(tmp_path / "small.mp4", [PICTURES[0][:16, :16]])
    files = {
        "empty.mp4": (b"", "is empty"),
        "text.mp4": (b"Dear film,\nyours truly", "is not a video"),
        # A play list would let FFmpeg open other files.
        "list.mp4": (b"#EXTM3U\n#EXTINF:1,\ngood.mp4\n", "is not a video"),
        "list.mkv": (b"ffconcat version 1.0\nfile good.mp4\n", "is not a video"),
        "short.mp4": (good[: len(good) // 2], "is damaged, or holds no video"),
        "no track.mp4": (good[:28] + struct.pack(">I4s", 8, b"moov"), "is damaged"),
        "head.webm": (b"\x1a\x45\xdf\xa3" + b"\0" * 100, "is damaged"),
        "no frames.avi": (b"RIFF\0\0\0\0AVI " + b"\0" * 100, "is damaged"),
    }
    for name, (data, words) in files.items():
        (tmp_path / name).write_bytes(data)
        failure = read_video(tmp_path / name)
        assert isinstance(failure, PhotoFailure), name
        assert failure.code == "unreadable"
        assert failure.reason.startswith(f"{name} {words}"), failure.reason
        assert failure.reason.endswith(".") and "\n" not in failure.reason
    assert "16 x 16" in read_video(small).reason
    failure = read_video(tmp_path / "good.mp4", limits=Limits(pixels=1000))
    assert failure.code == "too_large" and "240 x 240" in failure.reason
    assert "cannot be opened" in read_video(tmp_path / "none.mp4").reason
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe.mp4")
        assert "regular" in read_video(tmp_path / "pipe.mp4").reason


def test_ffmpeg_is_quiet(tmp_path):
    """In a process of its own: FFmpeg takes its loudness from the first use of it."""
    path = tmp_path / "short.mp4"
    good = write_clip(path, PICTURES[:3]).read_bytes()
    path.write_bytes(good[: len(good) // 2])
    program = (
        "import sys; from bsface.images.video import read_video as r; r(sys.argv[1])"
    )
    run = subprocess.run(
        [sys.executable, "-c", program, str(path)], capture_output=True, timeout=300
    )
    assert run.returncode == 0 and run.stderr == b""


def test_a_video_cut_short_gives_the_frames_that_are_there(tmp_path):
    path = write_clip(tmp_path / "a.mkv", PICTURES)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 2 // 3])
    found = read_video(path)
    assert 2 <= len(list(found.photos())) < len(PICTURES)
    assert differences(found).max() > ALIKE


def test_a_missing_end_is_told(tmp_path):
    path = write_clip(tmp_path / "a.mkv", PICTURES, rate=1)
    assert read_video(path).note == ""
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    note = read_video(path).note
    assert note.startswith("cut short: 00:0") and "of 00:08.000" in note


@pytest.mark.parametrize("first, second", [((96, 128), (48, 64)), ((48, 64), (96, 64))])
def test_frames_that_change_their_size_are_refused(tmp_path, first, second):
    """OpenCV would hand out all of them in the first size."""
    frames = [np.zeros((*size, 3), np.uint8) for size in (first, first, second)]
    failure = read_video(write_changing_clip(tmp_path / "a.avi", frames))
    assert isinstance(failure, PhotoFailure) and failure.code == "unreadable"
    assert (
        f"from {first[1]} x {first[0]} to {second[1]} x {second[0]}" in failure.reason
    )
    assert "at 00:00.200" in failure.reason and failure.reason.endswith("size.")
    whole = read_video(write_changing_clip(tmp_path / "b.avi", frames[:2]))
    assert isinstance(whole, VideoFrames)


@pytest.mark.skipif(sys.platform != "linux", reason="names that are no text")
def test_a_video_whose_path_is_no_text_is_refused(tmp_path):
    """OpenCV would end the process."""
    folder = tmp_path / os.fsdecode(b"caf\xe9")
    folder.mkdir()
    clip = write_clip(tmp_path / "a.avi", [np.zeros((48, 48, 3), np.uint8)] * 3)
    found = read_video(clip.rename(folder / "a.avi"))
    assert found.code == "unreadable" and "rename it" in found.reason
