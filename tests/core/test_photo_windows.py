"""Linear light and windows of a photo that was read."""

import numpy as np
import pytest
from bsface.images.photo import Photo, cut
from hypothesis import given, settings
from hypothesis import strategies as st


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_linear_undoes_the_srgb_curve(dtype):
    top = np.iinfo(dtype).max
    values = np.array([0, 0.02, 0.5, 1])
    pixels = np.broadcast_to(np.round(values * top)[None, :, None], (1, 4, 3))
    light = Photo("p", None, (4, 1), pixels.astype(dtype)).linear()
    assert light.dtype == np.float32
    np.testing.assert_allclose(
        light[0, :, 0], [0, 0.02 / 12.92, 0.21404, 1], atol=2 / top
    )


@given(
    x0=st.floats(-50, 200),
    y0=st.floats(-50, 200),
    side=st.floats(1, 300),
    max_side=st.integers(8, 200),
)
@settings(max_examples=100, deadline=None)
def test_cut_keeps_coordinates(x0, y0, side, max_side):
    """A linear ramp read through the window is the original's coordinate."""
    y, x = np.mgrid[:160, :200]
    ramp = np.stack([x * 300, y * 300, 0 * x], axis=-1).astype(np.uint16)
    photo = Photo("p", None, (200, 160), ramp)
    part = cut(photo, (x0, y0, x0 + side, y0 + side), max_side)
    h, w = part.pixels.shape[:2]
    # A strip one pixel high is not made shorter.
    assert 1 <= max(h, w) <= max_side or min(h, w) == 1
    yy, xx = np.mgrid[:h, :w]
    xy = part.to_original(np.stack([xx, yy], axis=-1))
    # The last row and column may be a part of a pixel wide.
    inner = np.s_[: max(h - 1, 1), : max(w - 1, 1)]
    # Averages over areas see the pixels as steps: up to 1/8 pixel beside the ramp.
    tolerance = 0.13 + 0.5 / part.window[2] * (min(h, w) == 1)
    error = np.abs(part.pixels[..., :2] / 300 - xy)
    assert error[inner].max() <= tolerance
    np.testing.assert_allclose(part.to_window(xy), np.stack([xx, yy], -1), atol=1e-9)


def test_cut_of_a_cut_is_the_cut():
    image = np.random.default_rng(1).integers(0, 255, (90, 120, 3), np.uint8)
    photo = Photo("p", None, (120, 90), image)
    once = cut(photo, (30, 20, 70, 60))
    twice = cut(cut(photo, (10, 10, 100, 80)), (30, 20, 70, 60))
    np.testing.assert_array_equal(once.pixels, twice.pixels)
    assert once.window == twice.window
    assert not np.shares_memory(once.pixels, image)
