"""Which of several faces in a photo is the folder's person."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import PhotoFailure
from ..images.photo import Photo
from .landmarks import Landmarks
from .plausibility import FaceFit

# What counts as one step away: half as large again, a fifth of the picture aside.
SIZE_STEP = 0.4
PLACE_STEP = 0.2


@dataclass(frozen=True, eq=False)
class Candidate:
    """One face of one photo: the cut-out and what was measured on it.

    Parameters
    ----------
    photo : Photo
        Cut-out.
    landmarks : Landmarks
    fit : FaceFit
    failure : PhotoFailure or None
        Why this face is of no use. It still takes part in the choice: else a
        bystander would stand in for a person who is blurred.
    found : Landmarks or None
        As they were found, before they were reduced to the scheme that is asked for.
    """

    photo: Photo
    landmarks: Landmarks
    fit: FaceFit
    failure: PhotoFailure | None = None
    found: Landmarks | None = None


def choose_faces(
    outcome: Sequence[tuple[Candidate, ...] | PhotoFailure],
) -> list[Candidate | PhotoFailure]:
    """One face a photo: the one whose size and place fit the folder best.

    The folder's usual size and place of the face, both relative to the picture,
    are the medians over the photos that show one face only. Without such photos
    the largest face is taken. The choice is told in the landmarks' note.

    Parameters
    ----------
    outcome : sequence of tuples of Candidate, or PhotoFailure

    Returns
    -------
    list of Candidate or PhotoFailure
        In the order given.
    """
    single = [
        _place(faces[0])
        for faces in outcome
        if not isinstance(faces, PhotoFailure)
        and len(faces) == 1
        and faces[0].failure is None
    ]
    usual = np.median(single, axis=0) if single else None
    chosen: list[Candidate | PhotoFailure] = []
    for faces in outcome:
        if isinstance(faces, PhotoFailure):
            chosen.append(faces)
            continue
        best = _best(faces, usual)
        chosen.append(best if best.failure is None else best.failure)
    return chosen


def _best(faces: tuple[Candidate, ...], usual: np.ndarray | None) -> Candidate:
    if len(faces) == 1:
        return faces[0]
    places = np.stack([_place(face) for face in faces])
    if usual is None:
        best = int(places[:, 0].argmax())
        why = "the largest"
    else:
        step = np.array([SIZE_STEP, PLACE_STEP, PLACE_STEP])
        best = int(np.linalg.norm((places - usual) / step, axis=1).argmin())
        why = "nearest in size and place to the face of the other photos"
    # Faces are counted as one reads: from left to right.
    rank = int((places[:, 1] < places[best, 1]).sum()) + 1
    chosen = faces[best]
    note = f"face {rank} of {len(faces)} from the left chosen: {why}"
    return replace(chosen, landmarks=replace(chosen.landmarks, note=note))


def _place(face: Candidate) -> np.ndarray:
    """log of the size, x and y of the centre, in parts of the picture."""
    width, height = face.photo.size
    extent = float(np.hypot(width, height))
    centre = face.landmarks.points.mean(axis=0)
    return np.array(
        [np.log(face.fit.eye_distance / extent), *(centre - (width / 2, height / 2))]
        / np.array([1.0, extent, extent])
    )
