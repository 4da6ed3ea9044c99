"""One face of one photo, cut out and measured."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import PhotoFailure
from ..images.photo import Photo
from .landmarks import Landmarks
from .plausibility import FaceFit


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
    drawn : bool
        It may be drawn or painted.
    misplaced : bool
        Its landmark file marks another place than every face that is seen.
    """

    photo: Photo
    landmarks: Landmarks
    fit: FaceFit
    failure: PhotoFailure | None = None
    found: Landmarks | None = None
    drawn: bool = False
    misplaced: bool = False


#: The faces of one photo, the largest first.
Faces = tuple[Candidate, ...]


def usable_faces(faces: Faces) -> Faces:
    """The faces without a failure."""
    return tuple(face for face in faces if face.failure is None)
