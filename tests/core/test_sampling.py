"""Reading photos at surface points: values, slopes, and what is hidden."""

import numpy as np
import pytest
from bsface.camera.camera import Camera
from bsface.images.photo import Photo
from bsface.photometry.sampling import (
    DEPTH_MARGIN,
    IntensityField,
    occluded,
    smooth_photo,
    view_weights,
)
from bsface.surface.bspline import BSplineSurface, grid_parameters
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

FRONT = Camera(np.eye(3), 2.0, (0, 0), 0.0, (100, 100))


def encoded(linear) -> np.ndarray:
    """sRGB curve to 16 bits."""
    c = np.asarray(linear, float)
    high = 1.055 * np.maximum(c, 1e-9) ** (1 / 2.4) - 0.055
    return np.round(65535 * np.where(c <= 0.0031308, 12.92 * c, high)).astype(np.uint16)


def ramp_photo(width, height, window, slopes=(0.0006, -0.0004)) -> Photo:
    """Linear intensity ``0.5 + slopes . (xy - middle)`` of the original's pixels."""
    photo = Photo("ramp", None, (4000, 3000), np.zeros((height, width, 3), np.uint16))
    photo = Photo("ramp", None, (4000, 3000), photo.pixels, window)
    y, x = np.mgrid[0:height, 0:width]
    xy = photo.to_original(np.stack([x, y], -1))
    value = 0.5 + (xy - xy.mean((0, 1))) @ slopes
    assert value.min() > 0 and value.max() < 1
    pixels = encoded(np.repeat(value[..., None], 3, 2))
    return Photo("ramp", None, (4000, 3000), pixels, window)


@pytest.mark.parametrize("window", [(0, 0, 1.0), (37.0, 12.5, 0.5), (11.25, 80.0, 2.0)])
@pytest.mark.parametrize("blur", [0.05, 2.0, 9.0])
def test_a_ramp_is_read_exactly(window, blur):
    """Value and slope of a linear picture, whatever the cut-out, scale and blur."""
    slopes = np.array([0.0006, -0.0004])
    photo = ramp_photo(401, 367, window)
    field = smooth_photo(photo, FRONT, blur)
    rng = np.random.default_rng(0)
    sigma = blur * FRONT.s * window[2]
    edge = 3.5 * sigma + 4  # in pixels of the cut-out
    inner = rng.uniform((edge, edge), (400 - edge, 366 - edge), (40, 2))
    xy = photo.to_original(inner)
    value, gradient, inside = field.read(xy)
    middle = photo.to_original(np.array([200.0, 183.0]))
    assert inside.all()
    np.testing.assert_allclose(value[:, 0], 0.5 + (xy - middle) @ slopes, atol=3e-4)
    np.testing.assert_allclose(gradient[:, 0], np.tile(slopes, (len(xy), 1)), atol=2e-5)


def test_three_channels_on_demand():
    photo = ramp_photo(60, 60, (0, 0, 1.0))
    pixels = photo.pixels.copy()
    pixels[..., 1] = 0
    field = smooth_photo(Photo("x", None, (60, 60), pixels), FRONT, 0.05, colour=True)
    value, gradient, _ = field.read(np.array([[30.0, 30.0]]))
    assert value.shape == (1, 3)
    assert gradient.shape == (1, 3, 2)
    np.testing.assert_allclose(value[0, 1], 0)
    np.testing.assert_allclose(value[0, 0], value[0, 2])


