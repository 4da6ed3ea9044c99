"""The software renderer: z-buffer against geometry, views, colour maps."""

import cv2
import numpy as np
import pytest
from bsface.drawing import pictures, render
from bsface.drawing.rasterize import rasterize
from bsface.drawing.surface_grid import sample_surface
from bsface.surface.bspline import grid_triangles
from fake_face import face_surface, face_template


def test_triangle_covers_the_pixels_inside_it_and_interpolates():
    xy = np.array([[0.0, 0.0], [8.0, 0.0], [0.0, 8.0]])
    depth = xy[:, 0] + 2 * xy[:, 1] + 3
    raster = rasterize(xy, depth, np.array([[0, 1, 2]]), (10, 10))
    rows, columns = np.mgrid[:10, :10]
    assert np.array_equal(raster.covered, rows + columns <= 8)
    seen = raster.covered
    np.testing.assert_allclose(
        raster.depth[seen], columns[seen] + 2 * rows[seen] + 3, atol=1e-12
    )
    np.testing.assert_allclose(
        raster.interpolate(xy, np.array([[0, 1, 2]])),
        np.stack([columns[seen], rows[seen]], axis=1),
        atol=1e-12,
    )


@pytest.mark.parametrize("size", [3.0, 40.0, 300.0])
def test_nearer_triangle_wins_whatever_the_order_and_the_size(size):
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * size
    xy = np.concatenate([square, square])
    near = np.array([[0, 1, 2], [0, 2, 3]])
    far = near + 4
    depth = np.repeat([1.0, -1.0], 4)
    for order in (np.concatenate([near, far]), np.concatenate([far, near])):
        raster = rasterize(xy, depth, order, (301, 301))
        assert raster.covered.sum() == (size + 1) ** 2
        assert (raster.depth[raster.covered] > 0.999).all()


def test_neighbouring_triangles_leave_no_crack():
    rng = np.random.default_rng(0)
    xy, triangles = _jittered_grid(rng, 25, 120)
    raster = rasterize(xy, np.zeros(len(xy)), triangles, (120, 120))
    assert raster.covered[3:-3, 3:-3].all()


def _jittered_grid(rng, count, size):
    x, y = np.meshgrid(np.linspace(0, size, count), np.linspace(0, size, count))
    xy = np.stack([x.T.ravel(), y.T.ravel()], axis=1)
    xy += rng.uniform(-1.5, 1.5, xy.shape)
    return xy, grid_triangles(count, count)


def test_triangles_out_of_the_picture_and_not_finite_are_left_out():
    xy = np.array([[-50.0, -50], [-40, -50], [-50, -40], [np.nan, 0], [5, 5], [9, 5]])
    raster = rasterize(xy, np.zeros(6), np.array([[0, 1, 2], [3, 4, 5]]), (20, 20))
    assert not raster.covered.any()


def test_front_view_shows_the_outline_at_its_place():
    surface, template = face_surface(), face_template()
    grid = sample_surface(surface, template, 120)
    picture = render.shaded_view(
        grid, size=(200, 240), mm_per_pixel=1.0, centre=(0, 0, 0), background=(0, 0, 0)
    )
    drawn = picture.any(axis=2)
    boundary = surface.evaluate(*template.outline_uv.T)
    polygon = boundary[:, :2] * (1, -1) + (99.5, 119.5)
    expected = np.zeros((240, 200), np.uint8)
    cv2.fillPoly(expected, [np.round(polygon).astype(np.int32)], 1)
    differing = (drawn != expected.astype(bool)).sum()
    assert differing < 0.02 * expected.sum()


def test_positive_yaw_turns_the_nose_to_the_right():
    nose = render.yaw_rotation(40.0) @ (0, 0, 1)
    assert nose[0] > 0 and nose[2] > 0
    assert (render.yaw_rotation(0, 20) @ (0, 0, 1))[1] < 0


def test_texture_is_drawn_where_its_parameters_are():
    surface = face_surface()
    texture = np.zeros((64, 64, 3), np.uint8)
    texture[:32, :32] = (255, 0, 0)  # v < 0.5, u < 0.5: top left
    grid = sample_surface(surface, None, 80)
    picture = render.shaded_view(grid, size=(100, 120), colours=texture, shading=0.0)
    red = (picture[..., 0] > 200) & (picture[..., 1] < 60)
    rows, columns = np.nonzero(red)
    assert rows.max() < 62 and columns.max() < 52 and red.sum() > 2000


def test_views_side_by_side_share_one_scale():
    picture = render.render_views(face_surface(), face_template(), height=150)
    assert picture.dtype == np.uint8 and picture.shape[0] == 150
    assert (picture != 255).any(axis=2).mean() > 0.4
    with pytest.raises(ValueError, match="view must be one of"):
        render.view_rotation("from above")


def test_colour_map_ends_middle_and_missing_values():
    values = np.array([-1.0, 0.0, 1.0, np.nan])
    colours = pictures.colour_map(values, -1, 1, "diverging").astype(int)
    assert colours[0, 2] > colours[0, 0] and colours[2, 0] > colours[2, 2]
    assert np.ptp(colours[1]) < 6 and np.ptp(colours[3]) == 0
    assert pictures.colour_map(np.full(3, np.nan)).shape == (3, 3)
    with pytest.raises(ValueError, match="colour map must be one of"):
        pictures.colour_map(values, name="jet")


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_png_round_trip(tmp_path, dtype):
    rng = np.random.default_rng(1)
    image = rng.integers(0, np.iinfo(dtype).max, (7, 9, 3)).astype(dtype)
    path = pictures.write_png(tmp_path / "new" / "a.png", image)
    back = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., ::-1]
    assert np.array_equal(back, image) and len(list(path.parent.iterdir())) == 1
