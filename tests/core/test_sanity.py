"""The check of a finished surface: faces pass in any frame, spikes and folds do not."""

import numpy as np
import pytest
from bsface.errors import ReconstructionError
from bsface.solve.sanity import check_surface, measure_surface
from bsface.surface.bspline import BSplineSurface
from bsface.surface.template import load_template
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

TEMPLATE = load_template().resampled((30, 32))
EYE = TEMPLATE.eye_distance


def moved(change):
    """The template with other control points: ``change`` edits a copy in place."""
    b = TEMPLATE.surface.control_points.copy()
    change(b)
    return BSplineSurface(b)


def spike(height):
    """One control point of an eye pulled out, in eye distances."""

    def pull(b):
        b[11, 12, 2] += height * EYE

    return moved(pull)


@settings(max_examples=15, deadline=None)
@given(
    st.floats(1e-3, 1e3),
    st.lists(st.floats(-3, 3), min_size=3, max_size=3),
    st.lists(st.floats(-1e4, 1e4), min_size=3, max_size=3),
)
def test_unit_and_frame_do_not_matter(scale, turn, shift):
    R = Rotation.from_rotvec(turn).as_matrix()
    face = spike(0.5).transformed(scale, R, np.array(shift))
    here = measure_surface(face, TEMPLATE)
    there = measure_surface(spike(0.5), TEMPLATE)
    for name, value in vars(there).items():
        assert getattr(here, name) == pytest.approx(value, rel=1e-5, abs=1e-6)


def test_the_template_is_at_zero():
    found = measure_surface(TEMPLATE.surface, TEMPLATE)
    assert max(found.landmarks, found.farthest, found.net, found.turned) < 1e-9
    assert found.stretch == pytest.approx(1)


@pytest.mark.parametrize("seed", range(4))
def test_other_faces_and_wide_expressions_pass(seed):
    """Faces drawn from the prior, with an expression of one standard deviation."""
    rng = np.random.default_rng(seed)
    modes = TEMPLATE.identity_modes
    a = rng.normal(size=len(modes))
    face = TEMPLATE.surface.control_points + np.einsum("k,kuvx->uvx", a, modes)
    smile = TEMPLATE.expression_modes[seed % len(TEMPLATE.expression_modes)]
    assert check_surface(BSplineSurface(face + smile), TEMPLATE) == ()


def test_a_spike_is_doubted_and_then_refused():
    assert check_surface(spike(0.2), TEMPLATE) == ()
    (sentence,) = [s for s in check_surface(spike(1.0), TEMPLATE) if "control" in s]
    assert "1.0 eye distances" in sentence and "default method" in sentence
    with pytest.raises(ReconstructionError, match="no face.*default method"):
        check_surface(spike(7.0), TEMPLATE)


@pytest.mark.parametrize("size", [8, 42])
def test_corners_of_the_net_hardly_count(size):
    """They weigh 1/36 on the surface at most, and no photo shows where they are."""
    template = load_template().resampled((size, size))
    net = template.surface.control_points.copy()
    net[0, -1] += (0, 0, 4 * template.eye_distance)
    found = measure_surface(BSplineSurface(net), template)
    assert found.farthest < 0.12
    assert not check_surface(BSplineSurface(net), template)


def test_a_fold_is_refused():
    def fold(b):
        # the cheeks' columns run backwards
        b[8:22, 10:22] = b[8:22, 21:9:-1].copy()

    with pytest.raises(ReconstructionError, match="folded over"):
        check_surface(moved(fold), TEMPLATE)


def test_an_inside_out_face_is_refused():
    def mirror(b):
        b[..., 2] *= -1

    with pytest.raises(ReconstructionError, match="no face"):
        check_surface(moved(mirror), TEMPLATE)


def test_a_face_of_one_point_is_refused():
    def shrink(b):
        b[:] = b[0, 0]

    with pytest.raises(ReconstructionError, match="no face"):
        check_surface(moved(shrink), TEMPLATE)


def test_a_huge_control_point_is_refused():
    def throw(b):
        b[0, 0, 0] = 1e300

    with pytest.raises(ReconstructionError, match="every size"):
        check_surface(moved(throw), TEMPLATE)
