"""Frames of a video written as photos: to look at, or to set landmarks by hand."""

from __future__ import annotations

import os
from collections.abc import Collection
from pathlib import Path

import cv2

from ..errors import ReconstructionError
from ..files import write_bytes
from ..progress import CheckCancelled, never_cancelled
from .video import VideoFrames


def keep_frames(
    video: VideoFrames,
    folder: str | os.PathLike,
    names: Collection[str] | None = None,
    check_cancelled: CheckCancelled = never_cancelled,
) -> tuple[Path, ...]:
    """Write chosen frames into a folder, as PNG files that are read like any photo.

    Parameters
    ----------
    video : VideoFrames
    folder : path
        Made if it is missing.
    names : collection of str, optional
        Names of the frames to write, such as those that a result used; by default all.
    check_cancelled : callable, optional
        Called for every frame of the video; may raise `Cancelled`.

    Returns
    -------
    tuple of pathlib.Path
        ``clip.mp4 00-12.433.png``..., in the order of the video.

    Raises
    ------
    ReconstructionError
        If a frame cannot be encoded, or `write_bytes` cannot write.
    """
    written = []
    for photo in video.photos(check_cancelled):
        if names is not None and photo.name not in names:
            continue
        path = Path(folder) / f"{photo.name.replace(':', '-')}.png"
        # Not `encode_png`, whose mark says that a picture is no photo.
        done, data = cv2.imencode(".png", cv2.cvtColor(photo.pixels, cv2.COLOR_RGB2BGR))
        if not done:
            raise ReconstructionError(f"{photo.name} cannot be encoded as PNG.")
        written.append(write_bytes(path, data.tobytes()))
    return tuple(written)
