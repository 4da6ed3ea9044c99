"""Which of several faces in each photo is the person: decided over all photos together.

Two faces count as one person by the distance of their descriptors.  The face that has a
counterpart in most other photos is the first guess at the person.  Then each photo
gives the face that agrees best with those of the other photos, until nothing changes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .._types import Array

Index = NDArray[np.int64]

SAME = 0.6  # distance of descriptors at which two faces are as likely one person as two
SOFTNESS = 0.03
RIVAL = 0.7  # a second person in this part of the person's photos is told
ROUNDS = 20


@dataclass(frozen=True, eq=False)
class Choice:
    """One face per photo.

    Attributes
    ----------
    faces : (p,) int array
        The face of the person in each photo, by its number among all faces.
    rival : (q,) int array
        Faces of a second person who is in nearly as many photos; empty without one.
    """

    faces: Index
    rival: Index


def choose(photo: Index, distance: Array, size: Array) -> Choice:
    """The person's face in each photo.

    Parameters
    ----------
    photo : (m,) int array
        The photo that each face is in: 0 to p - 1.
    distance : (m, m) array
        Between the descriptors of the faces.
    size : (m,) array
        Of the faces in their photos.  Between two people who are in equally many photos
        the one with the larger faces is taken.
    """
    likely = 1 / (1 + np.exp((distance - SAME) / SOFTNESS))
    likely[photo[:, None] == photo] = 0.0
    first = _person(photo, likely, size)
    rest = np.setdiff1d(np.arange(len(photo)), first)
    if not len(rest):
        return Choice(first, rest)
    second = rest[_person(photo[rest], likely[np.ix_(rest, rest)], size[rest])]
    # Not one face of each photo, only those that belong together.
    agree = likely[np.ix_(second, second)].sum(axis=1)
    second = second[agree > 0.5 * agree.max()]
    if len(second) < max(2, RIVAL * len(first)):
        return Choice(first, rest[:0])
    same_photos = first[np.isin(photo[first], photo[second])]
    if np.median(size[second]) > np.median(size[same_photos]):
        swapped = _agreeing(photo, likely, size, second)
        return Choice(swapped, np.setdiff1d(first, swapped))
    return Choice(first, second)


def _person(photo: Index, likely: Array, size: Array) -> Index:
    """One face per photo, of the person who is in most photos."""
    in_photo = np.stack(
        [likely[:, photo == p].max(axis=1) for p in np.unique(photo)], axis=1
    )
    support = np.round(in_photo.sum(axis=1), 6)
    start = np.lexsort((-size, -support))[:1]
    return _agreeing(photo, likely, size, start)


def _agreeing(photo: Index, likely: Array, size: Array, start: Index) -> Index:
    """In each photo the face that agrees best with those of the others."""
    # Where none agrees with any other, the largest.
    bonus = 1e-6 * size / size.max()
    bonus[start] += 1.0
    chosen = start
    for _ in range(ROUNDS):
        score = likely[:, chosen].sum(axis=1) + bonus
        order = np.lexsort((-score, photo))
        new = order[np.unique(photo[order], return_index=True)[1]]
        if np.array_equal(new, chosen):
            break
        chosen = new
        bonus[start] = 1e-6 * size[start] / size.max()
    return chosen
