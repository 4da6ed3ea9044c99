"""The mesh of quads: on the surface, clean, open where it should be, keys that work."""

from types import SimpleNamespace

import numpy as np
import pytest
from bsface.rig.arkit import arkit_keys
from bsface.rig.eyes import RADIUS_MM, Eyeball, iris_picture, sphere, turned
from bsface.rig.grid import Slit, slit_grid
from bsface.rig.head import full_head
from bsface.rig.mesh import DENSITIES, PARTS, QuadMesh, quad_mesh
from bsface.rig.names import ARKIT_NAMES
from bsface.surface.bspline import BSplineSurface
from bsface.surface.template import load_template
from fake_face import ellipse_outline
from hypothesis import given, settings
from hypothesis import strategies as st
from quads import borders, directed_edges, person
from scipy.spatial import cKDTree


@pytest.fixture(scope="module")
def mesh():
    return quad_mesh(person(), "low")


def quad_normals(mesh: QuadMesh):
    corner = mesh.points[mesh.quads]
    return np.cross(corner[:, 2] - corner[:, 0], corner[:, 3] - corner[:, 1])


@pytest.mark.parametrize("eyes", [False, True])
@pytest.mark.parametrize("mouth", [False, True])
def test_mesh_is_oriented_and_open_only_at_its_outline(eyes, mouth):
    made = quad_mesh(person(), "low", eyes=eyes, mouth=mouth, keys=False)
    edges = directed_edges(made.quads)
    assert len(np.unique(edges, axis=0)) == len(edges), "an edge is used twice"
    assert all(len(set(q)) == 4 for q in made.quads.tolist())
    nu, nv, _ = DENSITIES["low"]
    rim = 2 * (nu + nv)
    loops = borders(made.quads)
    # The lid rims end behind the front of the eyeballs; the bag is closed.
    assert loops[-1] == rim and len(loops) == 1 + 2 * eyes
    parts = {PARTS[k] for k in np.unique(made.part)}
    assert parts == {"skin", *(["eyes"] * eyes), *(["mouth"] * mouth)}
    assert np.unique(made.quads).size == len(made.points), "a loose vertex"


@pytest.mark.parametrize("density", list(DENSITIES))
def test_skin_lies_on_the_surface_and_faces_outwards(density):
    face = person(1)
    made = quad_mesh(face, density, keys=False)
    nu, nv, _ = DENSITIES[density]
    skin = made.quads[: nu * nv]
    used = np.unique(skin)
    np.testing.assert_allclose(
        made.points[used], face.surface.evaluate(*made.uv[used].T), atol=1e-9
    )
    outward = face.surface.normals(*made.uv[used].T)
    normal = quad_normals(made)[: nu * nv]
    near = outward[np.searchsorted(used, skin)].mean(axis=1)
    assert ((normal * near).sum(axis=1) > 0).all()
    side = made.uv[skin]
    turn = np.roll(side, -1, axis=1) - side
    after = np.roll(turn, -1, axis=1)
    assert (turn[..., 0] * after[..., 1] - turn[..., 1] * after[..., 0]).max() < 0, (
        "a quad is not convex in (u, v)"
    )


def test_eyeballs_face_outwards_and_everything_has_the_size_of_a_person(mesh):
    for side, sign in (("left", 1), ("right", -1)):
        ball = mesh.points[mesh.groups[f"eyeball_{side}"]]
        centre = (ball.min(axis=0) + ball.max(axis=0)) / 2
        radius = np.linalg.norm(ball - centre, axis=1)
        assert np.ptp(radius) < 1e-9 and 10 < radius.mean() < 13
        assert 20 < sign * centre[0] < 40
    eyes = mesh.part == PARTS.index("eyes")
    corner = mesh.points[mesh.quads[eyes]].mean(axis=1)
    away = corner - np.sign(corner[:, :1]) * (np.abs(corner).mean(axis=0) * (1, 0, 0))
    assert ((quad_normals(mesh)[eyes] * away)[:, 0] > 0).mean() > 0.4


