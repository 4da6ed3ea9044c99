"""Do the photos show one person?  Photos of somebody else are set apart.

The person is the largest group of photos whose faces are alike (average linkage of the
distances of their descriptors).  Each photo is then judged by its mean distance to that
group, against what the group's own photos have: an *outlier identity* is further away
by more than any photo of the person usually is.  A face that is turned far to the side,
or whose landmarks are unsure, is described less well and is given more room.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import squareform

from .._types import Array

Index = NDArray[np.int64]

# Mean distance between two people is 0.6 and more, within one person 0.3 to 0.55.
LINK = 0.58
APART = 0.65  # between two photos of one person it is rarely more
# Mean distance to the person's photos above which a photo shows somebody else, or may:
# at least, and relative to the median of the person's own photos.
# `benchmarks/strangers.py` prints how often these limits err.
OUTLIER, OUTLIER_EXCESS = 0.55, 0.20
DOUBT, DOUBT_EXCESS = 0.50, 0.15
# With few photos the median says little: as many more of a usual person are counted in,
# and an outlier must be further away, by so much over the number of photos.
USUAL, USUAL_COUNT, FEW = 0.41, 2, 0.15
# More room for faces that are turned far (from 30 to 60 degrees) or unsure landmarks.
TURNED, TURNED_FROM, TURNED_TO = 0.06, 30.0, 60.0
UNSURE, UNSURE_SCORE = 0.06, 0.1


@dataclass(frozen=True, eq=False)
class People:
    """Who is who among n photos.

    Attributes
    ----------
    person : (k,) int array
        The photos that show the person, sorted.
    others : tuple of int arrays
        Groups of photos that show somebody else; a group may be one photo.
    doubtful : (d,) int array
        Photos of `person` that may show somebody else.
    """

    person: Index
    others: tuple[Index, ...]
    doubtful: Index


def split_identities(
    distance: Array, turn: Array, score: Array, keep: NDArray[np.bool_] | None = None
) -> People:
    """Tell the person's photos from those of others.

    Parameters
    ----------
    distance : (n, n) array
        Between the descriptors of the photos' faces.
    turn : (n,) array
        Angle between the face's axis and the camera's, degrees.
    score : (n,) array
        The face mesh's probability that it saw a face, 0 to 1.
    keep : (n,) bool array, optional
        Photos that are never set apart, only doubted.

    Returns
    -------
    People
        Of two groups of one size the person is that with the first photo.
    """
    n = len(distance)
    everyone = np.arange(n)
    if n < 2:
        return People(everyone, (), everyone[:0])
    close = linkage(squareform(distance, checks=False), "average")
    group = fcluster(close, LINK, "distance")
    sizes = np.bincount(group)
    core = group == group[np.argmax(sizes[group])]
    if core.sum() < 2:  # no two photos agree: nobody knows which is the person
        apart = distance[~np.eye(n, dtype=bool)].min() > APART
        return People(everyone, (), everyone if apart else everyone[:0])
    count = int(core.sum())
    within = distance[np.ix_(core, core)].sum(axis=1) / (count - 1)
    usual = (count * np.median(within) + USUAL_COUNT * USUAL) / (count + USUAL_COUNT)
    mean = distance[:, core].sum(axis=1) / (count - core)
    turned = np.clip((turn - TURNED_FROM) / (TURNED_TO - TURNED_FROM), 0, 1) * TURNED
    unsure = np.clip((1 - score) / UNSURE_SCORE, 0, 1) * UNSURE
    limit = max(usual + OUTLIER_EXCESS, OUTLIER) + FEW / count
    out = mean > limit + turned + unsure
    if keep is not None:
        out &= ~keep
    doubt = ~out & (mean > max(usual + DOUBT_EXCESS, DOUBT) + turned)
    others = [np.flatnonzero(out & (group == g)) for g in np.unique(group[out])]
    return People(
        np.flatnonzero(~out),
        tuple(sorted(others, key=lambda photos: (-len(photos), photos[0]))),
        np.flatnonzero(doubt),
    )
