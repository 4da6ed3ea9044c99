"""Of hundreds of photos, those of which a texture is made: memory and time.

A place of the skin is shown by all photos that see it, so more of the same pose and
light add little.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..landmarks.differing import differing_faces
from ..landmarks.face_selection import Candidate
from ..landmarks.large_photos import LARGE
from ..landmarks.plausibility import fit_landmarks
from ..result import Reconstruction

#: Most photos of a texture: those that are kept in full size.
MOST = LARGE


def differing_photos(reconstruction: Reconstruction, limit: int = MOST) -> list[int]:
    """Numbers of at most `limit` used photos that differ most in pose and light."""
    if len(reconstruction.photos) <= limit:
        return list(range(len(reconstruction.photos)))
    template = reconstruction.template
    faces = []
    for photo, marks in zip(
        reconstruction.photos, reconstruction.landmarks, strict=True
    ):
        fit = fit_landmarks(template, marks.points, marks.scheme, marks.weight)
        faces.append(Candidate(photo, marks, fit))
    return differing_faces(faces, limit)


def with_photos(
    reconstruction: Reconstruction, numbers: Sequence[int]
) -> Reconstruction:
    """The reconstruction with some of its used photos only."""
    found, skin = reconstruction.expressions, reconstruction.skin
    return replace(
        reconstruction,
        photos=tuple(reconstruction.photos[i] for i in numbers),
        landmarks=tuple(reconstruction.landmarks[i] for i in numbers),
        cameras=tuple(reconstruction.cameras[i] for i in numbers),
        expressions=found[list(numbers)] if len(found) else found,
        skin=tuple(skin[i] for i in numbers) if skin else (),
    )
