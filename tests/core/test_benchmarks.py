"""The benchmarks' own arithmetic, on faces whose numbers are known beforehand."""

import csv
import importlib
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from bsface.camera.camera import Camera
from bsface.drawing.pictures import colour_map, write_png
from bsface.landmarks.landmarks import Landmarks
from bsface.settings import Settings
from bsface.surface.bspline import BSplineSurface
from bsface.surface.template import load_template
from scipy.spatial.transform import Rotation

FOLDER = Path(__file__).resolve().parents[2] / "benchmarks"
sys.path.insert(0, str(FOLDER))

_ablation = importlib.import_module("_ablation")
_compare = importlib.import_module("_compare")
_faces = importlib.import_module("_faces")
_meshes = importlib.import_module("_meshes")
_methods = importlib.import_module("_methods")
_page = importlib.import_module("_page")
_reliability = importlib.import_module("_reliability")
_sets = importlib.import_module("_sets")
_speed_worker = importlib.import_module("_speed_worker")
_table = importlib.import_module("_table")
speed = importlib.import_module("speed")
identity = importlib.import_module("identity")


@pytest.fixture(scope="module")
def template():
    return load_template()


@pytest.fixture(scope="module")
def one_set(template):
    """A set whose ground truth is the template itself."""
    face = _faces.surface_face(template.surface, template)
    marks = template.landmark_uv[template.schemes["68"]]
    grid = template.surface.grid(_faces.SAMPLES, _faces.SAMPLES).reshape(-1, 3)
    nearest = [
        int(np.linalg.norm(grid - x, axis=1).argmin())
        for x in template.surface.evaluate(*marks.T)
    ]
    mask = np.zeros(len(face.points), bool)
    mask[face.drawn] = True
    truth = {
        "vertices": face.points,
        "triangles": face.triangles,
        "mask": mask,
        "landmark_indices": np.array(nearest),
        "eye_distance_mm": np.array(template.eye_distance),
    }
    return _sets.FaceSet("fake/S1", Path("fake"), truth)


def test_table_shows_numbers_in_line_and_dashes_for_what_is_missing():
    rows = [
        {"method": "first", "mean": 1.5, "used": 0.975},
        {"method": "the second", "mean": float("nan")},
    ]
    columns = (("mean", "mean %", ".2f"), ("used", "used", ".0%"))
    lines = _table.text_table(rows, columns, [("method", "method")]).splitlines()
    assert lines == [
        "method      mean %  used",
        "first         1.50   98%",
        "the second       -     -",
    ]


def test_csv_holds_all_columns_of_all_rows(tmp_path):
    path = tmp_path / "rows.csv"
    rows = [
        {"set": "a", "mean": np.float64(1.25), "note": ""},
        {"set": "b", "note": "failed, with a comma", "seconds": float("nan")},
    ]
    _table.write_csv(path, rows)
    with path.open(newline="") as file:
        read = list(csv.DictReader(file))
    assert read[0] == {"set": "a", "mean": "1.25", "note": "", "seconds": ""}
    assert read[1]["note"] == "failed, with a comma"
    assert read[1]["seconds"] == ""


def test_a_failure_spoils_the_mean_of_its_method():
    rows = [
        {"method": "a", "mean": 1.0},
        {"method": "b", "mean": 1.0},
        {"method": "a", "mean": 3.0},
        {"method": "b", "note": "failed"},
    ]
    a, b = _table.averages(rows, ["mean"], "method")
    assert (a["method"], a["sets"], a["mean"]) == ("a", 2, 2.0)
    assert np.isnan(b["mean"])


def test_true_deviations_lie_on_the_diagonal():
    random = np.random.default_rng(0)
    deviation = random.uniform(0.2, 2.0, 40_000)
    error = np.abs(random.normal(size=40_000)) * deviation
    (row,) = _reliability.compare("s", "m", deviation, error, np.ones(40_000))
    for level in _reliability.LEVELS:
        assert row[f"within {level:.0%}"] == pytest.approx(level, abs=0.01)
    for k in range(_reliability.PARTS):
        assert row[f"is {k + 1}"] == pytest.approx(row[f"said {k + 1}"], rel=0.03)
    assert "95%" in _reliability.reliability_table([row])


