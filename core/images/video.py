"""A video to photos: the frames that are worth a look, one after the other.

The video is decoded twice and never held: first it is watched for the frames to choose,
then these are handed out. So memory stays the same however long it is. OpenCV decodes
by the FFmpeg that it carries.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ..errors import PhotoFailure
from ..progress import CheckCancelled, never_cancelled
from .capture import opened
from .decode import LIMITS, MIN_SIDE, Limits, judge_file
from .frame_size import size_change
from .frames import Frame, choose_frames, look
from .icc import ProfileError
from .photo import Photo
from .video_colour import Convert, frame_converter, read_colour, unchanged

# So many frames are handed out, of which landmarks choose by pose and light.
FRAMES = 90
# Most frames that are measured; in a longer video every second, fourth... of them.
MEASURED = 400
# About two hours: what comes later is not looked at.
_MOST_FRAMES = 216_000
# An end that is missing gets a note from so many seconds and so large a part on. Sound
# may be a little longer than its pictures.
_MISSING_S = 1.0
_MISSING = 0.1

Watched = Callable[[float], None]


@dataclass(frozen=True, eq=False)
class VideoFrames:
    """The chosen frames of a video.

    Parameters
    ----------
    path : pathlib.Path
    name : str
    frames : tuple of Frame
        In the order of the video; at least one.
    note : str
        As `Photo.note`.
    limits : Limits
    convert : callable
        Takes decoded frames to sRGB.
    pixel_aspect : float
        Width of a pixel, as it is shown, in parts of its height. Frames are handed out
        with square pixels.
    """

    path: Path
    name: str
    frames: tuple[Frame, ...]
    note: str = ""
    limits: Limits = LIMITS
    convert: Convert = unchanged
    pixel_aspect: float = 1.0

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the photos: the video and a time code, ``clip.mp4 00:12.433``."""
        names = [f"{self.name} {time_code(frame.seconds)}" for frame in self.frames]
        return tuple(
            name if names.count(name) == 1 else f"{name} frame {frame.number}"
            for name, frame in zip(names, self.frames, strict=True)
        )

    def photos(
        self, check_cancelled: CheckCancelled = never_cancelled
    ) -> Iterator[Photo]:
        """The frames as photos without a path, decoded one at a time.

        Parameters
        ----------
        check_cancelled : callable, optional
            Called for every frame of the video; may raise `Cancelled`.
        """
        wanted = dict(zip((f.number for f in self.frames), self.names, strict=True))
        last = self.frames[-1].number
        with opened(self.path) as video:
            for number in range(last + 1):
                check_cancelled()
                if not video.grab():
                    return
                if number in wanted:
                    found, bgr = video.retrieve()
                    if found and bgr is not None:
                        yield self._photo(wanted[number], bgr)

    def _photo(self, name: str, bgr: np.ndarray) -> Photo:
        h, w = bgr.shape[0], round(bgr.shape[1] * self.pixel_aspect)
        reduction = self.limits.reduction(h * w)
        size = (-(-w // reduction), -(-h // reduction))
        if size != (bgr.shape[1], bgr.shape[0]):
            larger = size[0] > bgr.shape[1]
            how = cv2.INTER_LINEAR if larger else cv2.INTER_AREA
            bgr = cv2.resize(bgr, size, interpolation=how)
        rgb = cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)
        window = (0.0, 0.0, 1.0 / reduction)
        return Photo(name, None, (w, h), self.convert(rgb), window, self.note)


def read_video(
    path: str | os.PathLike,
    name: str | None = None,
    *,
    count: int = FRAMES,
    measured: int = MEASURED,
    limits: Limits = LIMITS,
    check_cancelled: CheckCancelled = never_cancelled,
    watched: Watched | None = None,
) -> VideoFrames | PhotoFailure:
    """Watch a video and choose frames: sharp ones, no two alike.

    Turns that the file asks for are made. The times are those of the file, so that a
    variable frame rate does no harm.

    Parameters
    ----------
    path : path
        MP4, MOV, M4V, WebM, MKV or AVI.
    name : str, optional
        The name in reports; by default the file's own.
    count : int
        Most frames that are chosen.
    measured : int
        Most frames that are measured to choose from, at equal steps.
    limits : Limits, optional
        Of a frame; the file may have any size.
    check_cancelled : callable, optional
        Called for every frame of the video; may raise `Cancelled`.
    watched : callable, optional
        Told now and then which part of the video was seen, from 0 to 1.

    Returns
    -------
    VideoFrames or PhotoFailure
        A failure has the code ``"unreadable"`` or ``"too_large"``.
    """
    path = Path(path)
    name = name or path.name
    for judge in (judge_file, _judge_path, _judge_head):
        failure = judge(path, name)
        if failure is not None:
            return failure
    with opened(path) as video:
        if not video.isOpened():
            return PhotoFailure(
                name,
                "unreadable",
                f"{name} is damaged, or holds no video that can be decoded; copy it "
                "again or export it as MP4.",
            )
        width = int(video.get(cv2.CAP_PROP_FRAME_WIDTH))
        height = int(video.get(cv2.CAP_PROP_FRAME_HEIGHT))
        if width * height > limits.pixels:
            return PhotoFailure(
                name,
                "too_large",
                f"{name} has frames of {width} x {height} pixels, more than can be "
                f"read ({limits.pixels // 10**6} megapixels); export it smaller.",
            )
        if 0 < min(width, height) < MIN_SIDE:
            return PhotoFailure(
                name,
                "unreadable",
                f"{name} has frames of only {width} x {height} pixels, too few for a "
                "face; use the original video.",
            )
        change = size_change(path, check_cancelled)
        if change is not None:
            seconds, before, after = change
            return PhotoFailure(
                name,
                "unreadable",
                f"{name} changes the size of its frames at {time_code(seconds)}, from "
                f"{before[0]} x {before[1]} to {after[0]} x {after[1]}; export it "
                "again as MP4, in one size.",
            )
        aspect = _pixel_aspect(video)
        total = video.get(cv2.CAP_PROP_FRAME_COUNT)
        step = 1
        while total / step > measured:
            step *= 2
        frames, note = _watch(video, measured, step, check_cancelled, watched)
    if step > 1 and len(frames) < measured / 4:  # the file claims more than it holds
        with opened(path) as video:
            frames, note = _watch(video, measured, 1, check_cancelled, watched)
    if not frames:
        return PhotoFailure(
            name,
            "unreadable",
            f"{name} holds no frame that can be decoded; copy it again or export it "
            "as MP4.",
        )
    convert = unchanged
    try:
        convert = frame_converter(read_colour(path))
    except ProfileError as error:
        note = "; ".join(filter(None, [note, f"read as sRGB: {error}"]))
    chosen = choose_frames(frames, count)
    return VideoFrames(path, name, chosen, note, limits, convert, aspect)


def time_code(seconds: float) -> str:
    """``00:12.433``, from an hour on ``1:02:12.433``."""
    milliseconds = round(max(seconds, 0.0) * 1000)
    minutes, milliseconds = divmod(milliseconds, 60_000)
    hours, minutes = divmod(minutes, 60)
    head = f"{hours}:" if hours else ""
    return f"{head}{minutes:02d}:{milliseconds / 1000:06.3f}"


def _watch(
    video: cv2.VideoCapture,
    measured: int,
    step: int,
    check_cancelled: CheckCancelled,
    watched: Watched | None,
) -> tuple[list[Frame], str]:
    """Every `step`-th frame, measured; and a note if the end is missing.

    The step is doubled whenever there are more than `measured`.
    """
    total = video.get(cv2.CAP_PROP_FRAME_COUNT)
    rate = video.get(cv2.CAP_PROP_FPS)
    frames: list[Frame] = []
    note, seconds = "", 0.0
    for number in range(_MOST_FRAMES):
        check_cancelled()
        if not video.grab():
            claimed = total / rate if rate > 0 else 0.0
            if claimed - seconds > max(_MISSING_S, _MISSING * claimed):
                note = (
                    f"cut short: {time_code(seconds)} of {time_code(claimed)} can be "
                    "decoded"
                )
            break
        seconds = video.get(cv2.CAP_PROP_POS_MSEC) / 1000
        if number % step:
            continue
        found, bgr = video.retrieve()
        if not found or bgr is None:
            continue
        frames.append(look(bgr.astype(np.uint8, copy=False), number, seconds))
        if len(frames) > measured:
            step *= 2
            frames = [frame for frame in frames if frame.number % step == 0]
        if watched is not None and total > 0:
            watched(min(number / total, 1.0))
    return frames, note


def _pixel_aspect(video: cv2.VideoCapture) -> float:
    """As `VideoFrames.pixel_aspect`; 1 where the file does not tell, or no camera."""
    wide = video.get(cv2.CAP_PROP_SAR_NUM)
    high = video.get(cv2.CAP_PROP_SAR_DEN)
    if video.get(cv2.CAP_PROP_ORIENTATION_META) % 180:
        wide, high = high, wide  # the file tells it of the frames before their turn
    return wide / high if high > 0 and 0.2 < wide / high < 5 else 1.0


def _judge_path(path: Path, name: str) -> PhotoFailure | None:
    """OpenCV ends the process when it is given a path that is no text."""
    try:
        str(path).encode("utf-8")
    except UnicodeEncodeError:
        return PhotoFailure(
            name,
            "unreadable",
            f"{name} or one of its folders has a name that is no text, by which no "
            "video can be opened; rename it.",
        )
    return None


def _judge_head(path: Path, name: str) -> PhotoFailure | None:
    """FFmpeg also follows play lists, which may name files anywhere: not opened."""
    try:
        with path.open("rb") as file:
            head = file.read(16)
    except OSError:
        head = b""
    if head[:4] == b"\x1a\x45\xdf\xa3":  # Matroska, WebM
        return None
    if head[:4] == b"RIFF" and head[8:12] == b"AVI ":
        return None
    if head[4:8] in (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip"):
        return None
    return PhotoFailure(
        name,
        "unreadable",
        f"{name} is not a video, whatever its name says; remove it.",
    )
