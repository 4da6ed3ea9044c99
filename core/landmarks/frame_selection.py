"""Frames of a video to faces: those that differ most in pose and light.

A video gives hundreds of pictures that differ little. `images.frames` has chosen by the
look of the whole picture; here the faces are known, and the frames are taken whose
poses and lights lie farthest from each other.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence

from ..errors import PhotoFailure
from ..images.decode import LIMITS, Limits
from ..images.video import read_video
from ..images.watching import Watched
from ..progress import CheckCancelled, never_cancelled
from .candidates import CandidateReader
from .differing import differing_faces
from .face_selection import Faces, usable_faces

# As many photos as the methods need of one person; more cost time and gain little.
FRAMES = 60


def read_frames(
    reader: CandidateReader,
    path: str | os.PathLike,
    name: str,
    *,
    limit: int = FRAMES,
    ignore: Sequence[str] = (),
    limits: Limits = LIMITS,
    check_cancelled: CheckCancelled = never_cancelled,
    watched: Watched | None = None,
) -> list[tuple[str, Faces | PhotoFailure]]:
    """The faces in the best frames of a video, as `CandidateReader.read` gives them.

    Parameters
    ----------
    reader : CandidateReader
    path : path
        Of the video.
    name : str
        Of the video in reports; the frames are named after it.
    limit : int
        Most frames.
    ignore : sequence of str
        Names of frames to leave out.
    limits : Limits, optional
        As in `read_video`.
    check_cancelled : callable, optional
        Called for every frame of the video, and while its face is looked for.
    watched : callable, optional
        As in `read_video`.

    Returns
    -------
    list of (str, tuple of Candidate or PhotoFailure)
        Name and faces of each chosen frame, in the order of the video, and the frames
        of `ignore`. If the video or all of its frames are of no use, the video's name
        with the reason.
    """
    video = read_video(
        path, name, limits=limits, check_cancelled=check_cancelled, watched=watched
    )
    if isinstance(video, PhotoFailure):
        return [(name, video)]
    found: list[tuple[str, Faces]] = []
    failures: list[PhotoFailure] = []
    ignored: list[tuple[str, Faces | PhotoFailure]] = []
    seen = 0
    for photo in video.photos(check_cancelled):
        seen += 1
        if photo.name in ignore:
            why = PhotoFailure(photo.name, "ignored", f"{photo.name} is set aside.")
            ignored.append((photo.name, why))
            continue
        faces = reader.read(photo, photo.name, check_cancelled)
        if isinstance(faces, PhotoFailure):
            failures.append(faces)
        elif faces[0].failure is not None and not usable_faces(faces):
            failures.append(faces[0].failure)
        else:
            found.append((photo.name, faces))
    if not found and failures:
        return [(name, _useless(name, failures)), *ignored]
    chosen = differing_faces([usable_faces(faces)[0] for _, faces in found], limit)
    used: list[tuple[str, Faces | PhotoFailure]] = [found[i] for i in chosen]
    if seen < len(video.frames):
        used.append((name, _changed(name)))
    return [*used, *ignored]


def _changed(name: str) -> PhotoFailure:
    return PhotoFailure(
        name,
        "unreadable",
        f"{name} was changed or removed while it was read; leave it as it is and start "
        "again.",
    )


def _useless(name: str, failures: Sequence[PhotoFailure]) -> PhotoFailure:
    code = Counter(failure.code for failure in failures).most_common(1)[0][0]
    first = next(failure for failure in failures if failure.code == code)
    if code == "no_face":
        reason = (
            f"No face was found in {len(failures)} frames of {name}; film the face "
            "from the front and half from both sides."
        )
    else:
        reason = f"None of {len(failures)} frames of {name} can be used: {first.reason}"
    return PhotoFailure(name, code, reason)
