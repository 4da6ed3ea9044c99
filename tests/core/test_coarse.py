"""The coarse net: exact where the knots nest, local, and the identity at rest."""

import numpy as np
import pytest
from bsface.surface.bspline import BSplineSurface, segment_basis
from bsface.surface.coarse import (
    apply_coarse,
    coarse_net,
    mirrored_edit,
    prolongation,
    prolonged,
)
from bsface.surface.template import load_template
from hypothesis import given, settings
from hypothesis import strategies as st


def dense_basis(count, x):
    first, value = segment_basis(count, x)
    dense = np.zeros((len(x), count))
    np.put_along_axis(dense, first[:, None] + np.arange(4), value, 1)
    return dense


SIZES = st.tuples(st.integers(4, 14), st.integers(4, 14))


def random_net(shape, seed=0):
    return np.random.default_rng(seed).normal(size=(*shape, 3)) * 10


@given(SIZES, st.integers(1, 4), st.integers(1, 4), st.integers(0, 99))
@settings(max_examples=25, deadline=None)
def test_prolongation_is_exact_where_the_knots_nest(shape, by_u, by_v, seed):
    coarse = random_net(shape, seed)
    fine = prolonged(coarse, ((shape[0] - 3) * by_u + 3, (shape[1] - 3) * by_v + 3))
    u, v = np.random.default_rng(seed).uniform(size=(2, 30))
    np.testing.assert_allclose(
        BSplineSurface(fine).evaluate(u, v),
        BSplineSurface(coarse).evaluate(u, v),
        atol=1e-10,
    )


@given(st.integers(4, 20), st.integers(0, 30))
@settings(max_examples=25, deadline=None)
def test_prolongation_reproduces_every_cubic(coarse, more):
    """Whatever the sizes: a movement that is a cubic polynomial stays that one."""
    fine = coarse + more
    x = np.linspace(0, 1, 40)
    power = np.stack([x**k for k in range(4)], 1)
    net = np.linalg.lstsq(dense_basis(coarse, x), power, rcond=None)[0]
    assert np.allclose(dense_basis(coarse, x) @ net, power, atol=1e-9)
    found = dense_basis(fine, x) @ (prolongation(fine, coarse) @ net)
    np.testing.assert_allclose(found, power, atol=1e-8)


def test_no_movement_is_the_identity_bit_for_bit():
    surface = load_template().surface
    net = coarse_net(surface)
    assert net.shape == (12, 14, 3)
    after = apply_coarse(surface, net, net.copy())
    assert after.control_points.tobytes() == surface.control_points.tobytes()


def test_an_edit_and_its_reverse_are_the_identity():
    surface = load_template().surface
    net = coarse_net(surface)
    moved = net + random_net(net.shape[:2], 3)
    there = apply_coarse(surface, net, moved)
    back = apply_coarse(there, moved, net)
    np.testing.assert_allclose(back.control_points, surface.control_points, atol=1e-11)


def test_a_similarity_of_the_net_is_that_of_the_face_with_its_detail():
    """Turned as a whole, the net turns the face up to the detail that it lacks."""
    surface = load_template().surface
    net = coarse_net(surface)
    shifted = apply_coarse(surface, net, net + (3.0, -2.0, 5.0))
    np.testing.assert_allclose(
        shifted.control_points, surface.control_points + (3.0, -2.0, 5.0), atol=1e-12
    )


def test_one_point_moves_its_own_support_only():
    surface = load_template().surface
    net = coarse_net(surface)
    moved = net.copy()
    moved[5, 6] += (0, 0, 4.0)
    change = apply_coarse(surface, net, moved).control_points - surface.control_points
    far = np.abs(change).max(axis=2)
    # Four of the 9 (11) coarse spans, and at most two fine control points beyond.
    m, n = surface.shape
    t_u, t_v = (np.arange(m) - 1) / (m - 3), (np.arange(n) - 1) / (n - 3)
    outside_u = np.abs(t_u - 4 / 9) > 2 / 9 + 1 / (m - 3) + 1e-9
    outside_v = np.abs(t_v - 5 / 11) > 2 / 11 + 1 / (n - 3) + 1e-9
    assert not far[outside_u].any() and not far[:, outside_v].any()
    assert 1.0 < far.max() <= 4.0 and change[..., :2].max() == 0


def test_detail_stays():
    """The wrinkle that the coarse net cannot hold is the same before and after."""
    smooth = load_template().surface
    wrinkle = random_net(smooth.shape, 8) * 0.05
    rough = BSplineSurface(smooth.control_points + wrinkle)
    net = coarse_net(rough)
    moved = net + random_net(net.shape[:2], 2)
    np.testing.assert_allclose(
        apply_coarse(rough, net, moved).control_points
        - apply_coarse(smooth, net, moved).control_points,
        wrinkle,
        atol=1e-12,
    )


@pytest.mark.parametrize("m", [12, 13])
@pytest.mark.parametrize("side", ["left", "right", None])
def test_mirrored_edit_moves_both_halves_alike(m, side):
    before = random_net((m, 6), 1)
    after = before.copy()
    moved = m - 3 if side == "right" else 2
    after[moved, 3] += (2.0, 1.0, -0.5)
    both = mirrored_edit(before, after, side) - before
    np.testing.assert_allclose(both[::-1] * (-1, 1, 1), both, atol=1e-12)
    np.testing.assert_allclose(both[moved, 3], (2.0, 1.0, -0.5), atol=1e-12)
    assert np.count_nonzero(np.abs(both).max(axis=2) > 1e-9) == 2


def test_mirrored_edit_of_the_other_half_alone_is_undone():
    before = random_net((12, 6), 1)
    after = before.copy()
    after[9, 3] += (2.0, 1.0, -0.5)
    np.testing.assert_array_equal(mirrored_edit(before, after, "left"), before)


def test_unusable_nets_are_refused():
    surface = load_template().surface
    net = coarse_net(surface)
    with pytest.raises(ValueError, match="4 to 42 x 44|at least 4"):
        coarse_net(surface, (3, 9))
    with pytest.raises(ValueError, match="4 to 42 x 44"):
        coarse_net(surface, (50, 9))
    with pytest.raises(ValueError, match="both be"):
        apply_coarse(surface, net, net[1:])
    with pytest.raises(ValueError, match="not finite"):
        apply_coarse(surface, net, net * np.nan)
    with pytest.raises(ValueError, match="left"):
        mirrored_edit(net, net, "top")


@pytest.mark.parametrize("shape", [(12,), 12, (12, 13.5), (12, True)])
def test_a_coarse_net_has_two_whole_numbers(shape):
    with pytest.raises(ValueError, match="shape must be two whole numbers"):
        coarse_net(load_template().surface, shape)


@pytest.mark.parametrize("after", [np.full((5, 6, 3), np.nan), np.zeros((5, 6)),
                                   np.zeros((5, 1, 3)), np.zeros(3)])  # fmt: skip
def test_edits_that_fit_no_net_are_refused(after):
    with pytest.raises(ValueError, match="before and after must"):
        mirrored_edit(np.zeros((5, 6, 3)), after)
