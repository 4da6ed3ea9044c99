"""The face file: its contract, its round trip, its versions, its refusals."""

import json
from dataclasses import replace

import numpy as np
import pytest
from bsface import Constraint, Reconstruction, Settings, load
from bsface.camera.camera import Camera
from bsface.errors import ReconstructionError
from bsface.formats.face_file import face_arrays, face_bytes, load_face, npz_bytes
from bsface.json_text import to_json
from bsface.landmarks.landmarks import Landmarks
from bsface.photometry.lighting import PhotometricEvidence
from bsface.result import HistoryEntry, PhotoReport, Provenance, no_photo
from bsface.surface.bspline import BSplineSurface
from bsface.surface.edited import edited_template
from bsface.surface.template import load_template
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

SHAPE = (12, 13)
DATE = "2026-01-02T03:04:05Z"


@pytest.fixture(scope="module")
def bare():
    """A face that knows nothing but its surface."""
    template = load_template().resampled(SHAPE)
    k = len(template.expression_modes)
    return Reconstruction(
        surface=template.surface,
        template=template,
        photos=(),
        landmarks=(),
        cameras=(),
        photometric=None,
        reports=(),
        deviation=None,
        settings=Settings(control_points=SHAPE),
        expressions=np.zeros((0, k)),
    )


@pytest.fixture(scope="module")
def full(bare):
    """A face of two photos that knows everything."""
    rng = np.random.default_rng(5)
    cameras = tuple(
        Camera(np.eye(3), 2.0 + i, np.array([3.0, i]), 0.001, np.array([49.5, 59.5]))
        for i in range(2)
    )
    names = ("a.jpg", "b ü.jpg")
    landmarks = tuple(
        Landmarks(name, scheme, rng.random((f, 2)), rng.random(f))
        for name, scheme, f in zip(names, ("68", "40"), (68, 40), strict=True)
    )
    k = len(bare.template.expression_modes)
    edited = bare.surface.transformed(1.1, t=(0, 2, 1))
    return replace(
        bare,
        surface=edited,
        template=edited_template(edited, bare.template),
        photos=tuple(no_photo(name, (100, 120)) for name in names),
        landmarks=landmarks,
        cameras=cameras,
        photometric=PhotometricEvidence(
            uv=rng.random((7, 2)),
            normals=rng.random((7, 3)),
            albedo=rng.random((7, 3)),
            lights=rng.random((2, 9)),
            weights=rng.random((2, 7)),
            residual=rng.random((2, 7)),
            singular_values=rng.random(2),
        ),
        reports=(
            PhotoReport("a.jpg", "used", "", 1.5, 2.0, 3.0, 4.0, 0.1, 0.9),
            PhotoReport("c.jpg", "no_face", "No face was found."),
        ),
        deviation=rng.random(SHAPE),
        expressions=rng.random((2, k)),
        constraint=Constraint(rng.random(SHAPE) < 0.1, 0.5),
        history=(HistoryEntry("motion", 1.5, 0.25),),
        warnings=("few photos",),
        provenance=Provenance("0.2.0", {"numpy": "2.0"}, {"a.jpg": "abc"}),
    )


def arrays_equal(a, b, **tolerance):
    np.testing.assert_allclose(a, b, **(tolerance or {"rtol": 0, "atol": 0}))


def test_contract_holds_without_the_project(bare, tmp_path):
    path = bare.save(tmp_path / "face")
    assert path.name == "face.npz"
    with np.load(path, allow_pickle=False) as archive:
        assert archive["control_points"].dtype == np.float64
        arrays_equal(archive["control_points"], bare.surface.control_points)
        m, n = bare.surface.shape
        arrays_equal(archive["knots_u"], np.arange(m + 4.0))
        arrays_equal(archive["knots_v"], np.arange(n + 4.0))
        assert json.loads(str(archive["settings"])) == bare.settings.to_dict()
        assert json.loads(str(archive["report"])) == []


