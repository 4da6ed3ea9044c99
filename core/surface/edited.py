"""An edited face as the template of the next run."""

from __future__ import annotations

from dataclasses import replace

from .alignment import eye_centres, fit_similarity
from .bspline import BSplineSurface
from .template import Template


def edited_template(surface: BSplineSurface, base: Template) -> Template:
    """The template with an edited face in place of its own.

    The face is brought to the size and place of the template by its landmarks; the
    free landmark points keep their offset from the surface.

    Parameters
    ----------
    surface : BSplineSurface
        A result, edited; any size of net.
    base : Template
        Gives everything else; resampled to the net of ``surface``.
    """
    base = base.resampled(surface.shape)
    uv = base.landmark_uv
    there = base.surface.evaluate(*uv.T)
    sure = base.landmark_reliable
    place = fit_similarity(surface.evaluate(*uv[sure].T), there[sure])
    moved = surface.transformed(place.scale, place.R, place.t)
    return replace(
        base,
        surface=moved,
        landmark_xyz=base.landmark_xyz + moved.evaluate(*uv.T) - there,
        eye_centres=eye_centres(moved, base),
    )
