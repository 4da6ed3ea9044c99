"""Focal length of a photo in pixels, from what its camera wrote into EXIF.

With the size of the face in the picture it tells how far the camera stood
(`core/camera/prior.py`).  Cameras and phones state it as that of 35 mm film with the
same diagonal (CIPA DC-008, FocalLengthIn35mmFilm), some as the true one beside the
density of the sensor's pixels.  A picture that was cropped keeps the entry, though it
is not true of it any more: where a crop shows, the focal length counts as unknown.
"""

from __future__ import annotations

import math
import struct

from .._types import Picture8
from .exif import exif_fields
from .tiff import Field

_FOCAL_MM, _WIDTH, _HEIGHT = 37386, 40962, 40963
_DENSITY, _DENSITY_UNIT, _ZOOM, _FOCAL_35 = 41486, 41488, 41988, 41989
FILM_DIAGONAL_MM = math.hypot(36, 24)
_UNITS_MM = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
#: Widths of sensors whose cameras state the density of their pixels, mm.
_SENSORS_MM = (35.9, 28.7, 23.6, 22.4, 17.3, 13.2)
#: Longer side over shorter side of pictures as cameras write them.
_SHAPES = (4 / 3, 3 / 2, 16 / 9)
_SAME = 0.02
#: Focal length in diagonals of the picture, 8 to 1200 mm of 35 mm film.
_NEAREST, _FARTHEST = 0.18, 28.0
# Adobe's programs note a crop in XMP, which stands before the pixels.
_CROPPED, _XMP_BYTES = b'HasCrop="True"', 200_000


def focal_length_px(data: Picture8, kind: str, size: tuple[int, int]) -> float | None:
    """Focal length in pixels of the original; None if it is not stated or not sure.

    Parameters
    ----------
    data : (n,) uint8 array
        The file. Any content is allowed.
    kind : str
        ``ImageHeader.format``.
    size : (int, int)
        Width and height of the original, turned or not.
    """
    tags = exif_fields(data.data, kind)
    long, short = max(size), min(size)
    written = [_value(tags.get(tag)) for tag in (_WIDTH, _HEIGHT)]
    if all(written) and not _alike(max(written) / min(written), long / short):
        return None
    if _value(tags.get(_ZOOM)) > 1 + _SAME:  # cameras differ in what they then state
        return None
    if _CROPPED in bytes(data[:_XMP_BYTES]):
        return None
    film_mm = _value(tags.get(_FOCAL_35))
    if film_mm == 0:
        diagonals = math.hypot(long, short) / long
        film_mm = _by_sensor(tags, max(written)) / diagonals * FILM_DIAGONAL_MM
    return of_film(film_mm, size)


def of_film(film_mm: float, size: tuple[int, int]) -> float | None:
    """Pixels of a focal length that is stated as that of 35 mm film.

    Parameters
    ----------
    film_mm : float
        Focal length on film of 36 x 24 mm with the same angle over the diagonal.
    size : (int, int)
        Width and height of the original, turned or not.

    Returns
    -------
    float or None
        None if no lens is so long or so short, or no camera has pictures of the shape.
    """
    if not any(_alike(max(size) / min(size), shape) for shape in _SHAPES):
        return None
    diagonals = film_mm / FILM_DIAGONAL_MM
    if not _NEAREST <= diagonals <= _FARTHEST:
        return None
    return diagonals * math.hypot(*size)


def _by_sensor(tags: dict[int, Field], width: float) -> float:
    """Focal length in widths of a sensor whose pixels are stated; 0 if unknown."""
    unit = _UNITS_MM.get(int(_value(tags.get(_DENSITY_UNIT))) or 2, 0.0)
    density = _value(tags.get(_DENSITY))  # pixels a unit
    if not density or not width:
        return 0.0
    sensor = width / density * unit
    # A picture that was made smaller may have its new width beside the old density.
    if not any(_alike(sensor, known) for known in _SENSORS_MM):
        return 0.0
    return _value(tags.get(_FOCAL_MM)) / sensor


def _value(field: Field | None) -> float:
    """The number of a tag, 0 if it is missing or no number above 0."""
    try:
        value = 0.0 if field is None else field.quotient()
    except struct.error:
        return 0.0
    return value if math.isfinite(value) and value > 0 else 0.0


def _alike(a: float, b: float) -> bool:
    return abs(a / b - 1) < _SAME
