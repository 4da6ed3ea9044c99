"""Comparison of two faces on the same (u, v)."""

import numpy as np
import pytest
from bsface.compare import compare, comparison_picture
from bsface.drawing.render import yaw_rotation
from bsface.surface.alignment import eye_distance
from bsface.surface.bspline import BSplineSurface
from bsface.surface.template import load_template
from fake_face import bare_reconstruction


@pytest.fixture(scope="module")
def template():
    return load_template()


def deformed(template, mode, amount):
    return BSplineSurface(
        template.surface.control_points + amount * template.identity_modes[mode]
    )


def test_a_face_equals_itself_wherever_it_stands(template):
    face = deformed(template, 0, 1.5)
    moved = face.transformed(1.0, yaw_rotation(30, 10), (5.0, -7.0, 100.0))
    found = compare(face, moved, template, size=60)
    assert found.mean < 1e-6 and found.angle_mean < 1e-4
    assert found.similarity == pytest.approx(1.0, abs=1e-6)
    larger = face.transformed(1.1)
    assert compare(face, larger, template, size=60).mean > 0.5
    same = compare(face, larger, template, keep_size=False, size=60)
    assert same.mean < 1e-6
    assert same.alignment.scale == pytest.approx(1 / 1.1)


def test_an_offset_along_the_normals_is_found_with_its_sign(template):
    face = template.surface
    m, n = face.shape
    bump = np.zeros((m, n, 3))
    bump[m // 2 - 2 : m // 2 + 3, 3 * n // 4, 2] = 3.0
    found = compare(face, BSplineSurface(face.control_points + bump), template)
    row, column = np.unravel_index(np.nanargmax(found.offset), found.offset.shape)
    assert abs(column / 160 - 0.5) < 0.08 and abs(row / 160 - 0.75) < 0.08
    assert 0.5 < np.nanmax(found.offset) < 3.0
    assert found.median < 0.05 and found.p95 >= found.median


def test_different_net_sizes_compare(template):
    face = deformed(template, 1, 1.0)
    assert compare(face, face.resampled((70, 66)), template, size=50).mean < 0.2


def test_similarity_tells_the_same_features_from_others(template):
    one, same = deformed(template, 0, 1.0), deformed(template, 0, 2.0)
    other, opposite = deformed(template, 1, 1.5), deformed(template, 0, -1.0)
    value = [compare(one, x, template, size=50).similarity for x in (same, other)]
    assert value[0] > 0.95 and abs(value[1]) < 0.8
    assert compare(one, opposite, template, size=50).similarity < -0.95


def test_statistics_agree_with_the_map(template):
    found = compare(template.surface, deformed(template, 2, 1.0), template)
    inside = np.isfinite(found.offset)
    assert (np.abs(found.offset[inside]) <= found.distance[inside] + 1e-12).all()
    assert found.mean <= found.rms <= np.nanmax(np.abs(found.offset))
    eyes = eye_distance(template.surface, template)
    assert found.mean_pct == pytest.approx(100 * found.mean / eyes)
    assert f"{found.mean:.2f} mm" in found.summary()


def test_picture_shows_inwards_blue_and_outwards_red(template):
    face = template.surface
    found = compare(face, deformed(template, 0, 1.0), template)
    picture = comparison_picture(found, face, template, height=120).astype(int)
    blue = (picture[..., 2] - picture[..., 0] > 25).sum()
    red = (picture[..., 0] - picture[..., 2] > 25).sum()
    assert blue > 100 and red > 100


def test_results_in_place_of_their_surfaces():
    face = bare_reconstruction()
    with pytest.raises(TypeError, match=r"such as face\.surface"):
        compare(face, face)


def test_a_collapsed_surface_is_no_face():
    face = load_template().surface
    flat = BSplineSurface(np.zeros((8, 8, 3)))
    for pair, name in (((flat, face), "first"), ((face, flat), "second")):
        with pytest.raises(ValueError, match=f"{name} is collapsed"):
            compare(*pair, size=16)
