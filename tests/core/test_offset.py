"""Offset surfaces: exact where a formula knows them, in tolerance, refused in folds."""

import numpy as np
import pytest
from bsface.surface.bspline import BSplineSurface
from bsface.surface.offset import offset, offset_limit, principal_curvatures
from bsface.surface.template import load_template
from hypothesis import given, settings
from hypothesis import strategies as st


def fitted(points, shape=(24, 26)):
    """Spline through a formula ``points(u, v)``, by least squares."""
    from bsface.surface.bspline import basis_matrix, grid_parameters

    u, v = grid_parameters(90, 90)
    matrix = basis_matrix(shape, u, v).toarray()
    net = np.linalg.lstsq(matrix, points(u, v), rcond=None)[0]
    return BSplineSurface(net.reshape(*shape, 3))


def ball(radius, reach=0.5, shape=(24, 26)):
    """A piece of a sphere that bulges towards +z."""

    def points(u, v):
        x, y = (2 * u - 1) * reach, (1 - 2 * v) * reach
        return radius * np.stack(
            [np.sin(x), np.cos(x) * np.sin(y), np.cos(x) * np.cos(y)], -1
        )

    return fitted(points, shape)


@given(st.floats(-30, 30).filter(lambda d: abs(d) > 0.01))
@settings(max_examples=8, deadline=None)
def test_offset_of_a_plane_is_the_plane_moved(distance):
    u, v = np.meshgrid((np.arange(7) - 1) / 4, (np.arange(8) - 1) / 5, indexing="ij")
    plane = BSplineSurface(np.stack([50 * u, -60 * v, 20 * u], -1))
    normal = plane.normals(0.5, 0.5)
    np.testing.assert_allclose(
        offset(plane, distance).control_points,
        plane.control_points + distance * normal,
        atol=1e-9,
    )


@pytest.mark.parametrize("distance", [-20.0, 4.0])
def test_offset_of_a_sphere_is_a_sphere(distance):
    radius = 60.0
    made = offset(ball(radius), distance)
    u, v = np.random.default_rng(1).uniform(size=(2, 500))
    off = np.linalg.norm(made.evaluate(u, v), axis=1) - (radius + distance)
    assert np.abs(off).max() < 0.05


def test_curvatures_of_a_sphere_and_of_a_bowl():
    u = np.linspace(0.1, 0.9, 5)
    round_ = ball(50.0)
    for k in principal_curvatures(round_, u, u):
        np.testing.assert_allclose(k, -1 / 50, rtol=1e-2)
    bowl = BSplineSurface(round_.control_points * (1, 1, -1))
    for k in principal_curvatures(bowl, u, u):
        np.testing.assert_allclose(k, 1 / 50, rtol=1e-2)
    assert offset_limit(round_) == np.inf
    assert offset_limit(round_, outwards=False) == pytest.approx(50, rel=0.05)


@pytest.mark.parametrize("distance", [-2.0, 0.5])
def test_offset_of_a_face_keeps_its_distance_everywhere(distance):
    """Measured by closest points, not at equal parameters."""
    template = load_template()
    made = offset(template.surface, distance, outline_uv=template.outline_uv)
    uv = np.random.default_rng(2).uniform(0.03, 0.97, (600, 2))
    uv = uv[template.inside(uv)]
    off = template.surface.signed_distance(made.evaluate(*uv.T))
    # Samples next to the outline may have their closest point beside it.
    assert np.abs(off - distance).max() < 0.05
    assert (made.shape[0] - 3) % (template.surface.shape[0] - 3) == 0


def test_offset_that_folds_is_refused_with_the_limit():
    template = load_template()
    surface, outline = template.surface, template.outline_uv
    limit = offset_limit(surface, outline)
    assert 2 < limit < 8
    with pytest.raises(ValueError, match=f"hollow .* {limit:.2f} mm"):
        offset(surface, limit + 0.1, outline_uv=outline)
    with pytest.raises(ValueError, match="round"):
        offset(surface, -30.0, outline_uv=outline)
    forehead = [[0.3, 0.03], [0.7, 0.03], [0.7, 0.13], [0.3, 0.13]]
    assert offset_limit(surface, forehead) > 5 * limit


def test_zero_is_the_surface_itself_and_nonsense_is_refused():
    surface = load_template().surface
    assert offset(surface, 0.0) is surface
    for distance, tolerance in ((np.nan, 0.05), (1.0, 0.0)):
        with pytest.raises(ValueError, match="tolerance positive"):
            offset(surface, distance, tolerance=tolerance)
    with pytest.raises(ValueError, match="finest net"):
        offset(ball(60.0, shape=(8, 9)), 20.0, tolerance=1e-12)


@pytest.mark.parametrize(
    "wrong, words",
    [
        ({"outline_uv": []}, "outline_uv must be"),
        ({"outline_uv": [[0.5, 0.5]] * 2}, "outline_uv must be"),
        ({"outline_uv": np.full((5, 2), np.nan)}, "outline_uv must be"),
        ({"outline_uv": np.full((5, 2), 0.123)}, "encloses too little"),
        ({"distance": "1"}, "distance must be a number"),
        ({"tolerance": True}, "tolerance must be a number"),
        ({"surface": 1}, "surface must be a BSplineSurface"),
    ],
)
def test_wrong_kinds_are_named(wrong, words):
    good = {"surface": load_template().surface.resampled((8, 9)), "distance": 0.5}
    with pytest.raises((TypeError, ValueError), match=words):
        offset(**{**good, **wrong})
