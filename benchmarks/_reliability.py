"""Is the surface's own standard deviation true?  Compared with the measured distance.

The reconstruction states a standard deviation along the normal at each control point.
At each vertex of the ground truth it is read at the closest surface point, and the
share of the area whose distance lies within the central interval of a normal
distribution of that width is compared with the interval's probability.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from _sets import FaceSet, Score
from _table import text_table
from bsface.result import Reconstruction
from bsface.surface.bspline import basis_matrix
from scipy.special import ndtri

#: Probabilities of the central intervals.
LEVELS = (0.25, 0.5, 0.68, 0.8, 0.9, 0.95)
#: Parts of the face, from the best known to the least, for the second comparison.
PARTS = 5


def reliability(
    one: FaceSet, method: str, result: Reconstruction | None, found: Score
) -> list[dict[str, Any]]:
    """Rows for the table and the page; none if the method states no deviation.

    Parameters
    ----------
    one : FaceSet
    method : str
    result : Reconstruction or None
    found : Score
        Of the result's surface.
    """
    if result is None or result.deviation is None:
        return []
    scale, R, t = found.transform
    counts = np.isfinite(found.error)
    truth = np.asarray(one.truth["vertices"], float)[counts]
    area = one.areas()[counts]
    uv, _ = result.surface.closest_point((truth - t) @ R / scale)
    field = basis_matrix(result.surface.shape, *uv.T) @ result.deviation.ravel()
    deviation = 100 * scale * field / one.eye_distance
    return compare(one.name, method, deviation, found.error[counts], area)


def compare(
    name: str,
    method: str,
    deviation: np.ndarray,
    error: np.ndarray,
    area: np.ndarray,
) -> list[dict[str, object]]:
    """Shares within each interval, and deviation against error from part to part.

    Parameters
    ----------
    name, method : str
    deviation, error, area : (v,) arrays
        The first two in the same unit.
    """
    area = area / area.sum()
    row: dict[str, object] = {"set": name, "method": method}
    for level in LEVELS:
        radius = ndtri(0.5 + level / 2) * deviation
        row[f"within {level:.0%}"] = float(area @ (error <= radius))
    order = np.argsort(deviation)
    part = np.minimum((np.cumsum(area[order]) * PARTS).astype(int), PARTS - 1)
    for k in range(PARTS):
        chosen = order[part == k]
        w = area[chosen] / area[chosen].sum()
        row[f"said {k + 1}"] = float(np.sqrt(w @ deviation[chosen] ** 2))
        row[f"is {k + 1}"] = float(np.sqrt(w @ error[chosen] ** 2))
    return [row]


def reliability_table(rows: list[dict[str, object]]) -> str:
    """Both comparisons as text."""
    labels = [("set", "set"), ("method", "method")]
    first = [(f"within {p:.0%}", f"{p:.0%}", ".0%") for p in LEVELS]
    second = [
        (f"{word} {k + 1}", f"{word} {k + 1}", ".2f")
        for k in range(PARTS)
        for word in ("said", "is")
    ]
    return (
        "share of the area within the interval that the stated deviation gives to a "
        "probability of\n"
        + text_table(rows, first, labels)
        + "\n\nstated deviation and RMS distance, % of the eye distance, in fifths of "
        "the area from the best known\n" + text_table(rows, second, labels)
    )
