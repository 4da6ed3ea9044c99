"""The picture of a whole head: the face's texture, and around it plain skin.

The face's (u, v) square lies in it unscaled (`SQUARE` of :mod:`bsface.rig.base_head`),
so no texel of the face is resampled. Towards the outline of the face the texture fades
into the person's plain skin colour, which the rest of the head has.

A tangent-space normal map is laid into it in the same way: the square is only moved
and made smaller, by the same factor along u and v, so the directions of the picture on
the head are those of (u, v) on the face, and the map's vectors stay what they are.
"""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from ..drawing.pictures import encode_png
from ..errors import ReconstructionError
from ..rig.base_head import SQUARE, face_region
from ..surface.template import Template

Picture = npt.NDArray  # uint8 or uint16

#: Shares of the face, see `face_region`, between which the texture fades out.
FADE = (0.72, 0.99)
#: Shares between which the skin colour is measured: not lips and nose, not the hair.
MEASURED = (0.45, 0.80)
#: Around the face a normal map turns nothing and a displacement moves nothing; shares
#: of the full scale.
FLAT, STILL = (0.5, 0.5, 1.0), (0.5, 0.5, 0.5)
#: The side of a texture is a multiple of this, so that the square has whole texels.
_EVEN = 8
#: Share of the picture over which the colour of the rim goes on, and the texels a side
#: with which that is computed.
REACH, _SMALL = 0.06, 192


def head_picture(
    picture: Picture, template: Template, plain: npt.ArrayLike | None = None
) -> Picture:
    """A picture over (u, v), laid into the head's picture.

    Parameters
    ----------
    picture : (H, W, 3 or 4) uint8 or uint16 array
        Over (u, v), row 0 at v = 0; a fourth channel is left out.
    template : Template
        Says where skin is.
    plain : (3,), optional
        Colour of the rest of the head from 0 to 1, such as `FLAT`; by default that of
        the skin.

    Returns
    -------
    (S, S, 3) array
        Of the same type; S is half as much again as the longer side of the picture.
    """
    colours = np.ascontiguousarray(picture[..., :3])
    side = -(-max(colours.shape[:2]) // _EVEN) * _EVEN
    if colours.shape[:2] != (side, side):
        colours = cv2.resize(colours, (side, side), interpolation=cv2.INTER_LINEAR)
    region, skin = _places(side, template)
    t = np.clip((FADE[1] - region) / (FADE[1] - FADE[0]), 0, 1)
    share = (t * t * (3 - 2 * t))[..., None]
    whole = round(side / SQUARE[2])
    left, top = (round(x * whole) for x in SQUARE[:2])
    here = np.s_[top : top + side, left : left + side]
    most = np.iinfo(picture.dtype).max
    if plain is None:
        around = _skin_around(colours, skin & (region < MEASURED[1]), whole, here)
    else:
        # Half a step is rounded up, as in the maps themselves.
        even = np.floor(np.asarray(plain, float) * most + 0.5)
        around = np.broadcast_to(even, (whole, whole, 3)).copy()
    around[here] += share * (colours - around[here])
    return np.round(np.clip(around, 0, most)).astype(picture.dtype)


def _places(side: int, template: Template) -> tuple[npt.NDArray, npt.NDArray]:
    """`face_region` of the texels of the square, and whether they are skin."""
    at = (np.arange(side) + 0.5) / side
    u, v = np.meshgrid(at, at)
    uv = np.stack([u, v], axis=-1)
    region = face_region(uv)
    return region, template.is_skin(uv) & (region > MEASURED[0])


def _skin_around(
    colours: Picture, skin: npt.NDArray[np.bool_], whole: int, here: tuple
) -> npt.NDArray[np.float64]:
    """Skin for the whole picture: next to the face that of its rim, then the median.

    A mean of the rim's texels under a Gaussian; the median counts a little everywhere.
    """
    above_mouth = skin.copy()
    above_mouth[round(0.6 * len(skin)) :] = False
    plain = np.median(colours[above_mouth], axis=0)
    weighted = np.zeros((whole, whole, 4))
    weighted[here] = skin[..., None] * np.dstack([colours - plain, np.ones(skin.shape)])
    small = cv2.resize(weighted, (_SMALL, _SMALL), interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), REACH * _SMALL)
    small = small[..., :3] / (small[..., 3:] + 0.03)
    return plain + cv2.resize(small, (whole, whole), interpolation=cv2.INTER_CUBIC)


def head_texture(
    path: str | os.PathLike | bytes,
    template: Template,
    plain: npt.ArrayLike | None = None,
) -> bytes:
    """The head's picture of a texture file over (u, v), as PNG.

    Parameters
    ----------
    path : path-like, or bytes
        PNG or JPEG, or its content, 8 or 16 bits, row 0 at v = 0.
    template : Template
    plain : (3,), optional
        Colour of the rest of the head from 0 to 1: `FLAT` for a normal map, `STILL` for
        a displacement.

    Returns
    -------
    bytes
        Grey if the file is.

    Raises
    ------
    ReconstructionError
        When it cannot be read.
    """
    flags = cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        content = path if isinstance(path, bytes) else Path(path).read_bytes()
        found = cv2.imdecode(np.frombuffer(content, np.uint8), flags)
    except (OSError, cv2.error):
        found = None
    if found is None or found.dtype not in (np.uint8, np.uint16):
        shown = "bytes" if isinstance(path, bytes) else path
        raise ReconstructionError(
            f"{shown}: the texture cannot be read; give a PNG or JPEG picture."
        )
    if found.ndim == 2:
        grey = np.repeat(found[..., None], 3, axis=2)
        return encode_png(head_picture(grey, template, plain)[..., 0])
    return encode_png(head_picture(found[..., ::-1], template, plain))
