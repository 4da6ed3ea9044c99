#!/usr/bin/env python3
"""Prints how well the rows and columns of the bundled net follow the features.

    python tools/feature_rows.py

A uniform net has no row along a lid or a lip unless the parametrisation puts one
there.  For each feature line of the right half of the face (the left half is its mirror
image) the table has

* how far the line leaves the row (or column) through its middle, at most: in knot
  spans, and in mm on the surface;
* the angle on the surface between the line and the rows (columns), mean over it.

The brows, the wings of the nose and the outer lips are landmarks of the template; the
lid margins and the line between the lips are those of the ARKit keys.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
from bsface.rig.arkit import face_units
from bsface.surface.bspline import BSplineSurface
from bsface.surface.template import Template, load_template

ACROSS, DOWN = 0, 1
SAMPLES = 200
# Of the lid margins and the lip line: the corners, where upper and lower meet, are in
# no row of either.
INNER = (0.15, 0.85)
# Points of the 468 along the groove of the wing of the nose, from above.
WING = (209, 49, 129, 64)


@dataclass(frozen=True)
class Line:
    """A feature line.

    Attributes
    ----------
    name : str
    uv : (k, 2) array
        Points along it.
    along : int
        `ACROSS` where a row should follow it, `DOWN` for a column.
    """

    name: str
    uv: np.ndarray
    along: int = ACROSS


@dataclass(frozen=True)
class Departure:
    """How far a line leaves the row or column through its middle.

    Attributes
    ----------
    row : float
        That row or column, in knot spans from the border.
    spans, mm : float
        Largest distance from it, in knot spans and on the surface.
    degrees : float
        Mean angle on the surface between the line and the rows or columns.
    """

    row: float
    spans: float
    mm: float
    degrees: float


def feature_lines(template: Template) -> list[Line]:
    """Lines of the right half of the face, and those across its middle.

    ``template`` must have the parametrisation that the ARKit keys were made for.
    """
    mark, units = template.landmark_uv, face_units()
    points = mark[template.schemes["68"]]
    lid = units.lids_uv[0]
    half = len(lid) // 2
    closed = np.concatenate([lid, lid[:1]])
    return [
        Line("brow", points[17:22]),
        Line("upper lid", part(closed[: half + 1], INNER)),
        Line("lower lid", part(closed[half:], INNER)),
        Line("bridge of the nose", points[27:31], DOWN),
        Line("wing of the nose", mark[list(WING)], DOWN),
        Line("base of the nose", points[31:36]),
        Line("upper lip, border", part(points[48:55], INNER)),
        Line("line between the lips", part(units.lips_uv, INNER)),
        Line("lower lip, border", part(points[[54, *range(55, 60), 48]], INNER)),
    ]


def part(uv: np.ndarray, share: tuple[float, float]) -> np.ndarray:
    """What lies between two shares of a line's length, as `SAMPLES` points."""
    length = np.append(0, np.cumsum(np.linalg.norm(np.diff(uv, axis=0), axis=1)))
    at = np.linspace(*share, SAMPLES) * length[-1]
    return np.stack([np.interp(at, length, x) for x in uv.T], 1)


def departure(surface: BSplineSurface, line: Line) -> Departure:
    """Measure one line on a surface."""
    uv = part(line.uv, (0, 1))
    spans = np.array(surface.shape) - 3
    across = 1 - line.along  # the parameter that is constant along the row
    length = np.linalg.norm(np.diff(surface.evaluate(*uv.T), axis=0), axis=1)
    middle = np.average((uv[1:, across] + uv[:-1, across]) / 2, weights=length)
    off = uv[:, across] - middle
    foot = uv.copy()
    foot[:, across] = middle
    away = np.linalg.norm(surface.evaluate(*uv.T) - surface.evaluate(*foot.T), axis=1)
    halfway = (uv[1:] + uv[:-1]) / 2
    du = surface.evaluate(*halfway.T, du=1)
    dv = surface.evaluate(*halfway.T, dv=1)
    step = np.diff(uv, axis=0)
    tangent = step[:, :1] * du + step[:, 1:] * dv
    iso = (du, dv)[line.along]
    cosine = np.abs((tangent * iso).sum(1)) / (
        np.linalg.norm(tangent, axis=1) * np.linalg.norm(iso, axis=1)
    )
    angle = np.degrees(np.arccos(np.clip(cosine, 0, 1)))
    return Departure(
        row=float(middle * spans[across]),
        spans=float(np.abs(off).max() * spans[across]),
        mm=float(away.max()),
        degrees=float(np.average(angle, weights=length)),
    )


def table(surface: BSplineSurface, lines: list[Line]) -> str:
    """The departures of lines on a surface, in Markdown."""
    rows = [
        "| line | row or column | leaves it by, spans | mm | angle, degrees |",
        "|---|---|---|---|---|",
    ]
    for line in lines:
        found = departure(surface, line)
        rows.append(
            f"| {line.name} | {('row', 'column')[line.along]} {found.row:.2f} "
            f"| {found.spans:.2f} | {found.mm:.1f} | {found.degrees:.0f} |"
        )
    return "\n".join(rows)


def main() -> None:
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    template = load_template()
    print(table(template.surface, feature_lines(template)))


if __name__ == "__main__":
    main()
