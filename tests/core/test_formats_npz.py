"""The project's own file: its contract, its round trip, its refusals."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from bsface.camera.camera import Camera
from bsface.errors import ReconstructionError
from bsface.formats import read_npz, write_npz
from bsface.formats.face_file import contents, npz_bytes, to_json
from fake_face import FakeReconstruction, bare_reconstruction


def full_reconstruction():
    bare = bare_reconstruction()
    rng = np.random.default_rng(5)
    cameras = tuple(
        Camera(np.eye(3), 2.0 + i, np.array([3.0, i]), 0.001, np.array([50.0, 60.0]))
        for i in range(2)
    )
    landmarks = tuple(
        SimpleNamespace(
            photo=name, scheme=scheme, points=rng.random((f, 2)), weight=rng.random(f)
        )
        for name, scheme, f in (("a.jpg", "68", 68), ("b ü.jpg", "40", 40))
    )
    return FakeReconstruction(
        surface=bare.surface,
        template=bare.template,
        photos=tuple(SimpleNamespace(name=m.photo) for m in landmarks),
        landmarks=landmarks,
        cameras=cameras,
        photometric=SimpleNamespace(
            uv=rng.random((7, 2)), lights=rng.random((2, 9)), singular_values=None
        ),
        reports=({"name": "a.jpg", "status": "used", "yaw": np.float64("nan")},),
        confidence=rng.random(bare.surface.shape),
        history=({"stage": "motion", "residual": 1.5},),
        warnings=("few photos",),
        seconds={"motion": 1.0},
    )


def test_contract_holds_without_the_project(tmp_path):
    face = bare_reconstruction()
    path = write_npz(tmp_path / "face", face)
    assert path.name == "face.npz"
    with np.load(path, allow_pickle=False) as archive:
        assert archive["control_points"].dtype == np.float64
        assert np.array_equal(archive["control_points"], face.surface.control_points)
        m, n = face.surface.shape
        assert np.array_equal(archive["knots_u"], np.arange(m + 4.0))
        assert np.array_equal(archive["knots_v"], np.arange(n + 4.0))
        assert json.loads(str(archive["settings"])) == face.settings.to_dict()
        assert json.loads(str(archive["report"])) == []


def test_round_trip_of_everything(tmp_path):
    face = full_reconstruction()
    saved = read_npz(write_npz(tmp_path / "face.npz", face))
    assert np.array_equal(saved.surface.control_points, face.surface.control_points)
    assert saved.camera_photos == ("a.jpg", "b ü.jpg")
    for found, camera in zip(saved.cameras, face.cameras, strict=True):
        points = np.arange(12.0).reshape(4, 3)
        assert np.array_equal(found.project(points), camera.project(points))
    for i, marks in enumerate(face.landmarks):
        assert saved.landmark_schemes[i] == marks.scheme
        assert np.array_equal(saved.landmark_points[i], marks.points)
        assert np.array_equal(saved.landmark_weights[i], marks.weight)
    assert np.array_equal(saved.confidence, face.confidence)
    assert set(saved.photometric) == {"uv", "lights"}
    assert saved.report == [{"name": "a.jpg", "status": "used", "yaw": None}]
    assert saved.about["warnings"] == ["few photos"]
    assert np.array_equal(saved.outline_uv, face.template.outline_uv)


def test_equal_runs_give_equal_bytes(tmp_path):
    first, second = full_reconstruction(), full_reconstruction()
    object.__setattr__(second, "seconds", {"motion": 99.0})
    assert npz_bytes(contents(first)) == npz_bytes(contents(second))


def test_failed_write_leaves_the_old_file_and_no_litter(tmp_path, monkeypatch):
    path = write_npz(tmp_path / "face.npz", bare_reconstruction())
    before = path.read_bytes()

    def broken(*args):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", broken)
    with pytest.raises(ReconstructionError, match=r"face\.npz: cannot be written"):
        write_npz(path, bare_reconstruction())
    assert path.read_bytes() == before and list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda a: a.pop("knots_u"), "not a face file"),
        (lambda a: a.update(knots_u=a["knots_u"] * 2), "uniform bicubic"),
        (lambda a: a.update(control_points=np.zeros((3, 9, 3))), "fewer than 4"),
        (lambda a: a.update(settings=np.array("{")), "damaged"),
    ],
)
def test_files_that_break_the_contract_are_refused(tmp_path, change, words):
    arrays = contents(bare_reconstruction())
    change(arrays)
    path = tmp_path / "face.npz"
    path.write_bytes(npz_bytes(arrays))
    with pytest.raises(ReconstructionError, match=words):
        read_npz(path)


@pytest.mark.parametrize("content", [b"", b"not a zip", b"PK\x03\x04 cut off"])
def test_damaged_and_missing_files_are_refused_in_a_sentence(tmp_path, content):
    path = tmp_path / "face.npz"
    with pytest.raises(ReconstructionError, match="no such file"):
        read_npz(path)
    path.write_bytes(content)
    with pytest.raises(ReconstructionError, match=r"not a readable \.npz"):
        read_npz(path)


def test_json_takes_dataclasses_arrays_and_numbers_that_are_none():
    text = to_json(
        {"a": np.arange(2), "b": float("inf"), "c": (np.int64(3), FakeReconstruction)}
        | {"c": (np.int64(3), "x")}
    )
    assert json.loads(text) == {"a": [0, 1], "b": None, "c": [3, "x"]}
