"""Two faces held against each other, point by point of the same (u, v).

All faces of the program share the template's parametrisation: the same (u, v) is the
same place of every face. So two faces are compared without a search for the closest
point, and "where" means the same for both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ._types import Array
from .drawing.pictures import colour_map
from .drawing.render import render_views
from .kinds import SWITCH, expect, expect_whole
from .surface.alignment import Similarity, eye_distance, fit_similarity
from .surface.bspline import BSplineSurface
from .surface.template import Template, load_template
from .texture.views import surface_maps, texel_centres


@dataclass(frozen=True, eq=False)
class Comparison:
    """How two faces differ.

    Attributes
    ----------
    offset : (S, S) array
        Distance from the first face to the second along the first's normals, mm,
        positive outwards; row 0 is v = 0. NaN outside the outline.
    distance : (S, S) array
        Distance between corresponding points, mm, the sliding along the skin included.
    angle : (S, S) array
        Between the normals, degrees.
    mean, rms, median, p95 : float
        Of |offset| over the skin's area, mm.
    mean_pct : float
        Mean in % of the first face's eye distance.
    angle_mean : float
        Degrees.
    similarity : float
        Correlation (-1 to 1) of how the two faces differ from the template: 1 = the
        same features, 0 = nothing in common, whatever their size.
    alignment : Similarity
        What brings the second face onto the first.
    """

    offset: Array
    distance: Array
    angle: Array
    mean: float
    rms: float
    median: float
    p95: float
    mean_pct: float
    angle_mean: float
    similarity: float
    alignment: Similarity

    def summary(self) -> str:
        """One line for people."""
        return (
            f"mean {self.mean:.2f} mm ({self.mean_pct:.2f} % of the eye distance), "
            f"rms {self.rms:.2f}, 95 % below {self.p95:.2f} mm, normals "
            f"{self.angle_mean:.1f} degrees, similarity {self.similarity:.2f}"
        )


def compare(
    first: BSplineSurface,
    second: BSplineSurface,
    template: Template | None = None,
    *,
    keep_size: bool = True,
    size: int = 160,
) -> Comparison:
    """Compare two faces.

    The second is moved onto the first: by the least-squares rigid motion of
    corresponding points, robust against places that really differ.

    Parameters
    ----------
    first, second : BSplineSurface
        May have different numbers of control points.
    template : Template, optional
        For the outline and as the average face; the bundled one by default.
    keep_size : bool
        False: also scale the second face. Photos have no scale, so two results differ
        in size only by the eye distance they were given.
    size : int
        Samples along u and v.

    Raises
    ------
    TypeError, ValueError
        What is no surface, or one without any area.
    """
    for surface in (first, second):
        if not isinstance(surface, BSplineSurface):
            raise TypeError(
                "Two surfaces are compared, such as face.surface; one of them is "
                f"{type(surface).__name__}."
            )
    expect(Template | None, "a Template", template=template)
    expect(SWITCH, "true or false", keep_size=keep_size)
    expect_whole(8, 4096, size=size)
    template = template or load_template()
    a, b = surface_maps(first, size), surface_maps(second, size)
    average = surface_maps(template.surface, size)
    at = texel_centres(size)
    uv = np.stack(np.meshgrid(at, at), axis=-1)
    inside = template.inside(uv.reshape(-1, 2)).reshape(size, size)
    area = np.where(inside, _area(a.points), 0.0)
    for name, maps in (("first", a), ("second", b)):
        if not _area(maps.points)[inside].sum() > 0:
            raise ValueError(f"{name} is collapsed to a point or a line; give a face.")
    w = area[inside] / area[inside].sum()

    moved = _align(b.points[inside], a.points[inside], w, keep_size)
    points, normals = moved(b.points), b.normals @ moved.R.T
    gap = points - a.points
    offset = np.einsum("...c,...c->...", gap, a.normals)
    cosine = np.clip(np.einsum("...c,...c->...", normals, a.normals), -1, 1)
    angle = np.degrees(np.arccos(cosine))
    distance = np.linalg.norm(gap, axis=2)

    features = []
    for maps in (a, b):
        onto = _align(maps.points[inside], average.points[inside], w, False)
        change = onto(maps.points) - average.points
        features.append(np.einsum("...c,...c->...", change, average.normals)[inside])
    size_of = np.abs(offset[inside])
    order = np.argsort(size_of)
    share = np.cumsum(w[order])
    mean = float(w @ size_of)
    eyes = eye_distance(first, template)
    return Comparison(
        offset=np.where(inside, offset, np.nan),
        distance=np.where(inside, distance, np.nan),
        angle=np.where(inside, angle, np.nan),
        mean=mean,
        rms=float(np.sqrt(w @ size_of**2)),
        median=float(size_of[order][np.searchsorted(share, 0.5)]),
        p95=float(size_of[order][np.searchsorted(share, 0.95)]),
        mean_pct=100 * mean / eyes,
        angle_mean=float(w @ angle[inside]),
        similarity=_correlation(features[0], features[1], w),
        alignment=moved,
    )


def comparison_picture(
    comparison: Comparison,
    surface: BSplineSurface,
    template: Template | None = None,
    reach: float | None = None,
    height: int = 400,
) -> npt.NDArray[np.uint8]:
    """The offset on the first face, three views: blue inwards, red outwards.

    Parameters
    ----------
    comparison : Comparison
    surface : BSplineSurface
        The first face.
    template : Template, optional
    reach : float, optional
        Offset of full colour, mm; by default what 95 % stay below.
    height : int
    """
    template = template or load_template()
    reach = reach or max(comparison.p95, 1e-6)
    colours = colour_map(comparison.offset, -reach, reach, "diverging")
    return render_views(surface, template, height=height, colours=colours, shading=0.45)


def _align(source: Array, target: Array, w: Array, keep_size: bool) -> Similarity:
    """Robust least-squares motion of corresponding points."""
    robust = w
    moved = Similarity(1.0, np.eye(3), np.zeros(3))
    for _ in range(8):
        moved = fit_similarity(source, target, robust)
        if keep_size:
            share = robust / robust.sum()
            shift = share @ target - moved.R @ (share @ source)
            moved = Similarity(1.0, moved.R, shift)
        gap = np.linalg.norm(moved(source) - target, axis=1)
        scale = max(1.5 * float(np.median(gap)), 1e-9)
        robust = w / (1 + (gap / scale) ** 2)
    return moved


def _area(points: Array) -> Array:
    """Area element of a grid of points."""
    along_u, along_v = np.gradient(points, axis=1), np.gradient(points, axis=0)
    return np.linalg.norm(np.cross(along_u, along_v), axis=2)


def _correlation(x: Array, y: Array, w: Array) -> float:
    x, y = x - w @ x, y - w @ y
    size = np.sqrt((w @ x**2) * (w @ y**2))
    return float(w @ (x * y) / size) if size > 1e-12 else 0.0
