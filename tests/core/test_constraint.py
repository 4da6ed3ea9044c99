"""An edited face as the template of the next run, and points that are held."""

import numpy as np
import pytest
from bsface import Constraint
from bsface.solve.constraint import hold
from bsface.solve.expression import expression_of
from bsface.surface.bspline import BSplineSurface
from bsface.surface.edited import edited_template
from bsface.surface.prior import shape_prior
from bsface.surface.template import load_template
from scipy.spatial.transform import Rotation


@pytest.fixture(scope="module")
def template():
    return load_template().resampled((16, 18))


def test_the_unedited_template_stays(template):
    """Whatever its size and place: they are undone."""
    R = Rotation.from_euler("yxz", [20, -10, 5], degrees=True).as_matrix()
    moved = template.surface.transformed(1.3, R, [10, 20, -30])
    made = edited_template(moved, template)
    for name in ("landmark_xyz", "eye_centres"):
        np.testing.assert_allclose(
            getattr(made, name), getattr(template, name), atol=1e-6
        )
    np.testing.assert_allclose(
        made.surface.control_points, template.surface.control_points, atol=1e-6
    )


def test_landmarks_go_with_the_edited_surface(template):
    """A nose made 5 mm longer takes its free landmark points along."""
    nose = template.landmark_xyz[:, 2].argmax()
    u, v = template.landmark_uv[nose]
    b = template.surface.control_points.copy()
    i, j = np.meshgrid(np.linspace(0, 1, 16), np.linspace(0, 1, 18), indexing="ij")
    b[..., 2] += 5 * np.exp(-((i - u) ** 2 + (j - v) ** 2) / 0.1**2)
    made = edited_template(type(template.surface)(b), template)
    shift = made.landmark_xyz - template.landmark_xyz
    on_surface = made.surface.evaluate(*template.landmark_uv.T)
    before = template.surface.evaluate(*template.landmark_uv.T)
    np.testing.assert_allclose(shift, on_surface - before, atol=1e-9)
    assert shift[nose, 2] > 2


def test_net_size_of_the_surface_counts(template):
    made = edited_template(template.surface.resampled((12, 14)), template)
    assert made.surface.shape == (12, 14)
    assert made.identity_modes.shape[1:3] == (12, 14)


@pytest.fixture(scope="module")
def prior(template):
    return shape_prior(template, 1.0, 0.7, 1.0, 0.12)


def edit(template, size=3.0):
    """One control point pulled out."""
    target = template.surface.control_points.copy()
    held = np.zeros(template.surface.shape, bool)
    held[7, 9] = True
    target[7, 9] += (0, 0, size)
    return target, held


def test_held_points_are_reached_and_far_ones_stay(template, prior):
    target, held = edit(template)
    made = hold(template.surface, target, Constraint(held), prior)
    moved = made.control_points - template.surface.control_points
    np.testing.assert_allclose(made.control_points[held], target[held], atol=1e-3)
    assert np.abs(moved[0]).max() < 0.2 * 3.0
    assert 0.5 < moved[8, 9, 2] < 3.2


def test_softness_lets_points_give_way(template, prior):
    target, held = edit(template)
    reached = [
        hold(template.surface, target, Constraint(held, soft), prior).control_points[
            7, 9, 2
        ]
        - template.surface.control_points[7, 9, 2]
        for soft in (0.0, 0.5, 2.0)
    ]
    assert 3.0 >= reached[0] > reached[1] > reached[2] > 0


def test_nothing_held_changes_nothing(template, prior):
    target, held = edit(template)
    none = Constraint(held & False)
    assert hold(template.surface, target, none, prior) is template.surface


def test_all_held_gives_the_target(template, prior):
    target, held = edit(template)
    made = hold(template.surface, target + 1.0, Constraint(held | True), prior)
    np.testing.assert_allclose(made.control_points, target + 1.0, atol=1e-3)


def test_wrong_shapes_are_refused(template, prior):
    target, held = edit(template)
    with pytest.raises(ValueError, match="shape of the net"):
        hold(template.surface, target, Constraint(held[1:]), prior)


def test_the_same_face_in_another_place_has_no_expression(template):
    R = Rotation.from_euler("yxz", [4, -3, 2], degrees=True).as_matrix()
    moved = template.surface.transformed(1.02, R, [3, -2, 5])
    np.testing.assert_allclose(
        expression_of(moved, template.surface, template), 0, atol=1e-6
    )


def test_an_expression_is_found_again_and_the_rest_stays(template):
    """Known expression, small similarity, and errors where no expression reaches."""
    neutral = template.surface
    e = template.expression_modes[0].reshape(*neutral.shape, 3)
    e = e * (6 / np.linalg.norm(e, axis=2).max())
    drift = np.zeros(neutral.shape)
    drift[:, 0] = 3.0  # hairline
    face = type(neutral)(neutral.control_points + e + drift[..., None])
    R = Rotation.from_euler("yxz", [3, -2, 1], degrees=True).as_matrix()
    found = expression_of(face.transformed(0.99, R, [2, 1, -4]), neutral, template)
    strong = np.linalg.norm(e, axis=2) > 3
    assert strong.sum() > 5
    strong[[0, -1]] = strong[:, [0, -1]] = False
    assert np.linalg.norm(found - e, axis=2)[strong].max() < 0.15 * 6
    assert np.abs(found[:, 0]).max() < 0.1 * 3
    assert np.median(np.abs(found[:, 0])) < 0.01


def test_expressions_of_other_nets_are_refused(template):
    with pytest.raises(ValueError, match="same size"):
        expression_of(template.surface.resampled((12, 14)), template.surface, template)


@pytest.mark.parametrize(
    "change",
    [
        lambda b: 0 * b,
        lambda b: 1e300 * b,
        lambda b: b * (1, 0, 0),
        lambda b: np.random.default_rng(0).normal(0, 50, b.shape),
    ],
    ids=["a point", "beyond all sizes", "a line", "noise"],
)
def test_an_edited_surface_that_is_no_face_is_refused(template, change):
    """Else the photos' landmarks would be blamed."""
    surface = BSplineSurface(change(template.surface.control_points))
    with pytest.raises(ValueError, match="is no face"):
        edited_template(surface, template)


@pytest.mark.parametrize(
    "points, softness, words",
    [
        (np.full((12, 12), np.nan), 0.0, "points must be"),
        ([3, 5, 7], 0.0, "points must be"),
        ([[3, 5], [7, 9]], 0.0, "points must be"),
        (np.full((4, 4), "x"), 0.0, "points must be"),
        (None, 0.0, "points must be"),
        (np.ones((4, 4), bool), -1.0, "softness"),
        (np.ones((4, 4), bool), np.nan, "softness"),
        (np.ones((4, 4), bool), np.inf, "softness"),
        (np.ones((4, 4), bool), "1", "softness"),
        (np.ones((4, 4), bool), True, "softness"),
    ],
)
def test_what_is_no_constraint_is_refused(points, softness, words):
    with pytest.raises((TypeError, ValueError), match=words):
        Constraint(points, softness)


def test_zeros_and_ones_are_as_good_as_false_and_true():
    held = Constraint(np.eye(4, 5), 1)
    assert held.points.dtype == bool and held.points.sum() == 4
