"""Landmark files: what is written is read, what is wrong is said in a sentence."""

import json

import numpy as np
import pytest
from bsface.errors import ReconstructionError
from bsface.landmarks.landmarks import (
    SCHEME_SIZES,
    LandmarkFileError,
    Landmarks,
    NotLandmarksError,
    landmark_file_beside,
    read_landmarks,
    write_landmarks,
)
from bsface.landmarks.plausibility import fit_face, judge_fit
from bsface.surface.template import load_template
from hypothesis import given, settings
from hypothesis import strategies as st

SIZE = (400, 300)


def points_like(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0, 300, (count, 2))


def pts_text(points, count=None) -> str:
    rows = "\n".join(f"{x} {y}" for x, y in points)
    return f"version: 1\nn_points: {count or len(points)}\n{{\n{rows}\n}}\n"


def json_text(points, scheme="68", **more) -> str:
    return json.dumps({"scheme": scheme, "points": np.asarray(points).tolist(), **more})


# --- round trips -------------------------------------------------------------


@given(
    scheme=st.sampled_from(sorted(SCHEME_SIZES)),
    seed=st.integers(0, 999),
    scale=st.floats(1e-3, 1e3),
)
@settings(max_examples=30, deadline=None)
def test_json_round_trip_is_exact(tmp_path_factory, scheme, seed, scale):
    rng = np.random.default_rng(seed)
    count = SCHEME_SIZES[scheme]
    given_ = Landmarks(
        "a.jpg", scheme, rng.normal(size=(count, 2)) * scale, rng.uniform(size=count)
    )
    path = tmp_path_factory.mktemp("json") / "a.json"
    write_landmarks(path, given_, SIZE)
    found = read_landmarks(path, "a.jpg", SIZE)
    np.testing.assert_array_equal(found.points, given_.points)
    np.testing.assert_array_equal(found.weight, given_.weight)
    assert (found.scheme, found.photo, found.source) == (scheme, "a.jpg", "file")


def test_pts_round_trip(tmp_path):
    given_ = Landmarks("a.jpg", "68", points_like(68), np.ones(68))
    write_landmarks(tmp_path / "a.pts", given_)
    found = read_landmarks(tmp_path / "a.pts")
    np.testing.assert_allclose(found.points, given_.points, atol=1e-12)


def test_pts_counts_pixels_from_one(tmp_path):
    """The centre of the first pixel is (1, 1) in the file and (0, 0) here."""
    points = points_like(68)
    points[0] = (1, 1)
    (tmp_path / "a.pts").write_text(pts_text(points))
    assert tuple(read_landmarks(tmp_path / "a.pts").points[0]) == (0, 0)


def test_pts_of_other_programs(tmp_path):
    rows = "\r\n".join(f"  {x:.3f},\t{y:.3f} " for x, y in points_like(68))
    text = f"\ufeffversion: 1\r\nn_points:68\r\n{{\r\n{rows}\r\n}}"
    (tmp_path / "a.pts").write_text(text, encoding="utf-8")
    found = read_landmarks(tmp_path / "a.pts")
    np.testing.assert_allclose(found.points, points_like(68) - 1, atol=1e-3)


def test_only_scheme_68_is_written_as_pts(tmp_path):
    landmarks = Landmarks("a", "40", points_like(40), np.ones(40))
    with pytest.raises(ValueError, match="json"):
        write_landmarks(tmp_path / "a.pts", landmarks)
    assert list(tmp_path.iterdir()) == []


def test_failed_write_leaves_the_old_file(tmp_path):
    path = tmp_path / "a.json"
    path.mkdir()  # cannot be replaced by a file
    with pytest.raises(ReconstructionError, match="is a folder"):
        write_landmarks(path, Landmarks("a", "40", points_like(40), np.ones(40)))
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


def test_file_beside(tmp_path):
    photo = tmp_path / "me 1.JPG"
    assert landmark_file_beside(photo) is None
    (tmp_path / "me 1.json").touch()
    assert landmark_file_beside(photo) == tmp_path / "me 1.json"
    (tmp_path / "me 1.pts").touch()
    assert landmark_file_beside(photo) == tmp_path / "me 1.pts"
    (tmp_path / "me 1.pts").rename(tmp_path / "me 1.PTS")
    assert landmark_file_beside(photo).name.lower() == "me 1.pts"


# --- wrong files -------------------------------------------------------------

POINTS = points_like(68)
WITH_NAN = POINTS.copy()
WITH_NAN[3, 1] = np.nan
WITH_INF = POINTS.copy()
WITH_INF[3, 1] = np.inf
HUGE = POINTS.copy()
HUGE[3, 1] = 1e30