def test_round_trip_of_everything(full, tmp_path):
    saved = load(full.save(tmp_path / "face.npz", date=DATE))
    arrays_equal(saved.surface.control_points, full.surface.control_points)
    for name in ("landmark_xyz", "eye_centres", "outline_uv", "landmark_uv"):
        arrays_equal(getattr(saved.template, name), getattr(full.template, name))
    arrays_equal(saved.template.surface.vector, full.template.surface.vector)
    arrays_equal(saved.template.expression_modes, full.template.expression_modes)
    assert [(p.name, p.size) for p in saved.photos] == [
        (p.name, p.size) for p in full.photos
    ]
    assert not saved.has_pixels
    points = np.arange(12.0).reshape(4, 3)
    for found, camera in zip(saved.cameras, full.cameras, strict=True):
        arrays_equal(found.project(points), camera.project(points))
    for found, marks in zip(saved.landmarks, full.landmarks, strict=True):
        assert (found.photo, found.scheme) == (marks.photo, marks.scheme)
        arrays_equal(found.points, marks.points)
        arrays_equal(found.weight, marks.weight)
    for name in ("uv", "normals", "albedo", "lights", "singular_values"):
        arrays_equal(getattr(saved.photometric, name), getattr(full.photometric, name))
    for name in ("weights", "residual"):  # three digits are stored
        found, kept = getattr(saved.photometric, name), getattr(full.photometric, name)
        arrays_equal(found, kept, rtol=1e-3)
    for name in ("deviation", "expressions"):
        arrays_equal(getattr(saved, name), getattr(full, name))
    arrays_equal(saved.constraint.points, full.constraint.points)
    assert saved.constraint.softness_mm == 0.5
    assert saved.reports[0] == full.reports[0]
    assert saved.reports[1].reason == "No face was found."
    assert saved.settings == full.settings
    assert saved.history == full.history and saved.warnings == full.warnings
    assert saved.provenance == replace(full.provenance, date=DATE)


def test_file_of_a_loaded_face_is_the_same(full, tmp_path):
    path = full.save(tmp_path / "face.npz", date=DATE)
    again = load(path).save(tmp_path / "again.npz", date=DATE)
    assert again.read_bytes() == path.read_bytes()


def test_equal_runs_give_equal_bytes_for_a_fixed_date(full, tmp_path):
    slower = replace(full, seconds={"motion": 99.0})
    assert face_bytes(full, DATE) == face_bytes(slower, DATE)
    assert face_bytes(full, DATE) != face_bytes(full, "another")


def test_a_face_of_version_1_is_read(full, tmp_path):
    """What version 1 did not have is absent, and the deviation had another name."""
    arrays = face_arrays(full, DATE)
    arrays["confidence"] = arrays.pop("deviation")
    about = json.loads(str(arrays["about"]))
    arrays["about"] = np.array(
        to_json({"file_version": 1, "warnings": about["warnings"]})
    )
    for name in list(arrays):
        later = ("template_", "constraint_", "expressions", "camera_size")
        if name.startswith(later) or name.endswith(("_weights", "_residual")):
            del arrays[name]
    path = tmp_path / "old.npz"
    path.write_bytes(npz_bytes(arrays))
    old = load(path)
    arrays_equal(old.deviation, full.deviation)
    assert old.photos[0].size == (100, 120)  # from the principal point
    assert not old.expressions.any() and old.warnings == ("few photos",)
    arrays_equal(old.photometric.albedo, full.photometric.albedo)


def read_with(face, tmp_path, **changes):
    """A face read from a file some of whose arrays are others."""
    path = tmp_path / "face.npz"
    path.write_bytes(npz_bytes(face_arrays(face, DATE) | changes))
    return load(path)


def test_a_setting_that_cannot_be_used_takes_no_other_with_it(full, tmp_path):
    said = full.settings.to_dict() | {
        "method": "paper",
        "eye_distance_mm": 65.0,
        "lam": -1.0,
        "of_another_version": 3,
    }
    found = read_with(full, tmp_path, settings=np.array(to_json(said)))
    assert found.settings == replace(
        full.settings, method="paper", eye_distance_mm=65.0, lam=Settings().lam
    )
    (warning,) = set(found.warnings) - set(full.warnings)
    assert "cannot use for lam;" in warning


def test_numbers_too_large_for_a_float_are_unknown(full, tmp_path):
    row = '[{"name": "a", "status": "used", "reason": "", "yaw": 1' + "0" * 400 + "}]"
    history = '{"history": [{"stage": "motion", "residual": 1' + "0" * 400 + "}]}"
    found = read_with(full, tmp_path, report=np.array(row), about=np.array(history))
    assert np.isnan(found.reports[0].yaw)
    assert np.isnan(found.history[0].residual)


def changed(**arrays):
    return lambda a: a.update({k: np.array(v) for k, v in arrays.items()})


