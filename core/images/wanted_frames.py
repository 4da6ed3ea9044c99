"""Frames of a video by their numbers, without decoding the whole of it once more.

Most of the frames that are chosen were held while the video was watched. The others are
decoded again, from the key frame before them. A player may land beside the frame that
is wanted (variable frame rate, damaged streams), so what it gives is compared with what
was measured on the frame; if they differ, the video is decoded from its start.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

import cv2
import numpy as np

from .._types import Picture8
from ..progress import CheckCancelled
from .capture import opened
from .frames import Frame, differing_looks, look

# OpenCV starts at the key frame before the sixteenth frame before the one that is asked
# for; phones and cameras store a key frame per second at least.
_NEAR = 60
# Where the frame rate varies a little, the landing place is so many frames early.
_EARLY = 2
# Parts of the limit that are kept when it is exceeded, so that the frames to keep are
# not chosen anew with every frame.
_KEPT = 0.9


class HeldFrames:
    """The decoded frames that are likely to be chosen, within a limit of memory.

    Parameters
    ----------
    limit : int
        Bytes.

    Attributes
    ----------
    pictures : dict of int to (h, w, 3) uint8 array
        Number of a frame to its pixels.
    """

    def __init__(self, limit: int) -> None:
        self.pictures: dict[int, Picture8] = {}
        self._frames: dict[int, Frame] = {}
        self._limit = limit

    def add(self, frame: Frame, bgr: Picture8) -> None:
        """Hold a frame; if there is no room, those go that lie nearest to others."""
        self.pictures[frame.number] = bgr
        self._frames[frame.number] = frame
        count = len(self._frames)
        if count * bgr.nbytes <= self._limit:
            return
        count = int(_KEPT * self._limit / bgr.nbytes)
        self.keep(differing_looks(list(self._frames.values()), count))

    def drop(self, frame: Frame) -> None:
        """Hold a frame no longer, if it is held."""
        self.pictures.pop(frame.number, None)
        self._frames.pop(frame.number, None)

    def keep(self, frames: Sequence[Frame]) -> None:
        """Hold no others than these."""
        numbers = {frame.number for frame in frames}
        for number in self._frames.keys() - numbers:
            self.drop(self._frames[number])


def wanted_frames(
    path: Path,
    frames: Sequence[Frame],
    held: Mapping[int, Picture8],
    check_cancelled: CheckCancelled,
) -> Iterator[tuple[Frame, Picture8]]:
    """Frames with their pixels, in OpenCV's order of colours; lost ones are left out.

    Parameters
    ----------
    path : pathlib.Path
        The video.
    frames : sequence of Frame
        In the order of the video.
    held : mapping of int to (h, w, 3) uint8 array
        Pixels of frames that need not be decoded, by the frame's number.
    check_cancelled : callable
        Called for every frame that is handed out or decoded.
    """
    with ExitStack() as stack:
        video: cv2.VideoCapture | None = None
        following, lands = 0, True  # number of the next frame; whether seeking works
        for frame in frames:
            check_cancelled()
            if frame.number in held:
                yield frame, held[frame.number]
                continue
            if video is None:
                video = stack.enter_context(opened(path))
            found = None
            if lands and frame.number - following > _NEAR:
                found = _sought(video, frame, check_cancelled)
                lands = found is not None
                if not lands:
                    video, following = stack.enter_context(opened(path)), 0
            if found is None:
                for _ in range(following, frame.number + 1):
                    check_cancelled()
                    if not video.grab():
                        break
                else:
                    found = _retrieved(video)
            following = frame.number + 1
            if found is not None:
                yield frame, found


def _sought(
    video: cv2.VideoCapture, frame: Frame, check_cancelled: CheckCancelled
) -> Picture8 | None:
    """Pixels of a frame by way of the key frame before it; None if they are others."""
    rate = video.get(cv2.CAP_PROP_FPS)
    if not rate > 0:
        return None
    near = min(frame.number, round(frame.seconds * rate))
    if not video.set(cv2.CAP_PROP_POS_FRAMES, max(near - _EARLY, 0)):
        return None
    seconds = -1.0
    while seconds < frame.seconds:
        check_cancelled()
        if not video.grab():
            return None
        seconds = video.get(cv2.CAP_PROP_POS_MSEC) / 1000
    found = _retrieved(video)
    if found is None or seconds != frame.seconds:
        return None
    seen = look(found, frame.number, seconds)
    same = np.array_equal(seen.thumbnail, frame.thumbnail)
    return found if same and seen.sharpness == frame.sharpness else None


def _retrieved(video: cv2.VideoCapture) -> Picture8 | None:
    found, bgr = video.retrieve()
    return bgr.astype(np.uint8, copy=False) if found and bgr is not None else None
