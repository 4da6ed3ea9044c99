"""Rows that follow features: what the movement of (u, v) promises."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bsface.surface.bspline import BSplineSurface
from bsface.surface.template import load_template

TOOLS = Path(__file__).resolve().parents[2] / "tools"
sys.path.insert(0, str(TOOLS))
from align_rows import ROWS, aligned, carried, lattice, shifted  # noqa: E402
from feature_rows import departure, feature_lines, part  # noqa: E402

TEMPLATE = load_template()
SPANS = np.array(TEMPLATE.surface.shape) - 3
LINES = feature_lines(TEMPLATE)


@pytest.fixture(scope="module")
def move():
    return aligned(LINES, TEMPLATE.outline_uv, SPANS, 1e-3)


def test_lines_lie_in_whole_rows(move):
    for line in LINES:
        if line.name in ROWS:
            uv = move(part(line.uv, (0, 1)))
            found = departure(TEMPLATE.surface, replace(line, uv=uv))
            assert found.row == pytest.approx(ROWS[line.name], abs=0.02), line.name
            assert found.spans < 0.2, line.name


def test_nose_outline_and_border_stay(move):
    held = [line.uv for line in LINES if line.name == "base of the nose"]
    for uv in (*held, TEMPLATE.outline_uv):
        assert np.abs(move(uv) - uv).max() * SPANS[1] < 0.1
    edge = np.linspace(0, 1, 23)
    for side in (0.0, 1.0):
        for uv in (
            np.stack([edge, np.full(23, side)], -1),
            np.stack([np.full(23, side), edge], -1),
        ):
            np.testing.assert_allclose(move(uv), uv, atol=1e-4)


@pytest.mark.parametrize("by", [None, 0.5, -0.5])
def test_nothing_folds_and_the_halves_are_mirror_images(move, by):
    moved = move if by is None else shifted(SPANS, by)
    t = np.linspace(0, 1, 301)
    uv = lattice(t, t)
    there = moved(uv).reshape(301, 301, 2)
    np.testing.assert_array_equal(there[..., 0], uv.reshape(there.shape)[..., 0])
    assert np.diff(there[..., 1], axis=1).min() > 0.3 / 300
    np.testing.assert_allclose(there[::-1, :, 1], there[..., 1], atol=1e-12)


def test_a_carried_net_is_the_same_at_the_moved_place(move):
    nets = TEMPLATE.expression_modes[:2]
    uv = np.random.default_rng(3).random((400, 2)) * 0.9 + 0.05
    for before, after in zip(nets, carried(nets, move), strict=True):
        was = BSplineSurface(before).evaluate(*uv.T)
        now = BSplineSurface(after).evaluate(*move(uv).T)
        assert np.sqrt(((now - was) ** 2).mean() / (was**2).mean()) < 0.02