BAD = {
    "no knots": (lambda a: a.pop("knots_u"), "not a face file"),
    "other knots": (lambda a: a.update(knots_u=a["knots_u"] * 2), "uniform bicubic"),
    "tiny net": (changed(control_points=np.zeros((3, 9, 3))), "from 4 x 4 to 256"),
    "huge net": (changed(control_points=np.zeros((300, 4, 3))), "300 x 4"),
    "far away": (lambda a: a["control_points"].put(0, 1e300), "1e.300 mm from"),
    "one place": (lambda a: a["control_points"].fill(0), "at one place"),
    "one line": (lambda a: a["control_points"][..., 1:].fill(0), "on one line"),
    "flat outline": (changed(outline_uv=[[0.1, 0.2]]), "three corners"),
    "outline outside": (changed(outline_uv=[[0, 0], [0, 2], [1, 1]]), r"in \[0, 1\]"),
    "settings": (changed(settings="{"), "settings is not valid JSON"),
    "newer": (changed(about='{"file_version": 99}'), "install a newer bsface"),
    "report": (changed(report="[3]"), "not a list of photos"),
    "softness": (changed(constraint_softness_mm=-1.0), "negative"),
    "expressions": (changed(expressions=np.zeros((5, 2))), "expressions"),
    "landmarks": (changed(landmark_count=[-1, 109]), "landmark_count"),
    "far eyes": (
        changed(template_eye_centres=np.full((2, 3), 1e200)),
        "template_eye_centres lie up to 1e.200 mm",
    ),
    "far template": (
        lambda a: a["template_control_points"].put(0, -1e6),
        "template_control_points lie up to 1e.06 mm",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_files_that_break_the_contract_are_refused(full, tmp_path, case):
    change, words = BAD[case]
    arrays = {k: np.array(v) for k, v in face_arrays(full, DATE).items()}
    change(arrays)
    path = tmp_path / "face.npz"
    path.write_bytes(npz_bytes(arrays))
    with pytest.raises(ReconstructionError, match=words) as refused:
        load(path)
    assert str(refused.value).startswith(str(path))


@settings(
    max_examples=25,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=st.data())
def test_any_change_of_an_array_is_read_or_refused(bare, full, tmp_path, data):
    """Another shape, kind or content of one array: a face or one sentence."""
    arrays = dict(face_arrays(full, DATE))
    name = data.draw(st.sampled_from(sorted(arrays)))
    value = data.draw(
        st.sampled_from(
            [
                np.array("text"),
                np.array(np.nan),
                np.zeros((2, 2)),
                np.full(3, np.inf),
                np.zeros((0, 3)),
                np.array('{"file_version": "x", "history": 3, "warnings": {}}'),
                np.array(b"bytes"),
                np.zeros(3, complex),
            ]
        )
    )
    path = tmp_path / "face.npz"
    path.write_bytes(npz_bytes({**arrays, name: value}))
    try:
        face = load_face(path, bare.template)
    except ReconstructionError as refused:
        assert str(path) in str(refused)
    else:
        assert face.surface.shape == SHAPE


@pytest.mark.parametrize("content", [b"", b"not a zip", b"PK\x03\x04 cut off"])
def test_damaged_and_missing_files_are_refused_in_a_sentence(tmp_path, content):
    path = tmp_path / "face.npz"
    with pytest.raises(ReconstructionError, match="no such file"):
        load(path)
    path.write_bytes(content)
    with pytest.raises(ReconstructionError, match=r"not a readable \.npz"):
        load(path)


def test_wrong_kinds_are_a_type_error(bare):
    with pytest.raises(TypeError, match="path must be a path"):
        load(3)
    for path in (5, None, b"face.npz"):
        with pytest.raises(TypeError, match="path must be a path"):
            bare.save(path)
    with pytest.raises(TypeError, match="date must be a text"):
        bare.save("face.npz", date=3)


@pytest.mark.parametrize(
    "change, words",
    [
        (lambda s: s.resampled((300, 13)), "300 x 13"),
        (lambda s: s.transformed(1e5), "mm from the origin"),
        (lambda s: BSplineSurface(0 * s.control_points), "at one place"),
        (lambda s: s.transformed(R=np.diag([1.0, 0, 0])), "on one line"),
    ],
)
def test_what_would_not_be_read_is_not_written(bare, tmp_path, change, words):
    old = tmp_path / "face.npz"
    old.write_bytes(b"old")
    face = bare.with_surface(change(bare.surface))
    with pytest.raises(ReconstructionError, match=words) as refused:
        face.save(old)
    assert str(refused.value).startswith(f"{old}: a face file cannot hold this face")
    assert old.read_bytes() == b"old"


def test_a_face_file_has_a_name_and_a_date(bare, tmp_path):
    with pytest.raises(ReconstructionError, match="name of the face file is empty"):
        bare.save("")
    for date in ("garbage", ""):
        with pytest.raises(ReconstructionError, match="is not a date; write it as"):
            bare.save(tmp_path / "face.npz", date=date)
    assert not list(tmp_path.iterdir())


def test_a_face_is_shown_in_one_line_and_as_a_picture(full):
    assert repr(full) == (
        "<Reconstruction: 12 x 13 control points, method 'joint', 1 of 2 photos>"
    )
    assert "data:image/png;base64," in full._repr_html_()


def test_json_takes_dataclasses_arrays_and_numbers_that_are_none():
    text = to_json(
        {"a": np.arange(2), "b": float("inf"), "c": (np.int64(3), PhotoReport("x", ""))}
    )
    read = json.loads(text)
    assert read["a"] == [0, 1] and read["b"] is None and read["c"][0] == 3
    assert read["c"][1]["name"] == "x" and read["c"][1]["yaw"] is None