def test_mesh_of_a_symmetric_face_is_symmetric():
    net = load_template().surface.control_points
    even = BSplineSurface((net + net[::-1] * (-1, 1, 1)) / 2)
    made = quad_mesh(SimpleNamespace(surface=even, template=load_template()), "low")
    distance, partner = cKDTree(made.points).query(made.points * (-1, 1, 1))
    # The landmarks that place eyes and lips are symmetric to a tenth of a millimetre.
    assert distance.max() < 0.2
    # Not of the mouth: its two lips have the same places.
    for name in ("eyeBlink", "eyeLookIn", "browDown"):
        left, right = (made.keys[f"{name}{side}"] for side in ("Left", "Right"))
        assert np.abs(left - right[partner] * (-1, 1, 1)).max() < 0.3


def test_groups_divide_the_mesh(mesh):
    joined = np.concatenate(list(mesh.groups.values()))
    assert len(np.unique(joined)) == len(joined) == len(mesh.points)
    where = {n: mesh.points[i].mean(axis=0) for n, i in mesh.groups.items()}
    assert where["forehead"][1] > where["eye_left"][1] > where["nose"][1]
    assert where["nose"][1] > where["lip_upper"][1] > where["lip_lower"][1]
    assert where["lip_lower"][1] > where["jaw"][1]
    for name in ("brow", "eye", "cheek", "lid_rim", "eyeball"):
        assert where[f"{name}_left"][0] > 10 > -10 > where[f"{name}_right"][0]


def test_lips_part_and_close(mesh):
    points = mesh.points
    upper, lower = mesh.groups["lip_upper"], mesh.groups["lip_lower"]
    rest = np.linalg.norm(points[upper][:, None] - points[lower][None], axis=2)
    a, b = np.nonzero(rest < 1e-9)
    assert len(a) >= 8, "the two lips meet vertex by vertex"
    pairs = upper[a], lower[b]

    def gap(*names):
        moved = points + sum(mesh.keys[n] for n in names)
        return np.linalg.norm(moved[pairs[0]] - moved[pairs[1]], axis=1).max()

    assert gap("jawOpen") > 15
    assert gap("jawOpen", "mouthClose") < 0.1 * gap("jawOpen")
    assert gap("browInnerUp") == 0


def test_keys_of_the_mesh_are_those_of_the_surface(mesh):
    """Away from the line between the lips both move alike."""
    face = person()
    keys = arkit_keys(face)
    assert tuple(mesh.keys) == ARKIT_NAMES
    nu, nv, _ = DENSITIES["low"]
    used = np.unique(mesh.quads[: nu * nv])
    used = used[np.abs(mesh.uv[used, 1] - 0.61) > 0.12]
    for name in ("jawOpen", "eyeBlinkLeft", "mouthPucker", "noseSneerRight"):
        expected = BSplineSurface(keys[name]).evaluate(*mesh.uv[used].T)
        np.testing.assert_allclose(mesh.keys[name][used], expected, atol=1e-9)


def test_eyes_turn_where_the_key_says(mesh):
    left = mesh.groups["eyeball_left"]
    front = left[mesh.points[left, 2].argmax()]
    for way, axis, sign in (
        ("Up", 1, 1),
        ("Down", 1, -1),
        ("In", 0, -1),
        ("Out", 0, 1),
    ):
        moved = mesh.keys[f"eyeLook{way}Left"][front]
        assert sign * moved[axis] > 1.5
        assert not mesh.keys[f"eyeLook{way}Right"][left].any()
    still = [n for n in ARKIT_NAMES if not (n.startswith("eyeLook"))]
    assert not any(mesh.keys[n][left].any() for n in still)


@given(st.integers(0, 10_000))
@settings(max_examples=3, deadline=None)
def test_lids_of_everybody_stay_outside_the_eyeball(seed):
    made = quad_mesh(person(seed), "low")
    for side in ("Left", "Right"):
        ball = made.points[made.groups[f"eyeball_{side.lower()}"]]
        centre = (ball.min(axis=0) + ball.max(axis=0)) / 2
        radius = np.linalg.norm(ball[0] - centre)
        lids = made.groups[f"eye_{side.lower()}"]
        blink = made.keys[f"eyeBlink{side}"]
        # Keys add up along straight lines; the ball is round.
        for weight in (0.0, 0.5, 1.0):
            at = made.points[lids] + weight * blink[lids]
            assert np.linalg.norm(at - centre, axis=1).min() > radius - 0.35


