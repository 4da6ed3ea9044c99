"""What of a photo is skin of the face: painted scenes with a known answer."""

from dataclasses import replace

import numpy as np
import pytest
from bsface.photometry.skin import SkinMask, overlay
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as nps
from skin_scenes import HAIR, SHIRT, SKIN, at_sides, masks_of, scene


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
