"""What of a photo is skin of the face: painted scenes with a known answer."""

from dataclasses import replace

import numpy as np
import pytest
from bsface.camera.camera import Camera
from bsface.images.photo import Photo
from bsface.photometry.skin import SkinMask, overlay, skin_masks
from bsface.surface.template import load_template
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as nps
from scipy.spatial.transform import Rotation

TEMPLATE = load_template()
SKIN = np.array([0.45, 0.27, 0.19])
HAIR = np.array([0.035, 0.028, 0.025])
SHIRT = np.array([0.08, 0.3, 0.12])
#: Samples well inside the outline of the face on its left side, its right, its middle.
SIDES = np.array([[0.05, 0.35], [0.95, 0.35], [0.5, 0.3]])


def encoded(linear) -> np.ndarray:
    """sRGB curve to 16 bits."""
    c = np.clip(linear, 0, 1)
    high = 1.055 * np.maximum(c, 1e-9) ** (1 / 2.4) - 0.055
    return np.round(65535 * np.where(c <= 0.0031308, 12.92 * c, high)).astype(np.uint16)


def scene(yaw, gain=(1.0, 1.0, 1.0), other=HAIR, light=0.3):
    """A photo of the template, something before the left edge of its face; its camera.

    The skin is shaded from one side; ``gain`` is exposure and white balance.
    """
    size = 240
    R = Rotation.from_euler("y", yaw, degrees=True).as_matrix()
    camera = Camera(R, 1.1, (0, 0), 0.0, ((size - 1) / 2, (size - 1) / 2))
    y, x = np.mgrid[0:size, 0:size]
    shade = 0.7 + light * (x / (size - 1) - 0.5)
    picture = SKIN * shade[..., None]
    edge = camera.project(
        TEMPLATE.surface.evaluate(np.array([0.12]), 0.35 * np.ones(1))
    )
    picture[:, : int(edge[0, 0])] = other
    pixels = encoded(picture * gain)
    return Photo(f"yaw {yaw}", None, (size, size), pixels), camera


def masks_of(scenes) -> tuple[SkinMask, ...]:
    photos, cameras = zip(*scenes, strict=True)
    return skin_masks(photos, TEMPLATE.surface, cameras, TEMPLATE)


def at_sides(scenes) -> np.ndarray:
    """Masks at the left side, the right side and the middle, ``(n, 3)``."""
    points = TEMPLATE.surface.evaluate(*SIDES.T)
    pairs = zip(scenes, masks_of(scenes), strict=True)
    return np.array([mask.read(camera.project(points)) for (_, camera), mask in pairs])


@pytest.mark.parametrize("other", [HAIR, SHIRT], ids=["hair", "shirt"])
def test_what_hangs_over_the_edge_is_not_skin(other):
    found = at_sides([scene(yaw, other=other) for yaw in (0, 4, 8)])
    np.testing.assert_array_less(found[:, 0], 0.02)
    np.testing.assert_array_less(0.98, found[:, 1:])


def test_a_face_without_anything_before_it_is_all_skin():
    found = at_sides([scene(yaw, other=SKIN * 0.55) for yaw in (0, 4, 8)])
    np.testing.assert_array_less(0.98, found)


def test_exposure_and_white_balance_of_a_photo_do_not_matter():
    plain = [scene(4), scene(0), scene(8)]
    changed = [scene(4, (0.5, 0.5, 0.5)), scene(0, (0.9, 1.0, 1.2)), scene(8)]
    np.testing.assert_allclose(at_sides(changed), at_sides(plain), atol=0.02)


def test_a_photo_that_does_not_show_the_face_is_left_alone():
    (photo, camera), *rest = scene(0), scene(4), scene(8)
    away = replace(camera, t=(5000.0, 0.0))
    masks = masks_of([(photo, away), *rest])
    assert masks[0].read(np.array([[0.0, 0.0], [120.0, 80.0]])).tolist() == [1.0, 1.0]


@settings(max_examples=25, deadline=None)
@given(
    nps.arrays(np.float32, (7, 5), elements=st.floats(0, 1, width=32)),
    st.tuples(
        st.floats(-20, 20), st.floats(-20, 20), st.sampled_from([0.25, 0.5, 1.0, 2.0])
    ),
)
def test_a_mask_is_read_where_its_pixels_lie(values, window):
    x0, y0, scale = window
    rows, columns = np.mgrid[0:7, 0:5]
    xy = np.stack([columns, rows], -1).reshape(-1, 2)
    xy = (xy + 0.5) / scale - 0.5 + (x0, y0)
    found = SkinMask(values, window).read(xy)
    np.testing.assert_allclose(found, values.ravel(), atol=1e-4)


def test_the_overlay_leaves_skin_as_it_is():
    photo, _ = scene(0)
    window = photo.window
    skin, other = np.ones((1, 1), np.float32), np.zeros((1, 1), np.float32)
    np.testing.assert_array_equal(
        overlay(photo, SkinMask(skin, window)), photo.bytes8()
    )
    tinted = overlay(photo, SkinMask(other, window)).astype(int)
    assert (tinted[..., 0] - tinted[..., 1] > 60).all()
