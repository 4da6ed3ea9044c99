"""Brightness curves of high dynamic range: stored value to light (ITU-R BT.2100-2).

Light is relative to the reference white of 203 cd/m2 (ITU-R BT.2408-7, table 1), which
becomes the white of an sRGB picture; highlights above it are lost, as in any other
photo. HLG stores the light of the scene, PQ that of the screen.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .._types import Array, Array32

REFERENCE_WHITE = 203.0  # cd/m2
# The screen that HLG is meant for, and the exponent by which it shows the scene.
_HLG_PEAK, _HLG_GAMMA = 1000.0, 1.2
# BT.2100-2, table 5.
_A = 0.17883277
_B = 1 - 4 * _A
_C = 0.5 - _A * np.log(4 * _A)
# BT.2100-2, table 4.
_M1, _M2 = 2610 / 16384, 2523 / 4096 * 128
_C1, _C2, _C3 = 3424 / 4096, 2413 / 4096 * 32, 2392 / 4096 * 32
_PQ_PEAK = 10000.0
# Weights of red, green and blue of BT.709 in luminance (BT.709-6, item 3.2).
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)


def hlg_light(stored: npt.ArrayLike) -> Array:
    """Scene light of HLG values in [0, 1]; 1 at the reference white, 0.75 stored."""
    e = np.asarray(stored, float)
    high = (np.exp((np.maximum(e, 0.5) - _C) / _A) + _B) / 12
    return np.where(e <= 0.5, e * e / 3, high) / _WHITE_OF_SCENE


def pq_light(stored: npt.ArrayLike) -> Array:
    """Screen light of PQ values in [0, 1]; 1 at the reference white, 0.58 stored."""
    p = np.asarray(stored, float) ** (1 / _M2)
    linear = (np.maximum(p - _C1, 0) / (_C2 - _C3 * p)) ** (1 / _M1)
    return linear * _PQ_PEAK / REFERENCE_WHITE


def hlg_scene(screen: Array32) -> Array32:
    """Scene light (..., 3) from what a screen of 1000 cd/m2 shows of HLG.

    Both relative to the reference white, in the primaries of BT.709 (BT.2100-2,
    table 5: inverse OOTF).
    """
    luminance = np.maximum(screen @ _LUMINANCE, np.float32(1e-6))
    return screen * luminance[..., None] ** np.float32(1 / _HLG_GAMMA - 1)


_WHITE_OF_SCENE = (REFERENCE_WHITE / _HLG_PEAK) ** (1 / _HLG_GAMMA)
