"""What is skin in a photo, as pictures: measured, painted, and both as a tint.

No Blender in here, so that a thread can do it.  A picture covers its whole photo as it
is shown, with row 0 at the top.  What a person painted is kept as the content of a mask
file (`core/images/mask_file.py`): white is skin, black is not, and mid grey leaves what
is measured.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from ..core._types import Array32
from ..core.drawing.pictures import encode_png
from ..core.errors import PhotoFailure, ReconstructionError
from ..core.images.mask_file import MAX_SIDE, decode_mask, encode_mask, with_mask
from ..core.images.photo import Photo
from ..core.images.read import read_photo
from ..core.photometry.skin import SkinMask, corrected

# Longer side of the measured masks; they have a pixel a millimetre of the face.
SIDE = 512
# Colour of what is not skin, sRGB, and how much of it lies over the photo.
TINT = (200, 0, 200)
OPACITY = 0.6
# Longer side of the picture that one paints over.
PICTURE_SIDE = 2048


@dataclass(frozen=True)
class PhotoToPaint:
    """A photo whose mask is wanted for painting.

    Attributes
    ----------
    path : Path
    name : str
    measured : bytes
        See `measured`; empty before the first run.
    painted : bytes
        The mask that was painted before; empty for none.
    """

    path: Path
    name: str
    measured: bytes
    painted: bytes


@dataclass(frozen=True)
class Canvas:
    """What is needed to paint the mask of a photo.

    Attributes
    ----------
    name : str
        Of the photo.
    size : (int, int)
        Width and height of the photo in pixels.
    picture, tint : bytes
        PNG files: the photo, and the tint of what was measured.
    strokes : (h, w, 4) float32 array
        See `to_strokes`.
    """

    name: str
    size: tuple[int, int]
    picture: bytes
    tint: bytes
    strokes: Array32


def measured(mask: SkinMask, photo: Photo) -> bytes:
    """The mask as it was measured, as a grey PNG of the whole photo.

    Black, too, is what lies too far from the face to be looked at.
    """
    scale = min(1.0, SIDE / max(photo.size))
    shape = [max(1, round(scale * side)) for side in photo.size[::-1]]
    frame = replace(photo, pixels=np.empty((*shape, 3), np.uint8), window=(0, 0, scale))
    values = mask.values if mask.measured is None else mask.measured
    skin = replace(mask, values=values).on(frame)
    if values.size > 1:
        x0, y0, own = mask.window
        y, x = (
            (np.arange(n) + 0.5) / scale - 0.5 - start
            for n, start in zip(shape, (y0, x0), strict=True)
        )
        height, width = values.shape
        skin[(y < 0) | (y > height / own)] = 0
        skin[:, (x < 0) | (x > width / own)] = 0
    return encode_png(np.round(255 * skin).astype(np.uint8))


def tint(measured: bytes, painted: bytes = b"") -> bytes:
    """What is not skin as a tinted PNG with transparency.

    Parameters
    ----------
    measured : bytes
        See `measured`.
    painted : bytes, optional
        Content of a mask file.
    """
    grey = cv2.imdecode(np.frombuffer(measured, np.uint8), cv2.IMREAD_GRAYSCALE)
    mask = SkinMask(grey.astype(np.float32) / 255, (0.0, 0.0, 1.0))
    if painted:
        own = decode_mask(painted)
        scale = own.shape[1] / mask.values.shape[1]
        mask = corrected(mask, SkinMask(own, (0.0, 0.0, scale)))
    opacity = np.round(255 * OPACITY * (1 - mask.values)).astype(np.uint8)
    colour = np.broadcast_to(np.uint8(TINT), (*opacity.shape, 3))
    return encode_png(np.dstack([colour, opacity]))


def canvas(wanted: PhotoToPaint) -> Canvas:
    """Read what is needed to paint.

    Raises
    ------
    ReconstructionError
        The photo or its mask file cannot be read.
    """
    photo = read_photo(wanted.path, wanted.name)
    if isinstance(photo, PhotoFailure):
        raise ReconstructionError(photo.reason)
    width, height = photo.size
    if wanted.painted:
        photo = replace(photo, mask=decode_mask(wanted.painted))
    else:
        found = with_mask(photo)
        if isinstance(found, PhotoFailure):
            raise ReconstructionError(found.reason)
        photo = found
    scale = min(1.0, MAX_SIDE / max(width, height))
    size = (max(1, round(scale * width)), max(1, round(scale * height)))
    own = np.full((1, 1), 0.5, np.float32) if photo.mask is None else photo.mask
    strokes = to_strokes(cv2.resize(own, size, interpolation=cv2.INTER_LINEAR))
    known = wanted.measured or encode_png(np.full((1, 1), 255, np.uint8))
    picture = photo.bytes8()
    if max(picture.shape) > PICTURE_SIDE:
        factor = PICTURE_SIDE / max(picture.shape)
        picture = cv2.resize(
            picture, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA
        )
    return Canvas(wanted.name, photo.size, encode_png(picture), tint(known), strokes)


def to_strokes(mask: Array32) -> Array32:
    """A mask as paint: white or black, and transparent where nothing is said.

    Parameters
    ----------
    mask : (h, w) float32 array

    Returns
    -------
    (h, w, 4) float32 array
        RGBA, the colour not multiplied by alpha.
    """
    say = 2 * mask - 1
    white = np.repeat((say > 0).astype(np.float32)[..., None], 3, axis=2)
    return np.dstack([white, np.abs(say)])


def to_mask(strokes: Array32) -> bytes:
    """The content of a mask file from paint; empty where the paint says nothing."""
    say = strokes[..., 3] * (2 * strokes[..., 0] - 1)
    found = encode_mask((1 + say) / 2)
    return found if (decode_mask(found) != 0.5).any() else b""


def turned(painted: bytes, quarters: int) -> bytes:
    """The mask of a photo, as that of its copy turned clockwise by quarters."""
    if quarters % 4 == 0:
        return painted
    return encode_mask(np.rot90(decode_mask(painted), -quarters))
