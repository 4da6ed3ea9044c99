"""The template: what the bundled one promises, and files that are none."""

import io
import json
import os
import pickle
import zipfile

import numpy as np
import pytest
from bsface.surface.bspline import BSplineSurface
from bsface.surface.template import BUNDLED, load_template
from hypothesis import given, settings
from hypothesis import strategies as st

FLIP = np.array([-1.0, 1, 1])


@pytest.fixture(scope="module")
def template():
    return load_template()


@pytest.fixture(scope="module")
def arrays():
    with np.load(BUNDLED, allow_pickle=False) as z:
        return {name: z[name] for name in z.files}


# --- the bundled template ------------------------------------------------------------


def test_frame(template):
    """Eyes on the x axis about the origin, the right one first."""
    right, left = template.eye_centres
    np.testing.assert_allclose(right, -left, atol=1e-6)
    assert left[0] > 0
    np.testing.assert_allclose(left[1:], 0, atol=1e-6)
    assert template.eye_distance == pytest.approx(2 * left[0])
    # a person, in millimetres
    assert 50 < template.eye_distance < 75


def test_face_looks_at_the_camera(template):
    uv = np.random.default_rng(0).random((3000, 2))
    middle = template.inside(uv) & (np.abs(uv - 0.5) < 0.25).all(1)
    normals = template.surface.normals(*uv[middle].T)
    assert middle.sum() > 100
    assert normals[:, 2].mean() > 0.7
    xyz = template.surface.evaluate(*uv[middle].T)
    # u runs to the right, v down
    assert np.corrcoef(uv[middle][:, 0], xyz[:, 0])[0, 1] > 0.9
    assert np.corrcoef(uv[middle][:, 1], xyz[:, 1])[0, 1] < -0.9
    nose = template.landmark_xyz[:, 2].argmax()
    assert abs(template.landmark_xyz[nose, 0]) < 2


def test_landmarks_lie_on_the_face(template):
    assert template.inside(template.landmark_uv[template.landmark_reliable]).all()
    on = template.surface.evaluate(*template.landmark_uv.T)
    away = np.linalg.norm(on - template.landmark_xyz, axis=1)
    assert np.median(away[template.landmark_reliable]) < 3
    assert (template.landmark_sigma > 0).all()
    assert template.landmark_weight.max() == 1
    assert template.landmark_weight.min() > 0


def test_mirror_symmetry(template):
    mirror = template.landmark_mirror
    assert np.array_equal(mirror[mirror], np.arange(468))
    on = template.surface.evaluate(*template.landmark_uv.T)
    np.testing.assert_allclose(on[mirror] * FLIP, on, atol=1.0)
    np.testing.assert_allclose(
        template.landmark_uv[mirror] * (-1, 1) + (1, 0), template.landmark_uv, atol=5e-3
    )
    b = template.surface.control_points
    np.testing.assert_allclose(b[::-1] * FLIP, b, atol=1.5)
    reliable = template.landmark_reliable
    assert (reliable[mirror] == reliable).mean() > 0.95


def test_schemes(template):
    for name, indices in template.schemes.items():
        assert len(indices) == len(set(indices.tolist())) == int(name)
        assert indices.min() >= 0
        assert indices.max() < 468
    # iBUG order: 36 to 41 right eye, 42 to 47 left eye, 30 tip of the nose, 8 chin
    x, y = template.landmark_xyz[template.schemes["68"], :2].T
    assert (x[36:42] < 0).all()
    assert (x[42:48] > 0).all()
    assert y[8] == y.min()
    assert template.landmark_xyz[template.schemes["68"], 2].argmax() == 30


def test_most_of_the_face_is_skin(template):
    assert 0.8 < template.skin.mean() < 1
    right, left = template.eye_centres
    uv, _ = template.surface.closest_point([right, left])
    assert not template.is_skin(uv).any()
    assert template.is_skin([[0.5, 0.2], [0.3, 0.5]]).all()
    assert template.is_skin([[0.0, 0.0], [1.0, 1.0], [1 + 1e-12, 0.5]]).all()


@pytest.mark.parametrize("asked", ["inside", "is_skin"])
def test_nothing_is_beyond_the_square(template, asked):
    beyond = [-0.2, 1.3, np.nan, np.inf, -np.inf, 1e300]
    uv = [[x, 0.5] for x in beyond] + [[0.5, x] for x in beyond]
    found = getattr(template, asked)([*uv, [0.5, 0.5]])
    assert not found[:-1].any() and found[-1]
    assert getattr(template, asked)([]).shape == (0,)
    for wrong in (0.5, [0.5], [0.5, 0.5, 0.5], ["a", "b"], None):
        with pytest.raises(ValueError, match="uv must"):
            getattr(template, asked)(wrong)


@given(x=st.floats(-0.5, 1.5), y=st.floats(-0.5, 1.5), turn=st.integers(0, 159))
@settings(max_examples=40)
def test_inside_is_the_winding_number(template, x, y, turn):
    polygon = np.roll(template.outline_uv, turn, axis=0)
    to = polygon - (x, y)
    angle = np.arctan2(to[:, 1], to[:, 0])
    step = np.diff(np.append(angle, angle[0]))
    step = (step + np.pi) % (2 * np.pi) - np.pi
    winding = round(abs(step.sum()) / (2 * np.pi))
    edge = np.roll(polygon, -1, 0) - polygon
    along = np.clip(-(to * edge).sum(1) / (edge**2).sum(1), 0, 1)[:, None]
    if np.linalg.norm(to + along * edge, axis=1).min() > 1e-9:
        assert bool(template.inside([x, y])) == (winding == 1)


