"""Reading between pixels: against the formula, at borders, in any shape."""

import numpy as np
import pytest
from bsface.images.remap import interpolate, read_between

RNG = np.random.default_rng(4)


def bilinear(picture, x, y):
    """The textbook formula at one place inside the picture."""
    i, j = int(np.floor(y)), int(np.floor(x))
    f, g = y - i, x - j
    i1, j1 = min(i + 1, len(picture) - 1), min(j + 1, picture.shape[1] - 1)
    upper = (1 - g) * picture[i, j] + g * picture[i, j1]
    lower = (1 - g) * picture[i1, j] + g * picture[i1, j1]
    return (1 - f) * upper + f * lower


@pytest.mark.parametrize("channels", [(), (1,), (3,), (7,)])
def test_values_are_those_of_the_formula(channels):
    """Exactly, at multiples of 1/32 in an eight-bit picture; any number of channels."""
    picture = RNG.integers(0, 256, (20, 30, *channels)).astype(np.float32)
    xy = RNG.integers(0, 32 * 19, (5, 300, 2)) / 32
    found = read_between(picture, xy)
    assert found.shape == (5, 300, *channels)
    for place, value in zip(xy.reshape(-1, 2), found.reshape(1500, -1), strict=True):
        np.testing.assert_array_equal(value, np.ravel(bilinear(picture, *place)))


def test_other_places_are_rounded_to_the_nearest_step():
    picture = np.tile(np.arange(50, dtype=np.float32), (40, 1))
    x = RNG.uniform(0, 49, 2000)
    found = read_between(picture, np.stack([x, np.full(2000, 7.3)], 1))
    np.testing.assert_array_equal(found, np.rint(32 * x) / 32)


@pytest.mark.parametrize("channels", [(), (1,), (5,)])
def test_interpolation_is_that_of_the_formula_at_any_place(channels):
    picture = RNG.random((20, 30, *channels)).astype(np.float32)
    xy = RNG.uniform(0, 19, (4, 100, 2))
    found = interpolate(picture, xy)
    assert found.shape == (4, 100, *channels)
    for place, value in zip(xy.reshape(-1, 2), found.reshape(400, -1), strict=True):
        np.testing.assert_allclose(
            value, np.ravel(bilinear(picture.astype(float), *place)), 1e-12
        )


def test_interpolation_has_no_steps():
    """A place that moves by 1e-9 pixels changes the value by as little."""
    picture = RNG.random((20, 30)).astype(np.float32)
    xy = RNG.uniform(1, 18, (5000, 2))
    change = interpolate(picture, xy + 1e-9) - interpolate(picture, xy)
    assert np.abs(change).max() < 1e-8


OUTSIDE = np.array([[-3.0, 2.0], [20.0, 2.0], [3.0, -4.0], [3.0, 60.0]])


def test_outside_the_picture():
    picture = np.full((6, 8), 5.0, np.float32)
    assert (interpolate(picture, OUTSIDE) == 5).all()
    assert (read_between(picture, OUTSIDE) == 0).all()
    assert read_between(picture, np.array([[-0.5, 2.0]])) == 2.5
    for read in (interpolate, read_between):
        assert read(picture, np.zeros((0, 2))).shape == (0,)
