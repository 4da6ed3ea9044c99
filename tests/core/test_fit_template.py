"""A template from a mesh of one's own: a known face comes back."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from bsface.surface.alignment import fit_similarity
from bsface.surface.bspline import BSplineSurface, grid_triangles
from bsface.surface.template import load_template

TOOL = Path(__file__).resolve().parents[2] / "tools" / "fit_template.py"


def write_obj(path, vertices, triangles):
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in vertices]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles]
    path.write_text("\n".join(lines))


def run(*arguments):
    return subprocess.run(
        [sys.executable, str(TOOL), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=300,
    )


def test_a_known_face_comes_back(tmp_path):
    base = load_template()
    bent = base.surface.control_points + 1.5 * base.identity_modes[1]
    face = BSplineSurface(bent - 1.2 * base.identity_modes[4])
    # another unit and place than ours
    grid = face.grid(150, 150).reshape(-1, 3) / 25.4 + (3.0, -1.0, 2.0)
    marks = face.evaluate(*base.landmark_uv[base.schemes["68"]].T) / 25.4
    marks = (marks + (3.0, -1.0, 2.0)).tolist()
    marks[3] = None
    write_obj(tmp_path / "head.obj", grid, grid_triangles(150, 150))
    (tmp_path / "marks.json").write_text(json.dumps(marks))
    out = tmp_path / "my.npz"
    done = run(tmp_path / "head.obj", tmp_path / "marks.json", "-o", out)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout.split("mesh ")[1].split()[0]) < 0.15
    made = load_template(out)
    # up to size and place, the made surface is the face
    q = face.grid(40, 40).reshape(-1, 3)
    uv, _ = made.surface.closest_point(q)
    found, distance = made.surface, np.zeros(1)
    for _ in range(12):
        move = fit_similarity(found.evaluate(*uv.T), q)
        found = found.transformed(move.scale, move.R, move.t)
        uv, distance = found.closest_point(q)
    assert np.median(distance) < 0.4
    assert made.landmark_xyz.shape == base.landmark_xyz.shape


@pytest.mark.parametrize(
    ("mesh", "marks", "says"),
    [
        ("v 1 2 3\nf 1 1 1", "[]", "no usable mesh"),
        ("v a b c", "[]", "line 1"),
    ],
)
def test_bad_files_get_a_sentence(tmp_path, mesh, marks, says):
    (tmp_path / "head.obj").write_text(mesh)
    (tmp_path / "marks.json").write_text(marks)
    out = tmp_path / "my.npz"
    done = run(tmp_path / "head.obj", tmp_path / "marks.json", "-o", out)
    assert done.returncode == 1 and says in done.stderr
    assert "Traceback" not in done.stderr and not out.exists()