def test_inside_keeps_the_shape(template):
    for shape in ((), (5,), (3, 4)):
        assert template.inside(np.full((*shape, 2), 0.5)).shape == shape
    assert template.inside([0.5, 0.5])
    assert not template.inside([-0.1, 0.5])


def test_resampled(template):
    assert template.resampled(template.surface.shape) is template
    other = template.resampled((20, 24))
    assert other.surface.shape == (20, 24)
    assert other.identity_modes.shape[1:] == other.expression_modes.shape[1:]
    assert other.identity_modes.shape[1:] == (20, 24, 3)
    u, v = np.random.default_rng(0).random((2, 500))
    away = other.surface.evaluate(u, v) - template.surface.evaluate(u, v)
    assert np.sqrt((away**2).sum(1).mean()) < 1.5
    # the modes move points as they did
    before = BSplineSurface(template.identity_modes[0]).evaluate(u, v)
    after = BSplineSurface(other.identity_modes[0]).evaluate(u, v)
    assert np.abs(after - before).max() < 0.25 * np.abs(before).max()
    for wrong in ((20,), (), 20, (20, 24, 3), (20.5, 24), (True, 24), "ab", (3, 9)):
        with pytest.raises(ValueError, match="shape must be two whole numbers"):
            template.resampled(wrong)
    # what does not depend on the net is the same
    assert other.landmark_uv is template.landmark_uv


# --- files that are no template ------------------------------------------------------


def packed(arrays) -> bytes:
    out = io.BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()


class Hostile:
    """Unpickling this would leave a file behind."""

    def __init__(self, trace):
        self.trace = str(trace)

    def __reduce__(self):
        return os.mkdir, (self.trace,)


def broken_files(arrays, trace):
    """Name -> bytes of a file that is no template."""
    good = packed(arrays)
    plain = io.BytesIO()
    np.save(plain, np.zeros(3))
    hostile = np.empty(1, object)
    hostile[0] = Hostile(trace)
    objects = io.BytesIO()
    np.savez(objects, **{**arrays, "control_points": hostile})
    foreign = io.BytesIO()
    with zipfile.ZipFile(foreign, "w") as z:
        z.writestr("readme.txt", "nothing here")
    damaged = bytearray(good)
    damaged[len(good) // 3 : len(good) // 3 + 400] = b"\xff" * 400
    files = {
        "empty": b"",
        "text": b"not a template",
        "cut short": good[: len(good) // 2],
        "damaged": bytes(damaged),
        "zip magic only": b"PK\x03\x04" + bytes(60),
        "another zip": foreign.getvalue(),
        "bare array": plain.getvalue(),
        "pickle": pickle.dumps(Hostile(trace)),
        "pickled array": objects.getvalue(),
        "json": json.dumps({"control_points": []}).encode(),
    }
    for name in ("control_points", "landmark_uv", "skin", "scheme_68"):
        less = dict(arrays)
        del less[name]
        files[f"without {name}"] = packed(less)
    changes = {
        "net too small": ("control_points", np.zeros((3, 3, 3))),
        "net not finite": ("control_points", arrays["control_points"] * np.nan),
        "net without end": ("control_points", arrays["control_points"] * 1e300),
        "modes without end": (
            "identity_modes",
            arrays["identity_modes"].astype(float) + 1e160,
        ),
        "net of text": ("control_points", np.array(["a", "b"])),
        "landmarks too few": ("landmark_uv", arrays["landmark_uv"][:10]),
        "landmarks not finite": ("landmark_xyz", arrays["landmark_xyz"] + np.inf),
        "landmarks beside the face": ("landmark_uv", arrays["landmark_uv"] + 1),
        "sigma negative": ("landmark_free_sigma", -arrays["landmark_free_sigma"]),
        "scheme out of range": ("scheme_68", arrays["scheme_68"] + 460),
        "scheme of another size": ("scheme_40", arrays["scheme_40"][:39]),
        "outline of two points": ("outline_uv", arrays["outline_uv"][:2]),
        "modes of another net": ("identity_modes", np.zeros((2, 5, 5, 3))),
        "eyes at one place": ("eye_centres", np.zeros((2, 3))),
        "one eye": ("eye_centres", arrays["eye_centres"][:1]),
        "skin of one number": ("skin", np.array(1)),
    }
    for name, (key, value) in changes.items():
        files[name] = packed({**arrays, key: value})
    return files


@pytest.fixture(scope="module")
def small(arrays):
    """The template with few modes: its files are quick to write."""
    few = ("identity_modes", "expression_modes")
    return {k: v[:1] if k in few else v for k, v in arrays.items()}


def test_files_that_are_no_template_get_a_sentence(tmp_path, small):
    trace = tmp_path / "trace"
    for name, content in broken_files(small, trace).items():
        path = tmp_path / f"{name}.npz"
        path.write_bytes(content)
        with pytest.raises(ValueError) as caught:
            load_template(path)
        sentence = str(caught.value)
        assert path.name in sentence, name
        assert sentence.endswith("."), name
        assert "\n" not in sentence, name
        assert not trace.exists(), name


def test_missing_file_and_folder(tmp_path):
    for path in (tmp_path / "none.npz", tmp_path):
        with pytest.raises(ValueError, match="is not a template file") as caught:
            load_template(path)
        assert str(path) in str(caught.value)


def test_own_file_is_read(tmp_path, small):
    path = tmp_path / "own.npz"
    path.write_bytes(packed(small))
    own = load_template(path)
    assert own.surface.shape == load_template().surface.shape
    assert len(own.identity_modes) == 1
    path.write_bytes(packed({**small, "identity_modes": small["identity_modes"][:0]}))
    assert load_template(path).resampled((12, 12)).identity_modes.shape[0] == 0