def test_a_point_at_the_centre_of_an_eyeball_stays():
    """It has no direction; a face whose eyes are at one place has such points."""
    ball = Eyeball(np.array([3.0, -2.0, 5.0]), 12.0)
    points = ball.centre + ((0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    with np.errstate(all="raise"):
        moved = ball.onto(points)
    np.testing.assert_allclose(moved - ball.centre, ((0, 0, 0), (0, 12, 0)))


@given(st.floats(5, 20), st.integers(2, 7))
@settings(max_examples=10, deadline=None)
def test_sphere_is_closed_and_faces_outwards(radius, cells):
    ball = Eyeball(np.array([3.0, -2.0, 5.0]), radius)
    points, quads, uv = sphere(ball, cells)
    assert borders(quads) == []
    assert len(points) - len(quads) == 2, "Euler's formula for a closed quad mesh"
    corner = points[quads]
    normal = np.cross(corner[:, 2] - corner[:, 0], corner[:, 3] - corner[:, 1])
    assert ((corner.mean(axis=1) - ball.centre) * normal).sum(axis=1).min() > 0
    np.testing.assert_allclose(
        np.linalg.norm(points - ball.centre, axis=1), radius, rtol=1e-12
    )
    assert uv.min() >= 0 and uv.max() <= 1
    moved = points + turned(ball, points, (20.0, 10.0))
    np.testing.assert_allclose(
        np.linalg.norm(moved - ball.centre, axis=1), radius, rtol=1e-12
    )
    assert turned(ball, ball.centre + [[0, 0, radius]], (20.0, 10.0))[0, 0] > 0
    assert turned(ball, ball.centre + [[0, 0, radius]], (20.0, 10.0))[0, 1] > 0


def test_drawn_iris_has_its_size_in_millimetres():
    picture = iris_picture()
    row = picture[128].astype(float).mean(axis=1)
    inside = np.flatnonzero(row < 160)
    width = (inside[-1] - inside[0] + 1) / 256 / 0.98 * 2 * RADIUS_MM
    assert width == pytest.approx(11.7, abs=0.6)


@given(st.floats(0.3, 0.45), st.floats(0.02, 0.06), st.floats(0.4, 0.6))
@settings(max_examples=10, deadline=None)
def test_grid_with_a_slit_has_no_folds(x, half, y):
    u = np.linspace(x, 1 - x, 21)
    bow = half * np.sin(np.pi * (u - x) / (1 - 2 * x))
    slit = Slit(np.stack([u, y - bow], 1), np.stack([u, y + bow], 1))
    grid = slit_grid(ellipse_outline(), (slit,), (30, 32))
    p = grid.uv[grid.quads]
    turn = np.roll(p, -1, axis=1) - p
    after = np.roll(turn, -1, axis=1)
    cross = turn[..., 0] * after[..., 1] - turn[..., 1] * after[..., 0]
    assert cross.max() < 0
    upper, lower = grid.banks[0]
    assert upper[0] == lower[0] and upper[-1] == lower[-1]
    np.testing.assert_allclose(grid.uv[upper[0]], slit.upper[0], atol=1e-12)
    assert (grid.uv[upper[1:-1], 1] < grid.uv[lower[1:-1], 1]).all()


def test_unusable_requests_are_refused():
    with pytest.raises(ValueError, match="low, medium, high"):
        quad_mesh(person(), "huge")
    u = np.linspace(0.49, 0.51, 5)
    tiny = Slit(np.stack([u, u], 1), np.stack([u, u], 1))
    with pytest.raises(ValueError, match="too coarse"):
        slit_grid(ellipse_outline(), (tiny,), (20, 20))


@pytest.mark.parametrize("wrong", [None, 3, load_template().surface])
def test_a_surface_alone_is_no_face_for_quads(wrong):
    for make in (quad_mesh, full_head):
        with pytest.raises(TypeError, match="face must be a face with its template"):
            make(wrong)