def test_blur_is_given_in_millimetres():
    """The edge of a step is as wide as the Gaussian says, at any resolution."""
    from scipy.special import erf

    for scale in (1.0, 3.0):
        side = int(240 * scale)
        step = np.zeros((side, side, 3))
        step[:, side // 2 :] = 0.8
        window = (0.0, 0.0, scale)
        photo = Photo("step", None, (240, 240), encoded(step), window)
        field = smooth_photo(photo, FRONT, 6.0)  # 12 pixels of the original
        xy = np.stack([np.linspace(90, 150, 21), np.full(21, 120.0)], 1)
        value, gradient, _ = field.read(xy)
        z = (xy[:, 0] - 119.5) / 12
        np.testing.assert_allclose(
            value[:, 0], 0.4 * (1 + erf(z / np.sqrt(2))), atol=0.008
        )
        slope = 0.8 / 12 / np.sqrt(2 * np.pi) * np.exp(-z * z / 2)
        # central differences flatten the peak by a tenth
        np.testing.assert_allclose(gradient[:, 0, 0], slope, atol=0.12 * slope.max())
        np.testing.assert_allclose(gradient[:, 0, 1], 0, atol=1e-6)


def test_outside_the_picture_is_told():
    field = smooth_photo(ramp_photo(60, 40, (100.0, 200.0, 1.0)), FRONT, 0.05)
    xy = np.array([[130, 220], [99, 220], [130, 241], [-1e9, 1e9], [130, 199.9]])
    value, gradient, inside = field.read(xy)
    assert inside.tolist() == [True, False, False, False, False]
    assert np.isfinite(value).all()
    assert np.isfinite(gradient).all()


def test_places_that_are_no_numbers_are_outside():
    field = smooth_photo(ramp_photo(60, 40, (0, 0, 1.0)), FRONT, 0.05)
    _, _, inside = field.read(np.array([[np.nan, 3.0], [np.inf, 3.0]]))
    assert not inside.any()


def test_a_part_of_a_field_reads_the_same():
    photo = ramp_photo(60, 40, (10.0, 20.0, 0.5))
    field = smooth_photo(photo, FRONT, 2.0)
    xy = photo.to_original(np.array([[30.0, 20.0], [36.0, 25.0], [33.3, 22.2]]))
    part = field.around(xy, 6.0)
    assert part.maps.size < field.maps.size / 4
    for found, expected in zip(part.read(xy), field.read(xy), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-9)
    *_, inside = part.read(photo.to_original(np.array([[5.0, 5.0]])))
    assert not inside.any()


def test_a_part_beyond_the_picture_is_empty_of_places():
    field = smooth_photo(ramp_photo(60, 40, (0, 0, 1.0)), FRONT, 2.0)
    far = np.array([[500.0, -300.0], [520.0, -310.0]])
    *_, inside = field.around(far, 6.0).read(far)
    assert not inside.any()


def test_many_points_and_channels():
    maps = np.arange(6 * 8 * 5, dtype=np.float32).reshape(6, 8, 5)
    field = IntensityField(maps, (0, 0, 1.0))
    xy = np.tile([[3.0, 2.0]], (40_000, 1))
    value, _, inside = field.read(xy)
    assert inside.all()
    np.testing.assert_allclose(value, np.tile(maps[2, 3], (40_000, 1)))


# --- what a photo sees ---------------------------------------------------------------


def relief(height=40.0, width=16.0, shape=(24, 24)):
    """A plate of 200 x 200 mm with a round bump in its middle."""
    u = (np.arange(shape[0]) - 1) / (shape[0] - 3)
    u, v = np.meshgrid(u, u, indexing="ij")
    x, y = 200 * (u - 0.5), 200 * (0.5 - v)
    z = height * np.exp(-(x * x + y * y) / (2 * width**2))
    return BSplineSurface(np.stack([x, y, z], -1))


def occlusion(surface, camera, points):
    """Which points the surface itself hides from a camera."""
    return occluded(surface.grid(161, 161).reshape(-1, 3), camera, points)


def elevation(surface, xy):
    """z of the relief above (x, y); its x and y are those of the parameters."""
    u, v = xy[..., 0] / 200 + 0.5, 0.5 - xy[..., 1] / 200
    inside = (np.abs(xy) < 100).all(-1)
    z = surface.evaluate(np.clip(u, 0, 1), np.clip(v, 0, 1))[..., 2]
    return np.where(inside, z, -np.inf)


@pytest.mark.parametrize("kappa", [0.0, 1 / 600])
@pytest.mark.parametrize("angles", [(60, 0), (-60, 0), (0, 55), (40, 40)])
def test_hidden_points_are_those_behind_the_bump(kappa, angles):
    """Against marching along each ray above the relief."""
    surface = relief()
    R = Rotation.from_euler("yx", angles, degrees=True).as_matrix()
    camera = Camera(R, 2.0, (0, 0), kappa, (300, 300))
    points = surface.evaluate(*np.random.default_rng(0).uniform(0.02, 0.98, (2, 3000)))
    ray = camera.toward(points)
    way = np.arange(1.0, 130.0)
    path = points[:, None] + way[:, None] * ray[:, None]
    above = path[..., 2] - elevation(surface, path[..., :2])
    hidden = (above < -1.0).any(1)
    clear = (above > 1.0)[:, 3:].all(1)
    found = occlusion(surface, camera, points)
    assert hidden.sum() > 50
    assert (found & clear).mean() < 0.005
    # what hides by less than the margin of depth is let through
    deep = (np.where(above < -1.0, way, 0)).max(1) > 2 * DEPTH_MARGIN
    assert found[hidden & deep].mean() > 0.92


def test_nothing_is_hidden_from_the_front():
    surface = relief()
    points = surface.evaluate(*grid_parameters(50, 50))
    assert not occlusion(surface, FRONT, points).any()


@given(s=st.floats(0.1, 20), x=st.floats(-1e4, 1e4))
@settings(max_examples=20)
def test_visibility_does_not_depend_on_pixels(s, x):
    """The same pose at another resolution sees the same, but for the cell's phase."""
    surface = relief(shape=(12, 12))
    cover = surface.grid(80, 80).reshape(-1, 3)
    R = Rotation.from_euler("y", 60, degrees=True).as_matrix()
    points = surface.evaluate(*np.random.default_rng(1).random((2, 400)))
    one = occluded(cover, Camera(R, 1.0, (0, 0)), points)
    other = occluded(cover, Camera(R, s, (x, -x)), points)
    assert (one != other).mean() < 0.05


def test_weight_is_the_cosine_where_it_is_seen():
    surface = relief(height=0.0)
    uv = np.random.default_rng(2).uniform(0.1, 0.9, (50, 2))
    turns = [0, 30, 60, 85, 120]
    cameras = [
        Camera(Rotation.from_euler("y", a, degrees=True).as_matrix(), 2.0, (0, 0))
        for a in turns
    ]
    weights = view_weights(surface, cameras, uv, grazing=0.25)
    cosine = np.cos(np.radians(turns))
    expected = np.where(cosine > 0.25, cosine, 0)
    np.testing.assert_allclose(weights, np.tile(expected[:, None], (1, 50)), atol=1e-12)


def test_hidden_points_weigh_nothing():
    surface = relief()
    R = Rotation.from_euler("y", 60, degrees=True).as_matrix()
    uv = np.random.default_rng(3).random((500, 2))
    camera = Camera(R, 2.0, (0, 0))
    (weights,) = view_weights(surface, [camera], uv)
    hidden = occlusion(surface, camera, surface.evaluate(*uv.T))
    assert hidden.any()
    assert (weights[hidden] == 0).all()
    assert (weights[~hidden] > 0).mean() > 0.7
