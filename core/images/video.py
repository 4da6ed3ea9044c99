"""A video to photos: the frames that are worth a look, one after the other.

The video is watched once. The frames that are likely to be chosen are held meanwhile,
within a limit, so that memory stays the same however long the video is; chosen frames
that were not held are decoded again. OpenCV decodes by the FFmpeg that it carries.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from .._types import Picture8
from ..errors import PhotoFailure
from ..progress import CheckCancelled, never_cancelled
from .capture import opened
from .decode import LIMITS, MIN_SIDE, Limits, judge_file
from .focal_length import of_film
from .frame_size import size_change
from .frames import Frame, choose_frames, time_code
from .icc import ProfileError
from .photo import Photo
from .video_colour import Convert, frame_converter, read_colour, unchanged
from .video_focal_length import film_focal_mm
from .wanted_frames import wanted_frames
from .watching import Watched, watch

# So many frames are handed out, of which landmarks choose by pose and light.
FRAMES = 90
# Most frames that are measured; in a longer video every second, fourth... of them.
MEASURED = 400


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
    film_mm : float
        Focal length as that of 35 mm film; 0 = not stated.
    held : mapping of int to (h, w, 3) uint8 array
        Pixels of frames, by their number, that need not be decoded again; at most
        `Limits.held_bytes`.
    """

    path: Path
    name: str
    frames: tuple[Frame, ...]
    note: str = ""
    limits: Limits = LIMITS
    convert: Convert = unchanged
    pixel_aspect: float = 1.0
    film_mm: float = 0.0
    held: Mapping[int, Picture8] = field(default_factory=dict, repr=False)

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
        """The frames as photos without a path, one at a time.

        Parameters
        ----------
        check_cancelled : callable, optional
            Called for every frame that is decoded; may raise `Cancelled`.
        """
        names = dict(zip((f.number for f in self.frames), self.names, strict=True))
        frames = wanted_frames(self.path, self.frames, self.held, check_cancelled)
        for frame, bgr in frames:
            yield self._photo(names[frame.number], bgr)

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
        return Photo(
            name,
            None,
            (w, h),
            self.convert(rgb),
            window,
            self.note,
            focal_px=of_film(self.film_mm, (w, h)),
        )


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
        watching = partial(
            watch,
            measured=measured,
            held_bytes=limits.held_bytes,
            check_cancelled=check_cancelled,
            watched=watched,
        )
        seen = watching(video, step)
    # The file claims more than it holds.
    if step > 1 and len(seen.frames) < measured / 4:
        with opened(path) as video:
            seen = watching(video, 1)
    if not seen.frames:
        return PhotoFailure(
            name,
            "unreadable",
            f"{name} holds no frame that can be decoded; copy it again or export it "
            "as MP4.",
        )
    convert, note = unchanged, seen.note
    try:
        convert = frame_converter(read_colour(path))
    except ProfileError as error:
        note = "; ".join(filter(None, [note, f"read as sRGB: {error}"]))
    chosen = choose_frames(seen.frames, count)
    seen.held.keep(chosen)
    return VideoFrames(
        path,
        name,
        chosen,
        note,
        limits,
        convert,
        pixel_aspect=aspect,
        film_mm=film_focal_mm(path),
        held=seen.held.pictures,
    )


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
