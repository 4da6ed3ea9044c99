"""The networks' files: where they are looked for, and what is said of damaged ones."""

from dataclasses import replace
from pathlib import Path

import cv2
import pytest
from bsface.errors import ReconstructionError
from bsface.landmarks import face_models
from bsface.landmarks.face_mesh import FaceMesh
from bsface.landmarks.face_models import ModelFiles, find_models, user_cache
from bsface.surface.template import load_template

MIRROR = load_template().landmark_mirror


def test_missing_models_are_told_with_all_places(tmp_path):
    with pytest.raises(ReconstructionError, match="bsface models fetch") as info:
        find_models(tmp_path)
    assert str(tmp_path) in str(info.value)


def test_search_order_of_models(tmp_path, monkeypatch):
    monkeypatch.setenv("BSFACE_MODELS", str(tmp_path / "env"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert user_cache() == tmp_path / "cache" / "bsface"
    folders = face_models.model_folders()
    assert folders[0] == tmp_path / "env"
    assert folders[-1] == tmp_path / "cache" / "bsface" / "models"
    for folder in (folders[0], folders[-1]):
        folder.mkdir(parents=True)
        for name in (
            face_models.DETECTOR_FILE,
            face_models.MESH_FILE,
            face_models.RECOGNITION_FILE,
        ):
            (folder / name).touch()
    assert find_models().mesh.parent == tmp_path / "env"
    (tmp_path / "env" / face_models.RECOGNITION_FILE).unlink()
    assert find_models().mesh.parent != tmp_path / "env"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert user_cache().is_absolute()


@pytest.mark.parametrize(
    "content", [b"", b"not a model", b"\x1c\0\0\0TFL3" + b"\0" * 99]
)
def test_file_that_is_no_model(tmp_path, content):
    path = tmp_path / "x.tflite"
    path.write_bytes(content)
    with pytest.raises(ReconstructionError, match=r"x\.tflite is damaged"):
        FaceMesh(ModelFiles(path, path, path), MIRROR)


@pytest.mark.parametrize("part", [0.5, 0.99])
def test_model_file_that_was_cut_off(tmp_path, part):
    try:
        files = find_models()
    except ReconstructionError as error:
        pytest.skip(f"the model files are not installed: {error}")
    data = files.detector.read_bytes()
    path = tmp_path / "x.tflite"
    path.write_bytes(data[: int(part * len(data))])
    with pytest.raises(ReconstructionError, match=r"x\.tflite is damaged"):
        FaceMesh(replace(files, detector=path), MIRROR)


@pytest.mark.parametrize(
    "version, error, told",
    [
        ("4.11.0", cv2.error("model is incorrect"), "mesh.tflite is damaged"),
        ("5.0.0-pre", cv2.error("sz > 0"), "mesh.tflite is damaged"),
        ("4.12.0", cv2.error("Build OpenCV with FlatBuffers"), "without FlatBuffers"),
        ("4.12.0", AttributeError("readNetFromTFLite"), "without FlatBuffers"),
        ("4.6.0", AttributeError("readNetFromTFLite"), "OpenCV 4.6.0 is too old"),
        ("4.9.0", cv2.error("model is incorrect"), "OpenCV 4.9.0 is too old"),
    ],
)
def test_what_is_wrong_with_model_or_opencv_is_told(version, error, told):
    sentence = face_models.why_not_loaded(Path("mesh.tflite"), error, version)
    assert told in sentence
    others = {"is damaged", "without FlatBuffers", "too old"}
    assert sum(other in sentence for other in others) == 1


def test_a_model_file_with_a_wrong_byte_is_not_used(tmp_path):
    """It loads and answers: only its hash tells."""
    try:
        files = find_models()
    except ReconstructionError as error:
        pytest.skip(f"the model files are not installed: {error}")
    for path in (files.detector, files.mesh, files.recognition):
        assert face_models.intact(path) == path
    data = bytearray(files.mesh.read_bytes())
    data[5000] ^= 1
    path = tmp_path / files.mesh.name
    path.write_bytes(data)
    FaceMesh(replace(files, mesh=path), MIRROR)
    with pytest.raises(ReconstructionError, match="is damaged or is not the expected"):
        face_models.intact(path)


def test_swapped_models(tmp_path):
    try:
        files = find_models()
    except ReconstructionError as error:
        pytest.skip(f"the model files are not installed: {error}")
    with pytest.raises(ReconstructionError, match="is not the expected"):
        FaceMesh(replace(files, detector=files.mesh, mesh=files.detector), MIRROR)
