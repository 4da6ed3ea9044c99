"""The iteration of the joint method: its levels, its steps, what it yields, its end."""

from dataclasses import replace

import numpy as np
import pytest
from bsface.progress import never_cancelled
from bsface.settings import Settings
from bsface.solve.joint.method import joint
from bsface.solve.joint.options import JointOptions, Level
from bsface.solve.joint.refine import OVER_RELAXATION, JointParts, relaxation
from bsface.solve.joint.samples import sample_grid
from joint_waves import (
    PHOTOS,
    SHAPE,
    cameras,
    directions,
    given,
    iterations,
    plane,
    start,
    wave,
)


def test_no_step_is_larger_than_allowed(template, prior):
    views, pictures = cameras(), [wave(k) for k in range(PHOTOS)]
    options = JointOptions((Level(3.0, 3, 12, 6),), max_step_mm=0.05)
    problem, begin = start(template, prior, plane(), views)
    before = begin.surface
    uv = sample_grid(template, 12)
    for one in iterations(problem, begin, pictures, options):
        after = one.state.surface
        away = after.evaluate(*uv.T) - before.evaluate(*uv.T)
        assert np.abs(away).max() < 0.051
        assert one.step_mm <= 0.05 + 1e-12
        before = after


@pytest.mark.parametrize(
    "settled, turns", [(1e9, [1, 1, 1, 2, 3]), (0.0, [1, 2, 1, 2, 1, 2, 3])]
)
def test_coarse_levels_end_when_they_are_settled(template, prior, settled, turns):
    """The last level takes all its steps; each has the harmonics of its degree."""
    views, pictures = cameras(), [wave(k) for k in range(PHOTOS)]
    levels = (
        Level(3.0, 2, 8, 2, settled),
        Level(2.0, 2, 9, 2, settled),
        Level(1.0, 3, 10, 3),
    )
    begin = start(template, prior, plane(), views)
    found = list(iterations(*begin, pictures, JointOptions(levels)))
    assert [one.turn for one in found] == turns
    assert [one.level for one in found] == sorted(one.level for one in found)
    for one in found:
        assert one.state.lights.shape[1] == (16 if one.level == 2 else 9)


def test_schedule_of_the_settings():
    levels = JointOptions.from_settings(Settings()).levels
    assert [level.blur_mm for level in levels] == pytest.approx([3.0, 1.52, 0.8])
    assert [level.iterations for level in levels] == [15, 10, 5]
    assert [level.degree for level in levels] == [4, 4, 6]
    assert [level.settled_mm > 0 for level in levels] == [True, True, False]
    few = JointOptions.from_settings(Settings(light_degree=2)).levels
    assert [level.degree for level in few] == [2, 2, 2]


def test_method_yields_estimates_of_the_face(template, prior):
    """Landmarks keep their offset; evidence and deviation come with the last one."""
    views, pictures = cameras(), [wave(k) for k in range(PHOTOS)]
    problem, begin = start(template, prior, plane(), views)
    raised = replace(begin, landmarks_xyz=begin.landmarks_xyz + (0, 0, 2.0))
    levels = (Level(3.0, 3, 8, 2, settled_mm=1e9), Level(2.0, 2, 9, 2))
    parts = JointParts(given(pictures), skin=())
    options = JointOptions(levels)
    found = list(joint(problem, raised, never_cancelled, parts, options))
    assert [(one.stage, one.done, one.total) for one in found] == [
        ("refine", 1, 5),
        ("refine", 4, 5),
        ("refine", 5, 5),
    ]
    for one in found:
        estimate = one.estimate
        on = estimate.surface.evaluate(*problem.landmarks.uv.T)
        np.testing.assert_allclose(estimate.landmarks_xyz - on, [[0, 0, 2.0]] * len(on))
        moved = estimate.smooth + np.einsum("k,kbx->bx", estimate.modes, prior.modes)
        ways = directions(begin.surface)
        total = ((estimate.surface.vector - begin.surface.vector) * ways).sum(1)
        np.testing.assert_allclose((moved * ways).sum(1), total, atol=1e-9)
    *early, last = [one.estimate for one in found]
    assert all(e.photometric is None and e.deviation is None for e in early)
    assert last.deviation.shape == SHAPE
    evidence = last.photometric
    assert evidence.lights.shape == (PHOTOS, 9)
    assert evidence.weights.shape == (PHOTOS, len(evidence.uv))


def test_cancelled_between_the_parts_of_a_step(template, prior):
    """Each call may stop the run: photos, and seven parts of a step."""
    views, pictures = cameras(), [wave(k) for k in range(PHOTOS)]
    problem, begin = start(template, prior, plane(), views)
    options = JointOptions((Level(3.0, 2, 8, 2),))
    parts = JointParts(given(pictures), skin=())

    class Stopped(Exception):
        pass

    def stop_at(call):
        calls = iter(range(call + 1))

        def check_cancelled():
            if next(calls) == call:
                raise Stopped

        return check_cancelled

    for call in range(PHOTOS + 7):
        run = joint(problem, begin, stop_at(call), parts, options)
        with pytest.raises(Stopped):
            next(run)


def test_samples_are_skin(template):
    uv = sample_grid(template, 40)
    assert 300 < len(uv) < 1600
    assert template.is_skin(uv).all()
    # the template's mirror image is sampled at the mirrored places
    mirrored = {tuple(np.round(x, 6)) for x in uv * (-1, 1) + (1, 0)}
    same = sum(tuple(np.round(x, 6)) in mirrored for x in uv)
    assert same > 0.95 * len(uv)


def test_steps_in_one_direction_get_longer():
    ahead, aside = np.array([1.0, 0.0]), np.array([0.0, 2.0])
    assert relaxation(ahead, None) == 1.0
    assert relaxation(ahead, 3 * ahead) == pytest.approx(1.0 + OVER_RELAXATION)
    assert relaxation(ahead, aside) == relaxation(ahead, -ahead) == 1.0
    assert relaxation(0 * ahead, ahead) == 1.0
