"""OpenCV's reader of videos, quiet, and closed in any case."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

import cv2

from ..process_state import Undo, WhileAnyone, nothing
from .decode import quiet


@contextlib.contextmanager
def opened(path: Path, *, coded: bool = False) -> Iterator[cv2.VideoCapture]:
    """A video file, open; turns that it asks for are made.

    Parameters
    ----------
    path : pathlib.Path
    coded : bool
        Frames come as they are stored, not decoded.
    """
    options = [cv2.CAP_PROP_FORMAT, -1] if coded else []
    with quiet(), _quiet_ffmpeg():
        video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, options)
    try:
        video.set(cv2.CAP_PROP_ORIENTATION_AUTO, 1)
        yield video
    finally:
        video.release()


def _silence_ffmpeg() -> Undo:
    """FFmpeg says on stderr what we say in the report; OpenCV asks here how loudly."""
    name = "OPENCV_FFMPEG_LOGLEVEL"
    if name in os.environ:
        return nothing
    os.environ[name] = "-8"  # AV_LOG_QUIET

    def undo() -> None:
        os.environ.pop(name, None)

    return undo


_quiet_ffmpeg = WhileAnyone(_silence_ffmpeg)