def test_areas_count_only_what_counts(one_set):
    area = one_set.areas()
    assert area.sum() == pytest.approx(1)
    assert (area[~one_set.truth["mask"]] == 0).all()


def test_normals_of_a_plane_and_their_side():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]])
    normals = _faces.vertex_normals(points, np.array([[0, 1, 2], [1, 3, 2]]))
    np.testing.assert_allclose(normals, np.tile([0.0, 0.0, 1.0], (4, 1)))


def test_error_map_has_the_colour_of_the_error(one_set):
    truth = one_set.face()
    (view,) = _faces.views_of(truth, [0.0], 60)
    picture = _faces.draw_values(truth, np.full(len(truth.points), 2.5), 5.0, view)
    facing = picture[28:32, picture.shape[1] // 2].astype(int)
    wanted = colour_map(np.array([2.5]), 0.0, 5.0, "magma")[0].astype(int)
    assert (np.abs(facing - wanted) <= 0.21 * wanted + 1).all()
    assert (picture[0] == 255).all()


def test_score_and_page(one_set, template, tmp_path):
    n = len(one_set.truth["vertices"])
    error = np.where(one_set.truth["mask"], 0.5, np.nan)
    answer = {f"{k}_pct": 1.0 for k in ("mean", "median", "rms", "std", "p90")}
    answer |= {
        "normal_error_deg": 4.0,
        "error_mm": error,
        "transform": {"scale": 1.0, "R": np.eye(3).tolist(), "t": [0, 0, 0]},
    }
    asked = {}

    def evaluate(points, gt, triangles, landmarks):
        asked.update(points=points, landmarks=landmarks)
        return answer

    face = _methods.run("template", None, template, Settings()).face
    found = _sets.score(SimpleNamespace(evaluate=evaluate), face, one_set)
    assert np.isnan(asked["landmarks"][:17]).all()
    assert np.isfinite(asked["landmarks"][17:]).all()
    assert found.error.shape == (n,)
    assert np.nanmax(found.error) == pytest.approx(50 / template.eye_distance)

    pictures = _page.set_pictures(one_set, {"template": (face, found)})
    rows = [{"set": "fake/S1", "method": "template", "mean": 1.0, "note": "<b>"}]
    path = tmp_path / "accuracy.html"
    _page.write_page(path, rows, [pictures], Settings())
    text = path.read_text("utf-8")
    sources = re.findall(r'src="([^"]{10})', text)
    assert len(sources) == 1 + 5 + 3
    assert set(sources) == {"data:image"}
    assert "<b>" not in text


def test_a_method_that_fails_says_so(template):
    nobody = SimpleNamespace(photos=(), landmarks=(), failures=())
    outcome = _methods.run("default", nobody, template, Settings())
    assert outcome.face is None
    assert "No photo" in outcome.note


def test_sets_are_found_by_their_layout(tmp_path):
    for name in ("b/S1", "a/S5", "a/S1", "a-lambert/S1"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "ground_truth.npz").touch()
    (tmp_path / "c" / "S1").mkdir(parents=True)
    assert _sets.find_sets(tmp_path) == ["a/S1", "a/S5", "b/S1"]
    assert _sets.find_sets(tmp_path, ["a-lambert/S1"]) == ["a-lambert/S1"]
    with pytest.raises(SystemExit, match="no set c/S1"):
        _sets.find_sets(tmp_path, ["c/S1"])
    with pytest.raises(SystemExit, match=r"evaluate\.py is missing"):
        _sets.load_measure(tmp_path)


VARIANTS = [variant for group in _ablation.GROUPS.values() for variant in group]


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda v: v.name)
def test_every_variant_changes_something_that_exists(variant):
    changed = variant.changed(Settings())
    differs = changed != Settings() or variant.landmarks != "468" or variant.photos
    assert differs or variant.parts


