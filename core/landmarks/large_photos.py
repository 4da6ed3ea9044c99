"""Of many photos only some are kept in full size, so that they fit into memory.

Shape is measured on pictures of about `SMALL` pixels. Only the texture shows more, and
it is made of the photos that differ most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..errors import PhotoFailure
from ..images.photo import reduced
from .differing import differing_faces
from .face_selection import Candidate, Faces, usable_faces

#: So many photos may be larger than `SMALL` pixels in the end.
LARGE = 48
SMALL = 400
# So many more are waited for before it is chosen anew.
_SLACK = 30


def few_large(
    found: Sequence[Faces | PhotoFailure], most: int = LARGE, slack: int = _SLACK
) -> list[Faces | PhotoFailure]:
    """The same faces; of more than `most` large photos the others are made smaller.

    Parameters
    ----------
    found : sequence
        Of each photo its faces, or why it is of no use.
    most : int
    slack : int
        So many more may stay large, as there may be photos to come.
    """
    kept = list(found)
    large = {
        k: faces
        for k, faces in enumerate(found)
        if not isinstance(faces, PhotoFailure) and any(map(_is_large, faces))
    }
    if len(large) <= most + slack:
        return kept
    usable = [k for k, faces in large.items() if usable_faces(faces)]
    chosen = differing_faces([usable_faces(large[k])[0] for k in usable], most)
    for k in large.keys() - {usable[i] for i in chosen}:
        kept[k] = tuple(
            replace(face, photo=reduced(face.photo, SMALL)) for face in large[k]
        )
    return kept


def _is_large(face: Candidate) -> bool:
    return max(face.photo.pixels.shape[:2]) > SMALL
