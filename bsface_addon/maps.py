"""Pictures over (u, v) for the surface, from the core's results; no Blender in here.

Row j of a picture is v_j, so its first row is the forehead; sRGB-encoded.
"""

from __future__ import annotations

import numpy as np

RESOLUTION = 512
# Relative difference between photo and surface that gets the last colour.
RESIDUAL_TOP = 0.3


def all_maps(result, progress=None, texture_size=None):
    """All maps of a reconstruction by kind; see `material.MAPS`.

    Parameters
    ----------
    result : core Reconstruction
    progress : callable, optional
        Called with the fraction done.
    texture_size : int, optional
        Pixels along a side of the skin; by default what the photos are worth.

    Returns
    -------
    dict of (h, w, 3) uint8 or float arrays
    """
    from ..core.output.colour import to_picture
    from ..core.output.pictures import colour_map
    from ..core.output.texture import bake_texture

    found = {"NORMALS": normals(result.surface)}
    if result.confidence is not None:
        found["CONFIDENCE"] = confidence(result.surface, result.confidence)
    if result.photos:
        texture = bake_texture(result, texture_size, progress)
        found["SKIN"] = to_picture(texture.albedo)
        found["PHOTO"] = to_picture(texture.mean)
        found["RESIDUAL"] = colour_map(texture.residual, 0.0, RESIDUAL_TOP, "magma")
    return found


def normals(surface):
    """Normals as colours: red is x (the picture's right), green y (up), blue z."""
    return (surface.normals(*_parameters()) + 1) / 2


def confidence(surface, deviation):
    """Standard deviation of the control points (M, N), mm, as colours."""
    from ..core.output.pictures import colour_map

    u, v = _parameters()
    values = surface.matrix(u.ravel(), v.ravel()) @ np.asarray(deviation).ravel()
    return colour_map(values.reshape(u.shape), 0.0, None, "viridis")


def _parameters():
    at = (np.arange(RESOLUTION) + 0.5) / RESOLUTION
    return np.meshgrid(at, at)
