"""Pictures over (u, v) for the surface, from the core's results; no Blender in here.

They are PNG files, so that Blender has nothing to do but to keep them: made by the
thread that solves, read when they are drawn.  The last row of each is v = 0, the
forehead, because texture coordinates start at the bottom; outside of the face's outline
they are transparent.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core._types import Array
from ..core.drawing.maps import confidence_map, residual_map
from ..core.drawing.pictures import colour_map, encode_png
from ..core.images.colour import to_picture
from ..core.result import Reconstruction
from ..core.surface.bspline import BSplineSurface, dense_basis
from ..core.surface.template import Template
from ..core.texture.bake import Texture
from ..core.texture.detail import Detail, normal_picture
from ..core.texture.head import FLAT, head_picture

RESOLUTION = 512
# Relative difference between photo and surface that gets the last colour.
RESIDUAL_TOP = 0.3
# The colour of a face without a map, sRGB.
PLAIN = (206, 173, 155)
# The outline in parts of a pixel, as powers of two (OpenCV).
SHIFT = 4


@dataclass(frozen=True)
class Map:
    """One picture for the surface.

    Attributes
    ----------
    png : bytes
        RGBA.
    legend : str
        What its colours mean, one line.
    """

    png: bytes
    legend: str = ""


def all_maps(result: Reconstruction, texture: Texture | None = None) -> dict[str, Map]:
    """All maps of a reconstruction by kind; see `material.MAPS`.

    Parameters
    ----------
    result : Reconstruction
    texture : Texture, optional
        Without it there is no skin.
    """
    outline = result.template.outline_uv
    plain = np.full((RESOLUTION, RESOLUTION, 3), PLAIN, np.uint8)
    found = {
        "PLAIN": painted(plain, outline),
        "NORMALS": normals(result.surface, outline),
    }
    residual = None
    if texture is not None and texture.detail is not None:
        found["DETAIL"] = detail_map(texture.detail)
    if texture is not None:
        found["SKIN"] = painted(to_picture(texture.albedo), outline)
        found["PHOTO"] = painted(to_picture(texture.mean), outline)
        residual = texture.residual
    if result.photometric is not None:
        measured = residual_map(result.photometric, RESOLUTION)
        residual = residual if measured is None else measured
    if residual is not None:
        found["RESIDUAL"] = painted(
            colour_map(residual, 0.0, RESIDUAL_TOP, "magma"),
            outline,
            f"Dark: photos and surface agree; light: {RESIDUAL_TOP:.0%} apart; "
            "grey: not measured",
        )
    if result.deviation is not None:
        found["DEVIATION"] = _deviation(result.deviation, outline)
    return found


def normals(surface: BSplineSurface, outline_uv: Array) -> Map:
    """Normals as colours: red is x (the picture's right), green y (up), blue z."""
    at = (np.arange(RESOLUTION) + 0.5) / RESOLUTION
    (bu, du), (bv, dv) = (
        (dense_basis(count, at, 0), dense_basis(count, at, 1))
        for count in surface.shape
    )
    # A grid needs no evaluation point by point: one product along each direction.
    along_u = np.einsum("vn,um,mnx->vux", bv, du, surface.control_points, optimize=True)
    along_v = np.einsum("vn,um,mnx->vux", dv, bu, surface.control_points, optimize=True)
    normal = np.cross(along_v, along_u)
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    colours = (normal + 1) / 2
    return painted(
        np.round(255 * colours).astype(np.uint8),
        outline_uv,
        "Red: to the picture's right, green: up, blue: to the camera",
    )


def detail_map(detail: Detail) -> Map:
    """The normal map for Blender's UVs, whose v runs down the face: green too."""
    picture = normal_picture(
        replace(detail, normals=detail.normals * np.array([1, -1, 1], np.float32)), 16
    )
    return Map(encode_png(np.ascontiguousarray(picture[::-1])))


def painted(pixels: NDArray[np.uint8], outline_uv: Array, legend: str = "") -> Map:
    """A `Map` of an (h, w, 3) picture whose row j is v_j, cut out at the outline."""
    rgba = np.dstack([pixels, inside(outline_uv, *pixels.shape[:2])])
    return Map(encode_png(np.ascontiguousarray(rgba[::-1])), legend)


def head(png: bytes, template: Template, *, detail: bool = False) -> bytes:
    """The picture of a head, from the packed file of a map.

    Parameters
    ----------
    png : bytes
        Its last row is v = 0, as that of the picture that is made.
    template : Template
    detail : bool
        Whether it is the normal map, which is flat around the face.
    """
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), flags)
    made = head_picture(picture[::-1, :, ::-1], template, FLAT if detail else None)
    return encode_png(np.ascontiguousarray(made[::-1]))


def inside(outline_uv: Array, height: int, width: int) -> NDArray[np.uint8]:
    """255 inside of the outline, 0 outside, between them at its border."""
    corners = np.asarray(outline_uv) * (width, height) - 0.5
    mask = np.zeros((height, width), np.uint8)
    whole = np.round(corners * 2**SHIFT).astype(np.int32)
    return cv2.fillPoly(mask, [whole], (255,), cv2.LINE_AA, SHIFT)


def _deviation(deviation: Array, outline_uv: Array) -> Map:
    """Colours from the least to the largest deviation inside the outline."""
    values = confidence_map(deviation, RESOLUTION)
    seen = values[inside(outline_uv, RESOLUTION, RESOLUTION) > 127]
    low, top = (float(x) for x in np.percentile(seen, (2, 95)))
    return painted(
        colour_map(values, low, top),
        outline_uv,
        f"Standard deviation of the surface: dark {low:.2f} mm, yellow {top:.2f} mm",
    )
