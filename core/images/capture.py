"""OpenCV's reader of videos, quiet, and closed in any case."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

import cv2

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


@contextlib.contextmanager
def _quiet_ffmpeg() -> Iterator[None]:
    """FFmpeg says on stderr what we say in the report; OpenCV asks here how loudly."""
    name = "OPENCV_FFMPEG_LOGLEVEL"
    before = os.environ.get(name)
    if before is None:
        os.environ[name] = "-8"  # AV_LOG_QUIET
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]
