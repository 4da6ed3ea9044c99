"""Mirroring and symmetrising a surface."""

import numpy as np
import pytest
from bsface.surface.bspline import BSplineSurface
from bsface.surface.symmetry import mirrored, symmetrised


def bumpy(m):
    return BSplineSurface(np.random.default_rng(m).normal(size=(m, 6, 3)) * 20)


@pytest.mark.parametrize("m", [7, 8])
def test_mirror_image_lies_at_the_mirrored_parameter(m):
    surface = bumpy(m)
    u, v = np.random.default_rng(0).uniform(size=(2, 40))
    np.testing.assert_allclose(
        mirrored(surface).evaluate(u, v),
        surface.evaluate(1 - u, v) * (-1, 1, 1),
        atol=1e-12,
    )


@pytest.mark.parametrize("m", [7, 8])
@pytest.mark.parametrize("side", ["both", "left", "right"])
def test_result_is_symmetric_and_stays_so(m, side):
    made = symmetrised(bumpy(m), side)
    np.testing.assert_allclose(
        mirrored(made).control_points, made.control_points, atol=1e-12
    )
    np.testing.assert_allclose(
        symmetrised(made, side).control_points, made.control_points, atol=1e-12
    )


@pytest.mark.parametrize("side, columns", [("left", slice(3)), ("right", slice(-3, 9))])
def test_the_chosen_half_stays(side, columns):
    surface = bumpy(8)
    np.testing.assert_array_equal(
        symmetrised(surface, side).control_points[columns],
        surface.control_points[columns],
    )


def test_amount_blends():
    surface = bumpy(6)
    full = symmetrised(surface).control_points
    np.testing.assert_allclose(
        symmetrised(surface, amount=0.25).control_points,
        0.75 * surface.control_points + 0.25 * full,
    )
    np.testing.assert_array_equal(
        symmetrised(surface, amount=0.0).control_points, surface.control_points
    )


def test_unknown_side_is_refused():
    with pytest.raises(ValueError, match="left"):
        symmetrised(bumpy(6), "top")
