"""Frames of a video to faces: those that differ most in pose and light.

A video gives hundreds of pictures that differ little. `images.frames` has chosen by the
look of the whole picture; here the faces are known, and the frames are taken whose
poses and lights lie farthest from each other.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence

import cv2
import numpy as np

from .._types import Array
from ..errors import PhotoFailure
from ..images.decode import LIMITS, Limits
from ..images.frames import far_apart
from ..images.video import read_video
from ..images.watching import Watched
from ..progress import CheckCancelled, never_cancelled
from .candidates import CandidateReader
from .face_selection import Candidate
from .quality import face_patch, sharpness

# As many photos as the methods need of one person; more cost time and gain little.
FRAMES = 60
# One step apart: heads turned by ten degrees, or faces whose brightness, over its mean,
# differs by so much (root mean square).
POSE_STEP = np.sin(np.radians(10))
LIGHT_STEP = 0.15
_CELLS = 6

Faces = tuple[Candidate, ...]


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
    chosen = differing_frames([faces for _, faces in found], limit)
    used: list[tuple[str, Faces | PhotoFailure]] = [found[i] for i in chosen]
    if seen < len(video.frames):
        used.append((name, _changed(name)))
    return [*used, *ignored]


def differing_frames(found: Sequence[Faces], limit: int) -> list[int]:
    """Indices of at most `limit` sharp frames that differ in pose and light.

    Parameters
    ----------
    found : sequence of tuple of Candidate
        Of each frame; one candidate at least has no failure.
    limit : int

    Returns
    -------
    list of int
        In ascending order.
    """
    if len(found) <= limit:
        return list(range(len(found)))
    usable = [usable_faces(faces)[0] for faces in found]
    features = np.stack([_pose_and_light(face) for face in usable])
    detail = np.array(
        [sharpness(face_patch(f.photo, f.landmarks, f.fit)) for f in usable]
    )
    return sorted(far_apart(features, detail, limit))


def usable_faces(faces: Faces) -> Faces:
    """Those without a failure, which is false where it is tested for its truth."""
    return tuple(face for face in faces if face.failure is None)


def _pose_and_light(face: Candidate) -> Array:
    """(3 + 36,) numbers: distances of 1 are one step in pose or in light."""
    rows = face.fit.affine[:, :3] / np.linalg.norm(
        face.fit.affine[:, :3], axis=1, keepdims=True
    )
    toward = np.cross(rows[0], -rows[1])  # the camera, seen from the head
    patch = face_patch(face.photo, face.landmarks, face.fit)
    cells = cv2.resize(patch, (_CELLS, _CELLS), interpolation=cv2.INTER_AREA)
    light = cells / max(float(cells.mean()), 1.0)
    return np.concatenate([toward / POSE_STEP, light.ravel() / (LIGHT_STEP * _CELLS)])


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
