"""Whether a finished surface can be a face: the check that every method ends with.

All lengths are taken after the similarity that brings the surface's landmarks onto the
template's, so unit and frame of the surface do not matter.  Good results stay below 0.3
eye distances and a stretch of 3.1 (a wide open mouth); a spike of Algorithm 1 begins at
1 and 10.  The limits lie between.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import ReconstructionError
from ..surface.alignment import fit_similarity
from ..surface.bspline import BSplineSurface, grid_parameters
from ..surface.template import Template

# Side of the grid of points that are looked at.
_GRID = 81
# The first and last basis functions are at most 1/6 on the surface, the others 2/3.
_BORDER = 0.25
# Of a coordinate, in any unit: beyond, squares lose their digits.
_FARTHEST = 1e9
_REMEDY = "use the default method and net, more photos, or photos under more even light"


@dataclass(frozen=True)
class SurfaceMeasures:
    """How far a surface is from the template.

    Attributes
    ----------
    landmarks : float
        Root mean square distance of the reliable landmarks, in eye distances.
    farthest : float
        Largest distance of a surface point, in eye distances.
    net : float
        Largest distance of a control point, in eye distances. Those of the net's border
        reach the surface with a quarter of the weight of others, and count as much.
    turned : float
        Share of the skin whose normal is turned by more than 90 degrees.
    stretch : float
        Largest length of a short piece of a parameter line in units of the same piece
        of the template. (Lips and lids that close make pieces short on good faces.)
    """

    landmarks: float
    farthest: float
    net: float
    turned: float
    stretch: float


#: Above these a surface is no face: it is refused.
UNUSABLE = SurfaceMeasures(0.5, 0.9, 2.5, 0.05, 10.0)
#: Above these it is doubtful: it is returned with a warning.
DOUBTFUL = SurfaceMeasures(0.15, 0.5, 0.6, 0.005, 5.0)


def check_surface(surface: BSplineSurface, template: Template) -> tuple[str, ...]:
    """Warnings about a surface that may not be a face.

    Parameters
    ----------
    surface : BSplineSurface
        In any frame and unit, with the parameters of the template.
    template : Template

    Returns
    -------
    tuple of str
        One sentence per finding; empty for a face like others.

    Raises
    ------
    ReconstructionError
        The surface is no face.
    """
    if not np.abs(surface.control_points).max() < _FARTHEST:
        raise ReconstructionError(
            f"The result is no face: its control points reach beyond every size that "
            f"a face has in any unit; {_REMEDY}."
        )
    found = measure_surface(surface, template)
    unusable = _findings(found, UNUSABLE)
    if unusable:
        raise ReconstructionError(
            f"The result is no face: {', and '.join(unusable)}; {_REMEDY}."
        )
    return tuple(
        f"The face may be wrong: {finding}; look at it, or {_REMEDY}."
        for finding in _findings(found, DOUBTFUL)
    )


def measure_surface(surface: BSplineSurface, template: Template) -> SurfaceMeasures:
    """Measures of a finite surface against the template."""
    home, eye = template.surface, template.eye_distance
    marks = template.landmark_uv[template.landmark_reliable]
    there = home.evaluate(*marks.T)
    found = surface.evaluate(*marks.T)
    if np.ptp(found, axis=0).max() <= 0:
        return SurfaceMeasures(*[np.inf] * 5)
    move = fit_similarity(found, there)
    aligned = surface.transformed(move.scale, move.R, move.t)
    uv = np.stack(grid_parameters(_GRID, _GRID), 1)
    uv = uv[template.is_skin(uv)]
    cosine = (aligned.normals(*uv.T) * home.normals(*uv.T)).sum(1)
    grids = aligned.grid(_GRID, _GRID), home.grid(_GRID, _GRID)
    pieces = [
        [np.linalg.norm(np.diff(g, axis=k), axis=-1).ravel() for k in (0, 1)]
        for g in grids
    ]
    here, before = (np.maximum(np.concatenate(p), 1e-9 * eye) for p in pieces)
    away = np.linalg.norm(grids[0] - grids[1], axis=-1)
    net = np.linalg.norm(aligned.control_points - home.control_points, axis=-1)
    net[[0, -1]] *= _BORDER
    net[:, [0, -1]] *= _BORDER
    marked = np.linalg.norm(aligned.evaluate(*marks.T) - there, axis=1)
    return SurfaceMeasures(
        landmarks=float(np.sqrt((marked**2).mean())) / eye,
        farthest=float(away.max()) / eye,
        net=float(net.max()) / eye,
        turned=float((cosine < 0).mean()),
        stretch=float((here / before).max()),
    )


def _findings(found: SurfaceMeasures, limits: SurfaceMeasures) -> list[str]:
    """What exceeds its limit, in words."""
    sentences = {
        "landmarks": f"its features are {found.landmarks:.2f} eye distances from those "
        "of the average face",
        "farthest": f"a point lies {found.farthest:.1f} eye distances from its place "
        "on the average face",
        "net": f"a control point lies {found.net:.1f} eye distances from its place on "
        "the average face",
        "turned": f"{100 * found.turned:.1f} % of the skin is folded over",
        "stretch": f"a part is stretched by a factor of {found.stretch:.0f}",
    }
    return [
        sentence
        for name, sentence in sentences.items()
        if not getattr(found, name) <= getattr(limits, name)
    ]
