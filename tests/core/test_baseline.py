"""Photometric stereo and depth integration on surfaces with known depth."""

import numpy as np
import pytest
from _baseline import (
    baseline,
    boundary,
    depth_triangles,
    frontal_grid,
    integrate,
)
from bsface.errors import ReconstructionError
from bsface.surface.bspline import BSplineSurface


def cap(depth, bump=0.0, shape=(16, 16)):
    """Paraboloid cap with a smooth relief, as a surface."""
    m, n = shape
    u, v = np.meshgrid(
        (np.arange(m) - 1) / (m - 3), (np.arange(n) - 1) / (n - 3), indexing="ij"
    )
    x, y = 140 * (u - 0.5), -180 * (v - 0.5)
    z = -depth * ((x / 70) ** 2 + (y / 90) ** 2)
    z = z + bump * np.cos(3 * np.pi * u) * np.sin(2 * np.pi * v)
    return BSplineSurface(np.stack([x, y, z], -1))


def pixels(rows=20, columns=15):
    return np.arange(rows * columns).reshape(rows, columns)


def test_grid_sees_the_surface_at_pixel_centres():
    surface = cap(40)
    grid = frontal_grid(surface, 5.0)
    assert np.allclose(surface.evaluate(*grid.uv.T), grid.points)
    rows, columns = np.nonzero(grid.index >= 0)
    number = grid.index[rows, columns]
    assert sorted(number) == list(range(len(grid.points)))
    x, y = grid.points[number, 0], grid.points[number, 1]
    assert np.allclose(x - x.min(), 5 * (columns - columns.min()), atol=0.1)
    assert np.allclose(y.max() - y, 5 * (rows - rows.min()), atol=0.1)
    assert len(number) > 0.85 * (140 / 5) * (180 / 5)


def test_grid_keeps_to_the_outline():
    def inside(uv):
        return np.linalg.norm(uv - 0.5, axis=1) < 0.3

    grid = frontal_grid(cap(40), 5.0, inside)
    assert inside(grid.uv).all()
    assert len(grid.uv) == pytest.approx(np.pi * 0.3**2 * 140 * 180 / 25, rel=0.1)


def test_grid_takes_the_layer_in_front():
    """A sheet that folds over itself: the picture shows the upper layer."""
    u, v = np.meshgrid(np.linspace(-0.1, 1.1, 16), np.linspace(-0.1, 1.1, 16))
    angle = 1.3 * np.pi * (u.T - 0.5)
    x, z = 50 * np.sin(angle), 50 * np.cos(angle)
    grid = frontal_grid(BSplineSurface(np.stack([x, -100 * (v.T - 0.5), z], -1)), 4.0)
    assert grid.points[:, 2].min() > 0


def test_plane_is_integrated_exactly():
    index = pixels()
    rows, columns = np.nonzero(index >= 0)
    x, y = 2.0 * columns, -2.0 * rows
    normal = np.array([0.3, -0.2, 0.9])
    z = -(normal[0] * x + normal[1] * y) / normal[2] + 7
    normals = np.tile(normal / np.linalg.norm(normal), (len(z), 1))
    assert np.allclose(integrate(normals, index, z, 2.0), z, atol=1e-6)
    # The border's template decides the constant only.
    assert np.allclose(integrate(normals, index, z - 3, 2.0), z - 3, atol=1e-6)


def test_equals_the_dense_solution():
    rng = np.random.default_rng(0)
    index = pixels(6, 5)
    index[0, 0] = -1
    index[index >= 0] = np.arange(29)
    normals = rng.normal(size=(29, 3)) * 0.3 + [0, 0, 1]
    depth = rng.normal(size=29)
    A, y = [], []
    for r in range(6):
        for c in range(5):
            here = index[r, c]
            for rr, cc, axis in ((r, c + 1, 0), (r - 1, c, 1)):
                if here < 0 or rr < 0 or cc > 4 or index[rr, cc] < 0:
                    continue
                n = (normals[here] + normals[index[rr, cc]]) / 2
                row = np.zeros(29)
                row[index[rr, cc]], row[here] = n[2], -n[2]
                A.append(row)
                y.append(-n[axis] * 1.5)
    for b in boundary(index):
        A.append(0.1 * np.eye(29)[b])
        y.append(0.1 * depth[b])
    A = np.vstack([*A, np.sqrt(1e-6) * np.eye(29)])
    y = np.concatenate([y, np.sqrt(1e-6) * depth])
    expected = np.linalg.lstsq(A, y, rcond=None)[0]
    assert np.allclose(integrate(normals, index, depth, 1.5), expected, atol=1e-7)


def test_triangles_face_the_camera():
    index = pixels(4, 3)
    index[0, 0] = -1
    t = depth_triangles(index)
    assert len(t) == 2 * 6 - 2
    xy = np.stack([np.arange(12) % 3, -(np.arange(12) // 3)], 1)
    a, b, c = xy[t[:, 0]], xy[t[:, 1]], xy[t[:, 2]]
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    assert (area > 0).all()


def test_recovers_an_ideal_lambertian_face():
    template, truth = cap(40), cap(40, 3.0)
    rng = np.random.default_rng(1)
    direction = rng.normal(size=(16, 3)) + [0, 0, 1]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)

    def sample(uv):
        # Both surfaces have the same x, y at the same u, v.
        M = 1.2 + direction @ truth.normals(*uv.T).T
        return M, np.ones_like(M)

    face = baseline(template, sample, spacing=3.0)
    expected = truth.evaluate(*face.uv.T)[:, 2]
    before = template.evaluate(*face.uv.T)[:, 2] - expected
    after = face.points[:, 2] - expected
    assert np.std(after) < 0.4 * np.std(before)
    cosine = (face.normals * truth.normals(*face.uv.T)).sum(1)
    assert np.degrees(np.arccos(cosine.clip(-1, 1))).mean() < 2
    assert face.triangles.max() == len(face.points) - 1


def test_refuses_what_cannot_work():
    with pytest.raises(ValueError, match="spacing"):
        frontal_grid(cap(40), 0)
    with pytest.raises(ReconstructionError, match="outline"):
        frontal_grid(cap(40), 5.0, lambda uv: np.zeros(len(uv), bool))
    turned = cap(40).control_points * [-1, 1, -1]
    with pytest.raises(ReconstructionError, match=r"face \+z"):
        frontal_grid(
            BSplineSurface(turned * [-1, 1, 1]).transformed(R=np.diag([-1.0, 1, -1])),
            5.0,
        )