WRONG = {
    "empty.pts": ("", "braces"),
    "binary.pts": ("\x00\x01{1 2 3}", "two numbers"),
    "few.pts": (pts_text(POINTS[:67]), "67"),
    "many.pts": (pts_text(points_like(69)), "69"),
    "says.pts": (pts_text(POINTS, 70), "announces 70"),
    "what.pts": (pts_text(POINTS, "many"), "many"),
    "three.pts": (pts_text(POINTS).replace("\n}", " 5\n}"), "two numbers"),
    "nan.pts": (pts_text(WITH_NAN), "finite"),
    "huge.pts": (pts_text(HUGE), "no picture"),
    "empty.json": ("", "JSON"),
    "cut.json": (json_text(POINTS)[:100], "JSON"),
    "deep.json": ("[" * 100000, "JSON"),
    "scheme.json": (json_text(POINTS, "70"), "scheme"),
    "no_scheme.json": ('{"points": []}', "scheme"),
    "no_points.json": ('{"scheme": "68"}', "points"),
    "list.json": ('{"scheme": ["68"], "points": []}', "scheme"),
    "count.json": (json_text(POINTS[:40]), "40 points"),
    "other_count.json": (json_text(POINTS, "468"), "468"),
    "text.json": ('{"scheme": "68", "points": ["a"]}', "numbers"),
    "ragged.json": ('{"scheme": "68", "points": [[1, 2], [3]]}', "numbers"),
    "null.json": ('{"scheme": "68", "points": null}', "numbers"),
    "bool.json": (json_text(np.ones((68, 2), bool)), "numbers"),
    "triples.json": (json_text(np.ones((68, 3))), "pairs"),
    "nan.json": (json_text(WITH_NAN), "finite"),
    "inf.json": (json_text(WITH_INF), "finite"),
    "huge.json": (json_text(HUGE), "no picture"),
    "long.json": (
        '{"scheme": "68", "points": [[1' + "0" * 400 + ", 1]]}",
        "numbers",
    ),
    "weights.json": (json_text(POINTS, weights=[1.0]), "weights"),
    "negative.json": (json_text(POINTS, weights=[-1.0] * 68), "weights"),
    "weightless.json": (json_text(POINTS, weights=[0.0] * 68), "weight 0"),
    "size.json": (json_text(POINTS, image_size=[40, 30]), "400 x 300"),
    "size_text.json": (json_text(POINTS, image_size="x" * 500), "400 x 300"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_file_gives_one_sentence_with_its_name(tmp_path, name):
    text, words = WRONG[name]
    (tmp_path / name).write_text(text)
    with pytest.raises(LandmarkFileError) as info:
        read_landmarks(tmp_path / name, "a.jpg", SIZE)
    sentence = str(info.value)
    assert sentence.startswith(name)
    assert words in sentence
    assert sentence.endswith(".")
    assert "\n" not in sentence
    assert len(sentence) < 200


def test_json_files_of_other_programs_are_known_as_such(tmp_path):
    for text in ("[1, 2]", "{}", '{"camera": "X100"}', "3"):
        (tmp_path / "a.json").write_text(text)
        with pytest.raises(NotLandmarksError):
            read_landmarks(tmp_path / "a.json")


def test_unreadable_files(tmp_path):
    with pytest.raises(LandmarkFileError, match=r"none\.pts cannot be read"):
        read_landmarks(tmp_path / "none.pts")
    (tmp_path / "bytes.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(LandmarkFileError, match="not text"):
        read_landmarks(tmp_path / "bytes.json")
    (tmp_path / "large.json").write_bytes(b" " * 1_000_001)
    with pytest.raises(LandmarkFileError, match="too large"):
        read_landmarks(tmp_path / "large.json")


json_value = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(
            st.sampled_from(["scheme", "points", "weights", "image_size"]), inner
        )
    ),
    max_leaves=20,
)


@given(value=json_value)
@settings(max_examples=200, deadline=None)
def test_any_json_is_landmarks_or_a_sentence(tmp_path_factory, value):
    path = tmp_path_factory.getbasetemp() / "any.json"
    path.write_text(json.dumps(value))
    with pytest.raises(LandmarkFileError):
        read_landmarks(path, "a", SIZE)


@given(text=st.text(alphabet="0123456789.-+einfa:{} \n\t,npoits_", max_size=400))
@settings(max_examples=200, deadline=None)
def test_any_pts_text_is_landmarks_or_a_sentence(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "any.pts"
    path.write_text(text)
    with pytest.raises(LandmarkFileError):
        read_landmarks(path)


@given(
    line=st.integers(0, 67),
    word=st.sampled_from(["nan", "1e400", "-inf", "1e7", "x", "", "1_0 2 3", "٣"]),
)
@settings(max_examples=60, deadline=None)
def test_one_wrong_number_in_a_pts_file_is_found(tmp_path_factory, line, word):
    rows = [f"{x} {y}" for x, y in POINTS]
    rows[line] = f"{word} {word}"
    path = tmp_path_factory.getbasetemp() / "one.pts"
    path.write_text("{\n" + "\n".join(rows) + "\n}", encoding="utf-8")
    if word == "٣":  # a digit three: Python reads it, and why not
        assert read_landmarks(path).points[line, 0] == 2
        return
    with pytest.raises(LandmarkFileError):
        read_landmarks(path)


def test_landmarks_check_their_shape():
    with pytest.raises(ValueError, match="68 points"):
        Landmarks("a", "68", np.zeros((67, 2)), np.ones(67))
    with pytest.raises(ValueError, match="scheme"):
        Landmarks("a", "70", np.zeros((70, 2)), np.ones(70))


# --- plausibility ------------------------------------------------------------

TEMPLATE = load_template()


def projected(scheme: str, yaw=0.0, pitch=0.0, roll=0.0, scale=1.0, shift=(200, 150)):
    """Landmarks of the template in a scaled orthographic camera; angles in degrees."""
    a, b, c = np.deg2rad([yaw, pitch, roll])
    ry = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    rx = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    rz = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
    xyz = TEMPLATE.landmark_xyz[TEMPLATE.schemes[scheme]] @ (rz @ rx @ ry).T
    return xyz[:, :2] * (scale, -scale) + shift


def judged(points, scheme="468", source="file"):
    index = TEMPLATE.schemes[scheme]
    fit = fit_face(
        TEMPLATE.landmark_xyz[index],
        points,
        TEMPLATE.landmark_reliable[index].astype(float),
        TEMPLATE.eye_distance,
    )
    landmarks = Landmarks("a.jpg", scheme, points, np.ones(len(points)), source)
    return fit, judge_fit(fit, landmarks, SIZE)


@pytest.mark.parametrize("scheme", sorted(SCHEME_SIZES))
@given(
    yaw=st.floats(-60, 60),
    pitch=st.floats(-30, 30),
    roll=st.floats(-100, 100),
    scale=st.floats(0.4, 3),
)
@settings(max_examples=40, deadline=None)
def test_fit_finds_size_and_roll_of_any_view(scheme, yaw, pitch, roll, scale):
    fit, failure = judged(projected(scheme, yaw, pitch, roll, scale), scheme)
    assert failure is None
    assert fit.residual < 1e-9
    assert fit.stretch == pytest.approx(1, abs=1e-6)
    assert fit.eye_distance == pytest.approx(scale * TEMPLATE.eye_distance, rel=1e-6)
    assert not fit.flipped
    if yaw == pitch == 0:
        assert fit.roll == pytest.approx(-roll, abs=1e-6)


@pytest.mark.parametrize("scheme", sorted(SCHEME_SIZES))
def test_swapped_flipped_and_scattered_landmarks_are_refused(scheme):
    good = projected(scheme, 20, 5, 3, 1.5)
    for wrong, words in [
        (good[:, ::-1], "swapped"),
        (good * (-1, 1) + (400, 0), "mirrored"),
        (400 - good, "upside down"),
        (np.random.default_rng(2).permutation(good), ""),
        (np.full_like(good, 100.0), "at one place"),
        (good + (1000, 0), "outside"),
        (np.column_stack([good[:, 0], 0 * good[:, 0] + 50]), ""),
    ]:
        _, failure = judged(wrong, scheme)
        assert failure is not None
        assert failure.code in ("implausible", "small_face")
        assert words in failure.reason
        assert "a.jpg" in failure.reason


def test_small_face_is_told_with_its_size():
    _, failure = judged(projected("468", scale=0.2))
    assert failure is not None
    assert failure.code == "small_face"
    assert "12 pixels" in failure.reason


def test_landmarks_are_real_numbers_whatever_they_came_in():
    points = np.arange(136).reshape(68, 2)
    marks = Landmarks("a.jpg", "68", points.tolist(), [1] * 68)
    assert marks.points.dtype == marks.weight.dtype == float
    for bad in (points.astype(str), points.astype(object), points * 1j):
        with pytest.raises(ValueError, match="real numbers"):
            Landmarks("a.jpg", "68", bad, np.ones(68))


def spoiled(points=None, weight=None):
    good = points_like(68)
    weights = np.ones(68)
    if points is not None:
        good[3, 1] = points
    if weight is not None:
        weights[:] = weight
    return Landmarks("a", "68", good, weights)


@pytest.mark.parametrize("ending", ["json", "pts"])
@pytest.mark.parametrize(
    "change, words",
    [
        ({"points": np.nan}, "not a finite number"),
        ({"points": np.inf}, "not a finite number"),
        ({"points": 1e9}, "no picture has"),
        ({"weight": -1.0}, "weights outside"),
        ({"weight": np.nan}, "weights outside"),
        ({"weight": 1e9}, "weights outside"),
        ({"weight": 0.0}, "the weight 0"),
    ],
)
def test_what_would_not_be_read_is_not_written(tmp_path, ending, change, words):
    with pytest.raises(LandmarkFileError, match=words):
        write_landmarks(tmp_path / f"a.{ending}", spoiled(**change))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "indices", [[9999] * 68, [-1] * 68, [0.5] * 68, [True] * 68, 3, ["a"] * 68]
)
def test_points_that_are_not_there_make_no_subset(indices):
    with pytest.raises(ValueError, match="indices must be"):
        spoiled().subset("68", indices)
