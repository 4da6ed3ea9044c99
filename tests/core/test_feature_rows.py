"""How far lines leave the rows of a net: lines of which it is known."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from bsface.surface.bspline import BSplineSurface
from bsface.surface.template import load_template

TOOLS = Path(__file__).resolve().parents[2] / "tools"
sys.path.insert(0, str(TOOLS))
from feature_rows import ACROSS, DOWN, Line, departure, feature_lines  # noqa: E402

# A plane sheet of 13 x 20 knot spans: 2 mm a span across, 3 mm down.
M, N = 16, 23
SHEET = BSplineSurface(
    np.stack(
        np.meshgrid(2.0 * np.arange(M), -3.0 * np.arange(N), [5.0], indexing="ij"), -1
    )[:, :, 0]
)


@pytest.mark.parametrize("along, column", [(ACROSS, 20), (DOWN, 13)])
def test_a_line_on_a_row_does_not_leave_it(along, column):
    uv = np.full((5, 2), 7 / column)
    uv[:, along] = np.linspace(0.2, 0.8, 5)
    found = departure(SHEET, Line("row", uv, along))
    assert found.row == pytest.approx(7)
    assert max(found.spans, found.mm, found.degrees) < 1e-5


@pytest.mark.parametrize("along, spans, size", [(ACROSS, 20, 3.0), (DOWN, 13, 2.0)])
def test_a_slanting_line_leaves_its_row_by_half_its_rise(along, spans, size):
    """Its middle lies on the row; spans, mm and angle are those of the plane."""
    uv = np.empty((2, 2))
    uv[:, along] = 0.2, 0.7
    uv[:, 1 - along] = (np.array([8.0, 9.0])) / spans
    found = departure(SHEET, Line("slant", uv, along))
    assert found.row == pytest.approx(8.5)
    assert found.spans == pytest.approx(0.5)
    assert found.mm == pytest.approx(0.5 * size)
    wide = 0.5 * (13 * 2.0 if along == ACROSS else 20 * 3.0)
    assert found.degrees == pytest.approx(np.degrees(np.arctan2(size, wide)), rel=1e-6)


def test_lines_of_the_template_are_on_the_right_half_and_in_order():
    lines = feature_lines(load_template())
    assert len({line.name for line in lines}) == len(lines)
    down = [line.uv[:, 1].mean() for line in lines if line.along == ACROSS]
    assert down == sorted(down)
    for line in lines:
        assert ((line.uv > 0) & (line.uv < 1)).all()
        assert line.uv[:, 0].mean() < 0.51


def test_the_table():
    ran = subprocess.run(
        [sys.executable, str(TOOLS / "feature_rows.py")], capture_output=True, text=True
    )
    rows = ran.stdout.splitlines()
    assert ran.returncode == 0 and len(rows) == 2 + len(feature_lines(load_template()))
    # The nose is symmetric, and the net is too.
    (bridge,) = (row for row in rows if "bridge" in row)
    assert bridge.split("|")[3:5] == [" 0.00 ", " 0.0 "]
