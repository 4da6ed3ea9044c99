"""ICC profiles of the kind that cameras and screens have: three curves and a matrix.

Read are RGB profiles with the tags ``rXYZ``, ``rTRC``... and grey ones with ``kTRC``
(ICC.1:2022, 8.3.3, 8.4.2), which covers sRGB, Display P3, Adobe RGB, ProPhoto and what
scanners' calibrations write. Profiles of tables (``A2B0`` alone) and of inks are not.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from .._types import Array

# Linear sRGB to XYZ under D50, the profile connection space (IEC 61966-2-1, adapted
# from D65 by Bradford's transform as ICC.1 Annex E asks).
SRGB_TO_XYZ = np.array(
    [
        [0.4360747, 0.3850649, 0.1430804],
        [0.2225045, 0.7168786, 0.0606169],
        [0.0139322, 0.0971045, 0.7141733],
    ]
)
_MOST_TAGS = 200
_MOST_SAMPLES = 65536


class ProfileError(ValueError):
    """A colour profile that cannot be used; the message says why, as a clause."""


@dataclass(frozen=True, eq=False)
class Curve:
    """Stored value in [0, 1] to linear value in [0, 1].

    Parameters
    ----------
    samples : (n,) array
        Values at equal steps, n = 0 or more than 1; of a formula, none.
    parameters : (7,) array
        ``g, a, b, c, d, e, f`` of ``(a x + b)^g + e`` from ``d`` on and ``c x + f``
        below (ICC.1 10.18, type 4); used where there are no samples.
    """

    samples: Array
    parameters: Array

    def __call__(self, x: Array) -> Array:
        if len(self.samples):
            grid = np.linspace(0, 1, len(self.samples))
            return np.interp(x, grid, self.samples)
        g, a, b, c, d, e, f = self.parameters
        upper = np.maximum(a * x + b, 0) ** g + e
        return np.clip(np.where(x >= d, upper, c * x + f), 0, 1)


@dataclass(frozen=True, eq=False)
class RgbProfile:
    """From stored to linear sRGB values.

    Parameters
    ----------
    curves : (3,) tuple of Curve
        Of red, green and blue.
    matrix : (3, 3) array
        Takes the linear values to linear sRGB.
    """

    curves: tuple[Curve, ...]
    matrix: Array

    def linear_srgb(self, rgb: Array) -> Array:
        """(..., 3) stored values in [0, 1] to linear sRGB, which may leave [0, 1]."""
        linear = [curve(rgb[..., c]) for c, curve in enumerate(self.curves)]
        return np.stack(linear, axis=-1) @ self.matrix.T


SRGB_CURVE = Curve(
    np.empty(0), np.array([2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045, 0, 0])
)


def read_profile(data: bytes) -> RgbProfile:
    """The profile in the bytes of an ICC file.

    Raises
    ------
    ProfileError
        It is damaged or of another kind.
    """
    if len(data) < 132 or data[36:40] != b"acsp":
        raise ProfileError("its colour profile is damaged")
    kind = data[16:20]
    if kind not in (b"RGB ", b"GRAY"):
        raise ProfileError("its colour profile is not one of RGB")
    try:
        tags = _tags(data)
        if kind == b"GRAY":
            curve = _curve(tags[b"kTRC"])
            return RgbProfile((curve, curve, curve), np.eye(3))
        red, green, blue = (_curve(tags[c + b"TRC"]) for c in (b"r", b"g", b"b"))
        to_xyz = np.stack([_xyz(tags[c + b"XYZ"]) for c in (b"r", b"g", b"b")], 1)
    except KeyError:
        raise ProfileError("its colour profile is made of tables") from None
    except (struct.error, IndexError):
        raise ProfileError("its colour profile is damaged") from None
    matrix = np.linalg.solve(SRGB_TO_XYZ, to_xyz)
    # The columns of a true profile add up to white, so that grey stays grey.
    if not 0.5 < float(np.linalg.norm(matrix @ np.ones(3))) / 3**0.5 < 1.5:
        raise ProfileError("its colour profile is damaged")
    return RgbProfile((red, green, blue), matrix)


def _tags(data: bytes) -> dict[bytes, bytes]:
    (count,) = struct.unpack_from(">I", data, 128)
    found = {}
    for i in range(min(count, _MOST_TAGS)):
        name, at, size = struct.unpack_from(">4sII", data, 132 + 12 * i)
        found[name] = data[at : at + size]
    return found


def _xyz(tag: bytes) -> Array:
    if tag[:4] != b"XYZ ":
        raise ProfileError("its colour profile is damaged")
    return np.array(struct.unpack_from(">3i", tag, 8)) / 65536


def _curve(tag: bytes) -> Curve:
    none = np.empty(0)
    kind = tag[:4]
    if kind == b"curv":
        (count,) = struct.unpack_from(">I", tag, 8)
        if count == 0:
            return Curve(none, _parameters(1.0))
        if count == 1:
            return Curve(none, _parameters(struct.unpack_from(">H", tag, 12)[0] / 256))
        if count > _MOST_SAMPLES or len(tag) < 12 + 2 * count:
            raise ProfileError("its colour profile is damaged")
        samples = np.frombuffer(tag, ">u2", count, 12)
        return Curve(samples / 65535, none)
    if kind == b"para":
        (form,) = struct.unpack_from(">H", tag, 8)
        if form > 4:
            raise ProfileError("its colour profile has an unknown kind of curve")
        numbers = struct.unpack_from(f">{(1, 3, 4, 5, 7)[form]}i", tag, 12)
        return Curve(none, _parameters(*(n / 65536 for n in numbers)))
    raise ProfileError("its colour profile has an unknown kind of curve")


def _parameters(g: float, *rest: float) -> Array:
    """The seven numbers of type 4 for the shorter forms 0 to 3 (ICC.1 table 68)."""
    if not 0 < g < 20:
        raise ProfileError("its colour profile is damaged")
    a, b, c, d, e, f = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if len(rest) == 2:
        a, b = rest
        d = -b / a if a else 0.0
    elif len(rest) == 3:
        a, b, e = rest
        d, f = (-b / a if a else 0.0), e
    elif len(rest) == 4:
        a, b, c, d = rest
    elif len(rest) == 6:
        a, b, c, d, e, f = rest
    return np.array([g, a, b, c, d, e, f])
