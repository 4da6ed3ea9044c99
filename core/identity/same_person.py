"""Do the photos show one person?  Strangers are set apart, doubts are told.

From the likeness of all pairs of photos (`appearance`): a photo, or a group of photos,
belongs to the rest if it is about as like the rest as the rest is among itself.

* One photo: its mean likeness to the others, over what the others have among each
  other (median).
* A group: the mean likeness between group and rest, over the geometric mean of what
  both have inside.  Groups come from the leading eigenvectors of the matrix, each
  refined until every photo is in the group that it is more like.

Both ratios are near 1 for one person and 0.1 to 0.7 for two.  The split that looks
worst falls with few photos even for one person, so the limits fall with them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import PhotoFailure
from ..landmarks.face_selection import Candidate
from .descriptor import describe_appearance, similarity

Array = NDArray[np.float64]
Group = NDArray[np.int64]

FEWEST = 5  # photos; with fewer nothing is said
# Limits of the ratios: at many photos, and the fall with 1 / sqrt(number of photos).
# Chosen so that folders of one person stay whole; `benchmarks/strangers.py` tells how
# often they do, and how many strangers are found.
ONE, ONE_FALL = 0.45, 0.35
GROUP, GROUP_FALL, GROUP_MOST = 0.72, 1.1, 0.53
NOISE_FALL = 10.0  # less fall where the likeness of pairs hardly scatters
SIMILAR = 0.25  # of the person's photos; a larger group may be the one that was meant
ONE_DOUBT, GROUP_DOUBT = 0.06, 0.04  # limits of a doubt lie this much higher


@dataclass(frozen=True, eq=False)
class People:
    """Who is who among n photos.

    Attributes
    ----------
    person : (k,) int array
        The photos that show the person, sorted.
    strangers : tuple of int arrays
        Groups of photos that surely show somebody else; a group may be one photo.
    doubtful : tuple of int arrays
        Photos of `person` that may show somebody else.
    """

    person: Group
    strangers: tuple[Group, ...] = ()
    doubtful: tuple[Group, ...] = ()


def separate_identities(
    chosen: Sequence[Candidate | PhotoFailure],
) -> tuple[list[Candidate | PhotoFailure], tuple[str, ...]]:
    """Photos of somebody else become failures; what is not sure is told.

    Compared are photos that have all 468 landmarks; the others pass.

    Parameters
    ----------
    chosen : sequence of Candidate or PhotoFailure

    Returns
    -------
    list of Candidate or PhotoFailure
        In the order given.
    tuple of str
        Sentences for the report.
    """
    result = list(chosen)
    index, photos, landmarks = [], [], []
    for i, item in enumerate(result):
        if not isinstance(item, Candidate) or item.found is None:
            continue
        marks = item.found
        if marks.scheme == "468" and (marks.weight > 0).all():
            index.append(i)
            photos.append(item.photo)
            landmarks.append(marks)
    if len(photos) < FEWEST:
        return result, ()
    names = [photo.name for photo in photos]
    people = split_identities(*similarity(describe_appearance(photos, landmarks)))
    sentences = []
    for group in people.strangers:
        for k in group:
            result[index[k]] = _stranger(names[k])
        if len(group) > SIMILAR * len(people.person):
            sentences.append(
                "The photos show more than one person: the face is made from "
                f"{len(people.person)} of them and not from "
                f"{', '.join(names[k] for k in group)}; put these into a folder of "
                "their own to get the other face."
            )
    for group in people.doubtful:
        sentences.append(
            f"Somebody else may be in {', '.join(names[k] for k in group)}; look at "
            f"{'it' if len(group) == 1 else 'them'}, and ignore "
            f"{'the photo' if len(group) == 1 else 'these photos'} if so."
        )
    return result, tuple(sentences)


def _stranger(name: str) -> PhotoFailure:
    return PhotoFailure(
        name,
        "other_person",
        f"{name} shows somebody else than most photos, or a covered face; if it is "
        "to be used, switch the setting one_person off.",
    )


@dataclass(frozen=True, eq=False)
class _Split:
    rest: Group
    part: Group
    excess: float  #: of the ratio: below 0 surely two people, below 1 perhaps


def split_identities(correlation: Array, overlap: Array) -> People:
    """Set strangers apart, the surest first.

    Parameters
    ----------
    correlation : (n, n) array
        Likeness of the photos, see `appearance.likeness`.
    overlap : (n, n) array
        Weight of each pair, 0 on the diagonal.

    Returns
    -------
    People
        ``person`` is the larger part at each division; of two of one size that with the
        first photo.
    """
    left: Group = np.arange(len(correlation))
    strangers, doubtful = [], []
    while (worst := _worst(correlation, overlap, left)) and worst.excess < 0:
        strangers.append(worst.part)
        left = worst.rest
    sure = left
    while (worst := _worst(correlation, overlap, left)) and worst.excess < 1:
        doubtful.append(worst.part)
        left = worst.rest
    return People(sure, tuple(strangers), tuple(doubtful))


def _worst(correlation: Array, overlap: Array, left: Group) -> _Split | None:
    """The division that looks most like two people, or None."""
    n = len(left)
    if n < FEWEST:
        return None
    C, W = correlation[np.ix_(left, left)], overlap[np.ix_(left, left)]
    all_ = np.ones(n, bool)
    to_rest = _to_group(C, W, all_)
    k = int(to_rest.argmin())
    ratio = float(to_rest[k] / max(float(np.median(to_rest)), 0.02))
    excess = (ratio - (ONE - ONE_FALL / np.sqrt(n))) / ONE_DOUBT
    found = [_Split(np.delete(left, k), left[[k]], excess)]
    for part in _divisions(C, W):
        fall = min(GROUP_FALL, NOISE_FALL * _noise(C, W, part))
        limit = min(GROUP - fall / np.sqrt(n), GROUP_MOST)
        excess = (_ratio(C, W, part) - limit) / GROUP_DOUBT
        found.append(_Split(left[~part], left[part], excess))
    return min(found, key=lambda split: split.excess)


def _divisions(C: Array, W: Array) -> Iterator[NDArray[np.bool_]]:
    """Candidates for the smaller part: leading eigenvectors, refined."""
    mean = (W * C).sum() / W.sum()
    row = (W * (C - mean)).sum(1) / np.maximum(W.sum(1), 1e-9)
    seen: set[bytes] = set()
    # With the photos' own levels a small group stands out, without them an even split.
    for matrix in (C - mean - row[:, None] - row, C - mean):
        leading = np.linalg.eigh(W * matrix)[1][:, -1]
        for part in (
            leading > 0,
            leading > 0.5 * leading.max(),
            leading < 0.5 * leading.min(),
        ):
            refined = _refined(C, W, part)
            if refined is not None and refined.tobytes() not in seen:
                seen.add(refined.tobytes())
                yield refined


def _refined(C: Array, W: Array, part: NDArray[np.bool_]) -> NDArray[np.bool_] | None:
    """Every photo to the part that it is more like; None if one part dissolves."""
    for _ in range(20):
        if min(part.sum(), (~part).sum()) < 2:
            return None
        better = _to_group(C, W, part) > _to_group(C, W, ~part)
        if (better == part).all():
            break
        part = better
    small, large = part.sum(), (~part).sum()
    if min(small, large) < 2:
        return None
    # The first photo is of the person when both parts have one size.
    return ~part if small > large or (small == large and part[0]) else part


def _to_group(C: Array, W: Array, group: NDArray[np.bool_]) -> Array:
    """Mean likeness of each photo to a group, itself left out, ``(n,)``."""
    w = W[:, group]
    return (w * C[:, group]).sum(1) / np.maximum(w.sum(1), 1e-9)


def _noise(C: Array, W: Array, part: NDArray[np.bool_]) -> float:
    """Scatter of the likeness inside the parts, relative to its mean there."""
    n = len(C)
    inside = np.where(part[:, None] == part, W, 0.0)
    total = np.maximum(inside.sum(1), 1e-9)
    mean = float((inside * C).sum() / total.sum())
    # Some photos are like all others, and some, such as blurred ones, like none.
    level = (inside * C).sum(1) / total - mean
    rest = C - mean - level[:, None] - level
    pairs = max(n - 4, 1) / n  # what the levels and means have used up
    scatter = np.sqrt((inside * rest**2).sum() / total.sum() / pairs)
    return float(scatter) / max(mean, 0.02)


def _ratio(C: Array, W: Array, part: NDArray[np.bool_]) -> float:
    """Likeness between the parts over that inside them."""

    def mean(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> float:
        w = W[np.ix_(a, b)]
        return float((w * C[np.ix_(a, b)]).sum() / max(float(w.sum()), 1e-9))

    rest = max(mean(~part, ~part), 1e-3)
    # A small part has few pairs; by chance they may be unlike each other.
    inside = max(mean(part, part), 0.5 * rest)
    return mean(part, ~part) / float(np.sqrt(rest * inside))
