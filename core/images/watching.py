"""A video watched once: what is remembered of its frames, and which are held."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from ..progress import CheckCancelled
from .frames import Frame, FrameGroups, look, time_code
from .wanted_frames import HeldFrames

# About two hours: what comes later is not looked at.
_MOST_FRAMES = 216_000
# An end that is missing gets a note from so many seconds and so large a part on. Sound
# may be a little longer than its pictures.
_MISSING_S = 1.0
_MISSING = 0.1

Watched = Callable[[float], None]


@dataclass(frozen=True, eq=False)
class Seen:
    """What was seen of a video.

    Parameters
    ----------
    frames : list of Frame
        Those that were measured, in the order of the video.
    held : HeldFrames
    note : str
        Says if the end is missing.
    """

    frames: list[Frame]
    held: HeldFrames
    note: str = ""


def watch(
    video: cv2.VideoCapture,
    step: int,
    measured: int,
    *,
    held_bytes: int,
    check_cancelled: CheckCancelled,
    watched: Watched | None,
) -> Seen:
    """Measure every `step`-th frame from where the video is.

    Parameters
    ----------
    video : cv2.VideoCapture
        Open, at its start.
    step : int
        Doubled whenever there are more than `measured`.
    measured : int
        Most frames that are measured.
    held_bytes : int
        As in `Limits`.
    check_cancelled, watched : callable
        As in `read_video`.
    """
    total = video.get(cv2.CAP_PROP_FRAME_COUNT)
    rate = video.get(cv2.CAP_PROP_FPS)
    frames: list[Frame] = []
    groups, held = FrameGroups(), HeldFrames(held_bytes)
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
        found, picture = video.retrieve()
        if not found or picture is None:
            continue
        bgr = picture.astype(np.uint8, copy=False)
        frame = look(bgr, number, seconds)
        frames.append(frame)
        unlikely = groups.add(frame)
        if unlikely is not frame:
            held.add(frame, bgr)
        if unlikely is not None:
            held.drop(unlikely)
        if len(frames) > measured:
            step *= 2
            frames = [frame for frame in frames if frame.number % step == 0]
            groups = FrameGroups(frames)
            held.keep(groups.best)
        if watched is not None and total > 0:
            watched(min(number / total, 1.0))
    return Seen(frames, held, note)
