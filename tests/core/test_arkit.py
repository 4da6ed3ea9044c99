"""The 52 ARKit keys: names, places, sides, sums; a key at 0 changes nothing."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from bsface.errors import ReconstructionError
from bsface.rig.arkit import LIDS, arkit_keys, face_units, lid_slit
from bsface.rig.grid import along
from bsface.rig.names import ARKIT_NAMES
from bsface.surface.bspline import BSplineSurface, grid_parameters
from bsface.surface.template import load_template
from scipy.spatial import cKDTree

SIDEWAYS = ("jawLeft", "jawRight", "mouthLeft", "mouthRight")
# Where a key may move the skin, as classes of the nearest landmark. A place where it
# moves by less than 12 % of its most counts as unmoved.
LOWER = {"cheek", "jaw", "lip", "nose", "outline"}
ALLOWED = {
    "eyeBlink": {"eye", "brow", "cheek", "nose"},
    "eyeLook": {"eye", "brow", "cheek", "nose"},
    "eyeSquint": {"eye", "cheek", "nose", "brow", "outline"},
    "eyeWide": {"eye", "brow", "cheek", "nose"},
    "jaw": LOWER,
    "mouth": LOWER | {"eye"},
    "brow": {"brow", "forehead", "eye", "outline", "cheek", "nose"},
    "cheek": {"cheek", "eye", "jaw", "lip", "nose", "outline"},
    "noseSneer": {"nose", "cheek", "eye", "brow", "forehead", "lip", "outline"},
}


def face(surface=None):
    template = load_template()
    return SimpleNamespace(surface=surface or template.surface, template=template)


@pytest.fixture(scope="module")
def keys():
    return arkit_keys(face())


@pytest.fixture(scope="module")
def places():
    """(u, v) inside the outline and the class of the nearest landmark."""
    template, units = load_template(), face_units()
    uv = np.stack(grid_parameters(61, 61), 1)
    uv = uv[template.inside(uv)]
    return uv, units.landmark_class[cKDTree(units.landmark_uv).query(uv)[1]]


def movement(key, uv):
    return np.linalg.norm(BSplineSurface(key).evaluate(*uv.T), axis=1)


def test_names_are_apples_in_apples_order(keys):
    assert list(keys) == list(ARKIT_NAMES) and len(set(ARKIT_NAMES)) == 52
    # Spot checks of the order of the documentation, and every left has its right.
    assert ARKIT_NAMES[0] == "eyeBlinkLeft" and ARKIT_NAMES[-1] == "tongueOut"
    assert ARKIT_NAMES[17] == "jawOpen" and ARKIT_NAMES.index("browInnerUp") == 43
    left = {n.removesuffix("Left") for n in ARKIT_NAMES if n.endswith("Left")}
    right = {n.removesuffix("Right") for n in ARKIT_NAMES if n.endswith("Right")}
    assert left == right and len(left) == 20
    assert all(k.shape == load_template().surface.control_points.shape
               for k in keys.values())  # fmt: skip


def test_weight_zero_is_the_neutral_face_bit_for_bit(keys):
    net = load_template().surface.control_points
    total = net + sum(0.0 * key for key in keys.values())
    assert total.tobytes() == net.tobytes()


@pytest.mark.parametrize("name", [n for n in ARKIT_NAMES if n != "tongueOut"])
def test_key_moves_what_it_names_and_nothing_else(name, keys, places):
    uv, place = places
    moved = movement(keys[name], uv)
    prefix = next(p for p in ALLOWED if name.startswith(p))
    far = ~np.isin(place, list(ALLOWED[prefix]))
    assert moved.max() > 0.5, "moves nothing"
    assert moved[far].max(initial=0) < 0.12 * moved.max()
    energy = moved**2 / (moved**2).sum()
    if name.startswith("eye"):
        assert uv[moved > 0.3 * moved.max(), 1].max() < 0.55
    if name.startswith(("jaw", "mouth")):
        assert energy[uv[:, 1] > 0.4].sum() > 0.95
    if name.startswith("brow"):
        assert energy[uv[:, 1] < 0.32].sum() > 0.95


@pytest.mark.parametrize(
    "name", [n for n in ARKIT_NAMES if n.endswith("Left") and n not in SIDEWAYS]
)
def test_left_and_right_exclude_each_other_and_mirror(name, keys, places):
    uv, _ = places
    key, other = keys[name], keys[name.removesuffix("Left") + "Right"]
    moved = movement(key, uv)
    # The subject's left is x > 0, large u.
    assert moved[uv[:, 0] < 0.4].max() == 0
    assert uv[moved.argmax(), 0] > 0.5
    np.testing.assert_allclose(other[::-1] * (-1, 1, 1), key, atol=6e-2)


@pytest.mark.parametrize("name", ["jaw", "mouth"])
def test_sideways_keys_go_to_the_side_that_they_name(name, keys):
    for side, sign in (("Left", 1), ("Right", -1)):
        moved = BSplineSurface(keys[f"{name}{side}"]).evaluate(0.5, 0.66)
        assert sign * moved[0] > 3 * max(abs(moved[1]), 0.3)


def test_directions(keys):
    marks = load_template().landmark_uv

    def at(name, landmark):
        return BSplineSurface(keys[name]).evaluate(*marks[landmark])

    assert at("jawOpen", 152)[1] < -15 and abs(at("jawOpen", 152)[0]) < 1e-2
    assert at("jawForward", 152)[2] > 4
    assert at("browInnerUp", 107)[1] > 2 and at("browDownRight", 107)[1] < -2
    assert at("mouthSmileLeft", 291)[1] > 3 and at("mouthFrownLeft", 291)[1] < -2
    assert at("mouthStretchRight", 61)[0] < -3 and at("mouthPucker", 61)[0] > 2
    assert at("noseSneerLeft", 358)[1] > 0.5
    assert at("cheekPuff", 50)[2] > 2


@pytest.mark.parametrize("seed", [None, 0, 4])
def test_a_blink_closes_the_eye_of_everybody_along_its_whole_length(seed):
    template = load_template()
    net = template.surface.control_points
    if seed is not None:
        weight = np.random.default_rng(seed).normal(size=len(template.identity_modes))
        net = net + np.tensordot(weight.clip(-2, 2), template.identity_modes, 1)
    surface = BSplineSurface(net)
    blink = arkit_keys(face(surface))["eyeBlinkLeft"]
    closed = BSplineSurface(net + blink)
    lids = lid_slit(face_units().lids_uv[1])
    share = np.linspace(0, 1, 50)
    upper, lower = (along(bank, share).T for bank in (lids.upper, lids.lower))
    was = surface.evaluate(*upper) - surface.evaluate(*lower)
    now = closed.evaluate(*upper) - closed.evaluate(*lower)
    assert was[:, 1].max() > 6
    # Just over and in front of the lower lid, never short of it by a visible slit.
    assert now[:, 1].min() > -1.0 and now[:, 1].max() < 0.25
    assert now[:, 2].min() > -0.4 and now[:, 2].max() < 1.3


@pytest.mark.parametrize(
    "names",
    [
        ("eyeBlinkLeft", "eyeSquintLeft"),
        ("eyeBlinkLeft", "eyeBlinkRight", "cheekSquintLeft", "cheekSquintRight"),
        ("mouthSmileLeft", "mouthSmileRight", "browInnerUp"),
        ("mouthFunnel", "mouthPucker"),
        ("browDownLeft", "eyeSquintLeft", "noseSneerLeft"),
    ],
)
def test_keys_add_up_without_folds(names, keys, places):
    """The skin keeps its side: no normal turns over, away from lid margins and lips."""
    template = load_template()
    uv, place = places
    # Skin that is no lid or lip margin: there the sheet closes over eye and mouth.
    units = face_units()
    margins = np.concatenate([*units.lids_uv, units.lips_uv])
    keep = cKDTree(margins).query(uv)[0] > 0.03
    keep &= template.is_skin(uv)
    eyes = np.concatenate(units.lids_uv).reshape(2, -1, 2)
    for loop in eyes:
        inside = (np.abs(uv - loop.mean(0)) < np.ptp(loop, axis=0) / 2).all(1)
        keep &= ~inside
    net = template.surface.control_points + sum(keys[n] for n in names)
    turned = BSplineSurface(net).normals(*uv[keep].T)
    cosine = (turned * template.surface.normals(*uv[keep].T)).sum(1)
    assert cosine.min() > 0


def test_closing_the_mouth_of_an_open_jaw_closes_it(keys):
    units = face_units()
    jump = dict(zip(ARKIT_NAMES, units.jumps, strict=True))

    def gap(points):
        net = np.zeros_like(keys["jawOpen"])
        (i, j), (a, b) = units.jump_first, points.shape[:2]
        net[i : i + a, j : j + b] = points
        return BSplineSurface(net).evaluate(*units.lips_uv.T)

    opened = np.linalg.norm(gap(jump["jawOpen"]), axis=1)
    closed = np.linalg.norm(gap(jump["jawOpen"] + jump["mouthClose"]), axis=1)
    assert opened.max() > 20 and closed.max() < 0.08 * opened.max()
    assert opened[[0, -1]].max() < 0.05 * opened.max(), "the corners stay closed"


@pytest.mark.parametrize("shape", [(30, 28), (50, 46)])
def test_keys_fit_every_size_of_net(shape, keys, places):
    uv, _ = places
    small = arkit_keys(face(load_template().surface.resampled(shape)))
    for name in ("jawOpen", "eyeBlinkLeft", "browInnerUp", "tongueOut"):
        assert small[name].shape == (*shape, 3)
        off = BSplineSurface(small[name]).evaluate(*uv.T)
        off -= BSplineSurface(keys[name]).evaluate(*uv.T)
        most = movement(keys[name], uv).max()
        assert np.sqrt((off**2).sum(1).mean()) <= 0.05 * most


def test_keys_scale_with_the_person(keys):
    surface = load_template().surface
    for name, key in arkit_keys(face(surface.transformed(1.3))).items():
        np.testing.assert_allclose(key, 1.3 * keys[name], atol=1e-9)


def test_a_wider_eye_blinks_further(keys):
    """Only the blink of that eye changes: the lid has further to go."""
    surface, units = load_template().surface, face_units()
    upper = LIDS["Left"][0]
    bump = keys["eyeWideLeft"]
    wider = arkit_keys(face(BSplineSurface(surface.control_points + bump)))
    assert BSplineSurface(bump).evaluate(*units.landmark_uv[upper])[1] > 1
    ratio = wider["eyeBlinkLeft"].min() / keys["eyeBlinkLeft"].min()
    assert 1.1 < ratio < 2
    for name in ("jawOpen", "eyeBlinkRight"):
        np.testing.assert_allclose(wider[name], keys[name], rtol=5e-3, atol=5e-3)


def test_a_face_of_another_template_is_refused():
    template = load_template()
    other = replace(template, landmark_uv=template.landmark_uv**1.05)
    with pytest.raises(ReconstructionError, match="template of its own"):
        arkit_keys(SimpleNamespace(surface=template.surface, template=other))
