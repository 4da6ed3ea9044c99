"""Pictures over (u, v) for the surface, from the core's results; no Blender in here.

Row j of a picture is v_j, so its first row is the forehead; sRGB-encoded.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

RESOLUTION = 512
# Relative difference between photo and surface that gets the last colour.
RESIDUAL_TOP = 0.3


@dataclass(frozen=True)
class Map:
    """One picture for the surface.

    Attributes
    ----------
    pixels : (h, w, 3) uint8 array, or floats in [0, 1]
    legend : str
        What its colours mean, one line.
    """

    pixels: Any
    legend: str = ""


def all_maps(result, texture=None):
    """All maps of a reconstruction by kind; see `material.MAPS`.

    Parameters
    ----------
    result : core Reconstruction
    texture : core Texture, optional
        Without it there is no skin.
    """
    from ..core.drawing.maps import confidence_map, residual_map
    from ..core.drawing.pictures import colour_map
    from ..core.images.colour import to_picture

    found = {"NORMALS": normals(result.surface)}
    residual = None
    if texture is not None:
        found["SKIN"] = Map(to_picture(texture.albedo))
        found["PHOTO"] = Map(to_picture(texture.mean))
        residual = texture.residual
    if result.photometric is not None:
        measured = residual_map(result.photometric, RESOLUTION)
        residual = residual if measured is None else measured
    if residual is not None:
        found["RESIDUAL"] = Map(
            colour_map(residual, 0.0, RESIDUAL_TOP, "magma"),
            f"Dark: photos and surface agree; light: {RESIDUAL_TOP:.0%} apart; "
            "grey: not measured",
        )
    if result.deviation is not None:
        values = confidence_map(result.deviation, RESOLUTION)
        top = float(np.percentile(values, 98))
        found["CONFIDENCE"] = Map(
            colour_map(values, 0.0, top),
            f"Standard deviation, from dark: 0 to yellow: {top:.1f} mm",
        )
    return found


def normals(surface):
    """Normals as colours: red is x (the picture's right), green y (up), blue z."""
    at = (np.arange(RESOLUTION) + 0.5) / RESOLUTION
    return Map(
        (surface.normals(*np.meshgrid(at, at)) + 1) / 2,
        "Red: to the picture's right, green: up, blue: to the camera",
    )