def test_draws_of_photos_are_repeatable_and_of_the_right_size():
    first = _ablation.draws(40, 5)
    assert [len(set(chosen)) for chosen in first] == [5] * _ablation.DRAWS
    assert all(
        (a == b).all() for a, b in zip(first, _ablation.draws(40, 5), strict=True)
    )
    for count in (0, 40, 50):
        (chosen,) = _ablation.draws(40, count)
        assert (chosen == np.arange(40)).all()


def test_within_and_between():
    found = _compare.within_between(
        [0.0, 10.0, 20.0], [1.0, 12.0, 9.0], lambda a, b: abs(a - b)
    )
    # 20 is nearest to 12, and 9 to 10: only the first person is matched.
    assert found["matched"] == 1
    assert found["within"] == pytest.approx((1 + 2 + 11) / 3)
    assert found["within_max"] == 11
    assert found["between_min"] == 1


def test_a_face_has_no_distance_to_its_own_similar_copy(template):
    R = Rotation.from_euler("yx", [20, -10], degrees=True).as_matrix()
    surface = template.surface
    copy = surface.transformed(1.3, R, np.array([5.0, -8.0, 2.0]))
    uv = _compare.face_parameters(template, 15)
    assert _compare.surface_distance(surface, copy, uv, 62) < 1e-6
    marks = template.landmark_uv
    a, b = surface.evaluate(*marks.T), copy.evaluate(*marks.T)
    assert _compare.point_distance(a, b, 62) < 1e-9


def test_point_distance_counts_sliding_and_surface_distance_does_not():
    # Two planes with other parameters on the same square.
    x = (np.arange(12) - 1.0) / 9
    u, v = np.meshgrid(x, x, indexing="ij")
    plane = BSplineSurface(np.stack([100 * u, -100 * v, 0 * u], -1))
    bent = u + 0.1 * u * (1 - u)
    slid = BSplineSurface(np.stack([100 * bent, -100 * v, 0 * u], -1))
    uv = np.stack(np.meshgrid([0.3, 0.5, 0.7], [0.3, 0.5, 0.7]), -1).reshape(-1, 2)
    assert _compare.surface_distance(plane, slid, uv, 62) < 1e-6
    a, b = plane.evaluate(*uv.T), slid.evaluate(*uv.T)
    assert _compare.point_distance(a, b, 62) > 0.05


def test_mean_of_similar_copies_is_the_mesh_itself():
    random = np.random.default_rng(1)
    mesh = random.normal(size=(30, 3))
    copies = [
        random.uniform(0.5, 2) * mesh @ Rotation.random(random_state=k).as_matrix()
        + random.normal(size=3)
        for k in range(4)
    ]
    mean = _meshes.procrustes_mean(copies)
    assert _compare.point_distance(mesh, mean, 1.0) < 1e-9


def test_mesh_of_the_template_keeps_its_size(template):
    mesh = 0.01 * template.landmark_xyz
    scaled = _meshes.scaled_to_eyes(mesh, template, template.eye_distance)
    np.testing.assert_allclose(scaled, template.landmark_xyz)


def test_landmarks_move_with_the_face(template):
    there = _compare.landmark_points(template.surface, template)
    np.testing.assert_allclose(there, template.landmark_xyz, atol=1e-9)
    R = Rotation.from_euler("y", 30, degrees=True).as_matrix()
    t = np.array([1.0, 2.0, 3.0])
    moved = template.surface.transformed(0.5, R, t)
    np.testing.assert_allclose(
        _compare.landmark_points(moved, template),
        0.5 * template.landmark_xyz @ R.T + t,
        atol=1e-9,
    )


def test_pose_of_an_exact_picture_is_found(template):
    R = Rotation.from_euler("yxz", [25, -10, 5], degrees=True).as_matrix()
    middle = np.array([199.5, 149.5])
    camera = Camera(R, 1.7, np.array([12.0, -20.0]), 1 / 1200, middle)
    Q = template.landmark_xyz
    marks = Landmarks("p", "468", camera.project(Q), np.ones(468))
    found = _compare.pose_only(Q, marks, (400, 300), np.ones(468), 1200.0)
    np.testing.assert_allclose(found.R, R, atol=1e-6)
    assert found.s == pytest.approx(1.7, rel=1e-6)
    away = _compare.held_out_residual(Q, marks, (400, 300), np.ones(468), 100, 1200.0)
    assert away < 1e-5


