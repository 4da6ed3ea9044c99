"""The whole head: the average head for the average face, and no seam for any other."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from bsface.rig.arkit import arkit_keys
from bsface.rig.base_head import base_head, face_region
from bsface.rig.continuation import Continuation, cotangent_laplacian
from bsface.rig.head import SURE, full_head
from bsface.rig.mesh import DENSITIES, PARTS
from bsface.rig.names import ARKIT_NAMES
from bsface.surface.bspline import BSplineSurface
from bsface.surface.template import load_template
from hypothesis import given, settings
from hypothesis import strategies as st
from quads import borders, directed_edges, person
from scipy.spatial.transform import Rotation

SEEDS = (1, 2, 3, 4)


@cache
def head_of(seed=None):
    return full_head(person(seed), "medium", keys=False)


def skin_of(mesh, base):
    """Points and quads of the skin alone."""
    return mesh.points[: len(base.points)], mesh.quads[: len(base.quads)]


def normals(points, quads):
    corner = points[quads]
    across = np.cross(corner[:, 2] - corner[:, 0], corner[:, 3] - corner[:, 1])
    return across / np.linalg.norm(across, axis=1, keepdims=True)


def creases(points, quads):
    """Pairs of neighbouring quads and the angle between them, degrees."""
    edges = np.sort(directed_edges(quads), axis=1)
    order = np.lexsort(edges.T)
    edges, owner = edges[order], np.tile(np.arange(len(quads)), 4)[order]
    same = (edges[:-1] == edges[1:]).all(axis=1)
    pairs = np.stack([owner[:-1][same], owner[1:][same]], axis=1)
    n = normals(points, quads)
    cosine = (n[pairs[:, 0]] * n[pairs[:, 1]]).sum(axis=1)
    return pairs, np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def test_the_average_face_has_the_average_head():
    base, made = base_head(), head_of()
    away = np.linalg.norm(made.points[: len(base.points)] - base.points, axis=1)
    # The template's net follows the mesh but for the crease of the lips, whose two
    # banks are laid on one line, and the rims of the nostrils.
    assert np.median(away) < 0.15 and away.max() < 3.5
    outside = ~(face_region(base.uv) <= SURE)
    outside[made.groups["nose"]] = False
    assert away[outside].max() < 0.4


@given(st.floats(0.5, 2), st.integers(0, 100), st.floats(-200, 200))
@settings(max_examples=3, deadline=None)
def test_a_moved_face_has_the_moved_head(scale, seed, shift):
    face = person(7)
    R = Rotation.random(random_state=seed).as_matrix()
    t = np.array([shift, -shift, 10.0])
    net = scale * face.surface.control_points @ R.T + t
    moved = SimpleNamespace(surface=BSplineSurface(net), template=face.template)
    base = base_head("low")
    one, other = (
        full_head(f, "low", keys=False).points[: len(base.points)]
        for f in (face, moved)
    )
    np.testing.assert_allclose(other, scale * one @ R.T + t, atol=1e-6 * scale)


@pytest.mark.parametrize("seed", [None, *SEEDS])
def test_sure_vertices_lie_on_the_surface(seed):
    base, made = base_head(), head_of(seed)
    sure = np.flatnonzero(face_region(base.uv) <= SURE)
    assert len(sure) > 5000
    there = person(seed).surface.evaluate(*base.uv[sure].T)
    np.testing.assert_allclose(made.points[sure], there, atol=1e-9)


def test_a_symmetric_face_has_a_symmetric_head():
    template = load_template()
    net = person(5).surface.control_points
    even = BSplineSurface((net + net[::-1] * (-1, 1, 1)) / 2)
    made = full_head(SimpleNamespace(surface=even, template=template), keys=False)
    base = base_head()
    place = np.round(base.place * 1e5).astype(int)
    mirrored = np.round((base.place * (-1, 1) + (1, 0)) * 1e5).astype(int)
    # Partners have mirrored places in the picture; the lips have two at one place.
    index = {tuple(p): k for k, p in enumerate(place.tolist())}
    pairs = [(k, index.get(tuple(p), -1)) for k, p in enumerate(mirrored.tolist())]
    a, b = np.array([p for p in pairs if p[1] >= 0]).T
    assert len(a) > 0.95 * len(place)
    away = np.linalg.norm(made.points[a] * (-1, 1, 1) - made.points[b], axis=1)
    assert away.max() < 2e-2  # places are stored in hundredths of a millimetre


@pytest.mark.parametrize("seed", SEEDS)
def test_no_seam_can_be_seen_and_nothing_is_folded(seed):
    base, made = base_head(), head_of(seed)
    points, quads = skin_of(made, base)
    pairs, angle = creases(points, quads)
    before = creases(base.points, base.quads)[1]
    region = face_region(base.uv)
    sure = (region <= SURE)[base.quads]
    nostril = np.isnan(region)
    nostril[np.setdiff1d(np.arange(len(region)), made.groups["nose"])] = False
    nostril = nostril[quads].any(axis=1)
    inner, outer = sure.all(axis=1), ~sure.any(axis=1) & ~nostril
    seam = ~inner & ~outer & ~nostril
    at = seam[pairs].any(axis=1)
    more = np.abs(angle - before)

    def rms(which):
        return np.sqrt((more[which] ** 2).mean())

    assert at.sum() > 200
    # Less than the faces themselves differ from the average one.
    assert more[at].max() < 8 and rms(at) < 0.6 * rms(inner[pairs].all(axis=1))
    # The ears keep their folds, the skull its roundness.
    assert more[outer[pairs].all(axis=1)].max() < 8
    # A quad turns with the face, never over.
    turn = (normals(points, quads) * normals(base.points, base.quads)).sum(axis=1)
    assert turn[~inner].min() > 0.5

    def sides(at):
        return np.linalg.norm(at[quads] - at[np.roll(quads, -1, axis=1)], axis=2)

    ratio = (sides(points) / sides(base.points))[~inner]
    assert ratio.min() > 0.4 and ratio.max() < 2.0


@pytest.mark.parametrize("density", list(DENSITIES))
def test_the_head_is_open_only_at_the_neck_and_behind_the_lids(density):
    made = full_head(person(2), density, keys=False)
    edges = directed_edges(made.quads) @ (len(made.points), 1)
    assert len(np.unique(edges)) == len(edges), "an edge is used twice"
    corners = np.sort(made.quads, axis=1)
    assert (np.diff(corners, axis=1) > 0).all(), "a corner is there twice"
    assert np.unique(made.quads).size == len(made.points), "a loose vertex"
    base = base_head(density)
    lids = len(base.lids[0])
    neck = {"low": 42, "medium": 84, "high": 168}[density]
    assert borders(made.quads) == sorted([lids, lids, neck])
    sure = face_region(base.uv) <= SURE
    there = person(2).surface.evaluate(*base.uv[sure].T)
    np.testing.assert_allclose(made.points[: len(base.points)][sure], there, atol=1e-9)


def test_the_edge_of_the_neck_is_even():
    base = base_head()
    edges = {tuple(e) for e in directed_edges(base.quads).tolist()}
    rim = [e for e in edges if e[::-1] not in edges]
    neck = np.array([e for e in rim if base.points[list(e), 1].max() < -80])
    after = dict(neck.tolist())
    loop = [neck[0, 0]]
    while after[loop[-1]] != loop[0]:
        loop.append(after[loop[-1]])
    assert len(loop) == len(neck)
    step = np.diff(base.points[[*loop, loop[0]]], axis=0)
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    turn = np.degrees(np.arccos((step * np.roll(step, -1, 0)).sum(axis=1).clip(-1, 1)))
    assert turn.max() < 15


def test_the_picture_of_the_head_has_no_folds():
    base = base_head()
    p = base.place[base.quads]
    d, e = p[:, 2] - p[:, 0], p[:, 3] - p[:, 1]
    assert (d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0]).max() < 0
    assert base.place.min() >= 0 and base.place.max() <= 1


def test_groups_divide_the_head():
    made = head_of()
    joined = np.concatenate(list(made.groups.values()))
    assert len(np.unique(joined)) == len(joined) == len(made.points)
    where = {n: made.points[i].mean(axis=0) for n, i in made.groups.items()}
    assert where["ear_left"][0] > 60 > -60 > where["ear_right"][0]
    assert where["scalp"][1] > 0 > where["neck"][1] > -140
    assert where["scalp"][2] < where["nose"][2] - 60
    assert where["forehead"][1] > where["nose"][1] > where["jaw"][1]


def test_keys_move_the_face_and_leave_the_back_of_the_head():
    face = person(3)
    made = full_head(face, "low")
    plain = full_head(face, "low", keys=False)
    np.testing.assert_array_equal(made.points, plain.points)
    np.testing.assert_array_equal(made.quads, plain.quads)
    assert tuple(made.keys) == ARKIT_NAMES
    base = base_head("low")
    sure = np.flatnonzero(face_region(base.uv) <= SURE)
    sure = sure[np.abs(base.uv[sure, 1] - 0.61) > 0.12]
    for name in ("jawOpen", "eyeBlinkLeft", "browInnerUp"):
        key = BSplineSurface(arkit_keys(face)[name]).evaluate(*base.uv[sure].T)
        moved = made.keys[name]
        # What moves next to nothing stays.
        np.testing.assert_allclose(moved[sure], key, atol=0.021)
    back = np.flatnonzero(base.points[:, 2] < -120)
    for name in ARKIT_NAMES:
        most = np.linalg.norm(made.keys[name], axis=1)
        assert most[back].max() <= 0.05 * max(most.max(), 1.0), name
    jaw = made.keys["jawOpen"]
    chin = made.groups["jaw"]
    assert np.linalg.norm(jaw[chin], axis=1).max() > 10
    assert not made.keys["tongueOut"].any()


def test_parts_are_skin_eyes_and_mouth():
    made = head_of()
    assert {PARTS[k] for k in np.unique(made.part)} == set(PARTS)
    with pytest.raises(ValueError, match="low, medium, high"):
        full_head(person(), "huge")


def plate(count=12):
    """A square of quads, 10 mm apart."""
    x, y = np.meshgrid(np.arange(count) * 10.0, np.arange(count) * 10.0, indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), np.zeros(count**2)], axis=1)
    n = np.arange(count**2).reshape(count, count)
    quads = np.stack([n[:-1, :-1], n[1:, :-1], n[1:, 1:], n[:-1, 1:]], axis=-1)
    return points, quads.reshape(-1, 4)


def test_laplacian_of_a_plate_is_that_of_the_grid():
    points, quads = plate()
    L, area = cotangent_laplacian(points, quads)
    inner = ((points[:, :2] > 0) & (points[:, :2] < 110)).all(axis=1)
    np.testing.assert_allclose(area[inner], 100.0)
    np.testing.assert_allclose(area.sum(), 110.0**2)
    quadratic = points[:, 0] ** 2 + 3 * points[:, 1] ** 2
    # L is minus the Laplacian times the area; that of x^2 + 3 y^2 is 8.
    np.testing.assert_allclose((L @ quadratic)[inner], -800.0)
    np.testing.assert_allclose(L @ np.ones(len(points)), 0, atol=1e-12)


def test_continuation_holds_what_is_given_and_has_no_kink():
    points, quads = plate(24)
    weight = np.where(points[:, 0] <= 80, np.inf, 0.0)
    carry = Continuation(points, quads, weight, 80.0)
    given = np.stack([points[:, 0] / 100, np.ones(len(points))], axis=1)
    found = carry(given)
    held = np.isinf(weight)
    np.testing.assert_array_equal(found[held], given[held])
    row = found[points[:, 1] == 120]
    slope = np.diff(row, axis=0)
    # Before the seam the first value rises by 0.1 from point to point.
    np.testing.assert_allclose(slope[:8, 0], 0.1)
    assert abs(slope[8, 0] - 0.1) < 0.04 and abs(slope[8, 1]) < 0.04
    assert np.abs(np.diff(slope, axis=0)).max() < 0.05
    nothing = carry(np.zeros((len(points), 3)))
    assert not nothing.any()
