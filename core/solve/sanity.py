"""Whether a finished surface can be a face: the check that every method ends with.

All lengths are taken after the similarity that brings the surface's landmarks onto the
template's, so the unit and the frame of the surface do not matter.  The limits are set
by what the methods give on the sets with ground truth and on the example photos:
`tests/core/test_sanity.py` holds them from both sides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..surface.alignment import fit_similarity
from ..surface.bspline import BSplineSurface
from ..surface.template import Template

# Side of the grid of points that are looked at.
_GRID = 81


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
        Largest distance of a control point, in eye distances.
    turned : float
        Share of the skin whose normal is turned by more than 90 degrees.
    stretch : float
        Largest length of a short piece of a parameter line over that on the template,
        or the inverse.
    """

    landmarks: float
    farthest: float
    net: float
    turned: float
    stretch: float


def measure_surface(surface: BSplineSurface, template: Template) -> SurfaceMeasures:
    """Measures of a finite surface against the template."""
    marks = template.landmark_uv[template.landmark_reliable]
    move = fit_similarity(
        surface.evaluate(*marks.T), template.surface.evaluate(*marks.T)
    )
    aligned = surface.transformed(move.scale, move.R, move.t)
    home, eye = template.surface, template.eye_distance
    x = np.linspace(0, 1, _GRID)
    uv = np.stack(np.meshgrid(x, x, indexing="ij"), -1).reshape(-1, 2)
    skin = template.is_skin(uv)
    here, there = aligned.grid(_GRID, _GRID), home.grid(_GRID, _GRID)
    away = np.linalg.norm(here - there, axis=-1)
    cosine = (aligned.normals(*uv.T) * home.normals(*uv.T)).sum(1)
    ratio = [
        np.linalg.norm(np.diff(here, axis=k), axis=-1)
        / np.linalg.norm(np.diff(there, axis=k), axis=-1)
        for k in (0, 1)
    ]
    a, b = (s.evaluate(*marks.T) for s in (aligned, home))
    net = np.linalg.norm(aligned.control_points - home.control_points, axis=-1)
    return SurfaceMeasures(
        landmarks=float(np.sqrt(((a - b) ** 2).sum(1).mean())) / eye,
        farthest=float(away.max()) / eye,
        net=float(net.max()) / eye,
        turned=float((cosine[skin] < 0).mean()),
        stretch=float(max(max(r.max(), 1 / max(r.min(), 1e-9)) for r in ratio)),
    )