def test_stages_end_when_they_were_last_heard_of():
    ticks = iter((float(k), 10.0 * k) for k in range(9))
    times = _speed_worker.StageTimes(lambda: next(ticks))
    for stage in (*3 * ["landmarks"], "refine", "output"):
        times(SimpleNamespace(stage=stage))
    assert times.rows() == [
        {"stage": "landmarks", "cpu": 3.0, "wall": 30.0},
        {"stage": "refine", "cpu": 1.0, "wall": 10.0},
        {"stage": "output", "cpu": 1.0, "wall": 10.0},
    ]


def test_own_time_is_without_that_of_other_functions_of_the_library():
    """a() calls b() directly and c() through a list comprehension and NumPy."""
    a, b, c = (("/lib/x.py", k, name) for k, name in enumerate("abc"))
    loop, numpy = ("/lib/x.py", 9, "<listcomp>"), ("/numpy.py", 1, "dot")
    calls = (1, 1)
    stats = SimpleNamespace(
        stats={
            a: (*calls, 1.0, 10.0, {}),
            b: (*calls, 2.0, 2.0, {a: (*calls, 2.0, 2.0)}),
            loop: (*calls, 0.5, 5.0, {a: (*calls, 0.5, 5.0)}),
            # half of dot's time is on behalf of the comprehension
            numpy: (2, 2, 4.0, 6.0, {loop: (*calls, 2.0, 3.0), a: (*calls, 2.0, 3.0)}),
            c: (*calls, 2.0, 2.0, {numpy: (*calls, 2.0, 2.0)}),
        }
    )
    own = {r["stage"]: r["cpu"] for r in _speed_worker.own_times(stats, "/lib")}
    assert own == {"x.py: a": 10 - 2 - 2, "x.py: b": 2.0, "x.py: c": 2.0}


def test_photos_that_are_used_twice_are_not_the_same(tmp_path):
    picture = np.random.default_rng(0).integers(0, 255, (40, 60, 3), np.uint8)
    write_png(tmp_path / "a.png", picture)
    made = speed.photo_folder(tmp_path / "made", [tmp_path / "a.png"], 3, 0.01)
    found = [cv2.imread(str(path)) for path in sorted(made.iterdir())]
    assert len({image.tobytes() for image in found}) == 3
    for image in found:
        assert abs(image.shape[0] * image.shape[1] - 10_000) < 300


# --- identity -------------------------------------------------------------------------


def described(count, rng):
    """Photos of one person: descriptors 0.4 apart, other people's 0.8."""
    vector = rng.normal(0, 0.4 / np.sqrt(2 * 128), (count, 128))
    vector += rng.normal(0, np.sqrt(0.48 / 256), 128)
    return [identity.Descriptors(vector, np.zeros(count), np.ones(count))]


@pytest.mark.parametrize("own, other", [(12, 0), (12, 1), (12, 4), (10, 10)])
def test_outlier_identities_are_counted(own, other):
    rng = np.random.default_rng(own + other)
    people = {str(k): described(12, rng) for k in range(4)}
    row = identity.trials(people, own, other, 5, rng)
    assert row["photos"] == own + other
    assert row["wrong"] == row["wrong_most"] == row["wrong_folders"] == 0
    assert row["doubts"] == 0
    assert row["found"] == row["found_or_doubt"] == (100 if other else "")


@pytest.mark.parametrize(
    "name, words",
    [
        ("inputs", ["--data", "nowhere", "--set", "ann/S1", "--only", "photos"]),
        ("drawn", ["--people", "nowhere"]),
    ],
)
def test_a_set_that_is_not_there_is_refused(name, words, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [name, *words])
    with pytest.raises(SystemExit) as ended:
        importlib.import_module(name).main()
    assert ended.value.code == 2
    assert "is no folder" in capsys.readouterr().err
