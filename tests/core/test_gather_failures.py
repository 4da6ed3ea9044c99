"""Photos that are no use or copies of others: named, and the rest is used."""

import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
from bsface.errors import PhotoFailure, ReconstructionError
from bsface.landmarks.landmarks import write_landmarks
from bsface.prepare import Inputs, collect_photos
from photo_folders import NO_DETECTOR, PHOTOS, TEMPLATE, codes, front_landmarks, save


def test_dirty_folder(models, folder, picture):
    save(folder / "a good one.png", picture)
    save(folder / "again.bmp", picture)
    (folder / "text.jpg").write_text("hello")
    (folder / "zero.jpg").touch()
    (folder / "shot.heic").write_bytes(b"\0\0\0\x18ftypheic" + b"\0" * 50)
    save(folder / "wall.png", np.full((200, 300, 3), 140, np.uint8))
    save(folder / "set aside.png", picture[::-1])
    tiny = np.full((200, 200, 3), 90, np.uint8)
    tiny[60:140, 60:140] = cv2.resize(picture, (80, 80), interpolation=cv2.INTER_AREA)
    save(folder / "tiny.png", tiny)
    found = collect_photos(folder, inputs=Inputs(ignore=["set aside.png"]))
    assert [photo.name for photo in found.photos] == ["a good one.png"]
    assert codes(found) == {
        "again.bmp": "duplicate",
        "set aside.png": "ignored",
        "shot.heic": "unreadable",
        "text.jpg": "unreadable",
        "tiny.png": "small_face",
        "wall.png": "no_face",
        "zero.jpg": "unreadable",
    }
    for failure in found.failures:
        assert isinstance(failure, PhotoFailure)
        assert failure.name in failure.reason
        assert failure.reason.endswith(".")
        assert "\n" not in failure.reason
    assert "a good one.png" in {f.name: f.reason for f in found.failures}["again.bmp"]


def test_blurred_and_badly_exposed_faces():
    """Landmarks are given, so that only the judgement of the pixels is tested."""
    image = cv2.imread(str(PHOTOS / "000.jpg"))[..., ::-1]
    unit = 1.2 * TEMPLATE.eye_distance
    pictures = {
        "sharp.png": image,
        "soft.png": cv2.GaussianBlur(image, (0, 0), 0.03 * unit),
        "blurred.png": cv2.GaussianBlur(image, (0, 0), 0.15 * unit),
        "black.png": np.zeros_like(image),
        "white.png": np.full_like(image, 255),
    }
    names = list(pictures)
    found = collect_photos(
        list(pictures.values()),
        NO_DETECTOR,
        Inputs(
            landmarks={
                f"picture {i + 1}": front_landmarks(name=name)
                for i, name in enumerate(names)
            }
        ),
    )
    assert [p.name for p in found.photos] == ["picture 1", "picture 2"]
    assert [f.code for f in found.failures] == ["blurred", "dark", "bright"]


def test_no_usable_photo_is_told_with_the_reasons(models, folder):
    for number in range(3):
        wall = np.full((100, 100, 3), 50 + number, np.uint8)
        save(folder / f"{number}.png", wall)
    (folder / "text.jpg").write_text("hello")
    with pytest.raises(ReconstructionError) as info:
        collect_photos(folder)
    assert "None of the 4 photos" in str(info.value)
    assert "3 no face found" in str(info.value)
    assert "1 cannot be read" in str(info.value)
    assert "The first: No face was found in 0.png" in str(info.value)
    assert [p.name for p in info.value.photos] == [
        "0.png",
        "1.png",
        "2.png",
        "text.jpg",
    ]
    with pytest.raises(ReconstructionError, match="1 set aside.*in 1.png"):
        collect_photos(folder, inputs=Inputs(ignore=("0.png",)))
    every = ("0.png", "1.png", "2.png", "text.jpg")
    with pytest.raises(ReconstructionError, match="All 4 photos are set aside; leave"):
        collect_photos(folder, inputs=Inputs(ignore=every))


def test_missing_models_end_the_job_with_the_remedy(tmp_path, monkeypatch, picture):
    for name in ("BSFACE_MODELS", "XDG_CACHE_HOME"):
        monkeypatch.setenv(name, str(tmp_path))
    with pytest.raises(ReconstructionError, match="bsface models fetch"):
        collect_photos([picture])


# --- copies ------------------------------------------------------------------


def test_forty_times_the_same_photo(models, folder, picture):
    save(folder / "0.png", picture)
    for number in range(1, 40):
        shutil.copy(folder / "0.png", folder / f"{number}.png")
    found = collect_photos(folder)
    assert len(found.photos) == 1
    assert set(codes(found).values()) == {"duplicate"}
    assert len(found.failures) == 39


@pytest.mark.parametrize("fault", ["no mask", "black mask", "no landmarks", "no face"])
def test_a_copy_stands_in_for_a_photo_with_bad_files_beside_it(folder, picture, fault):
    for name in "ab":
        save(folder / f"{name}.png", picture)
        write_landmarks(folder / f"{name}.pts", front_landmarks())
    if fault == "no mask":
        (folder / "a.mask.png").write_bytes(b"")
    elif fault == "black mask":
        save(folder / "a.mask.png", np.zeros_like(picture))
    elif fault == "no landmarks":
        (folder / "a.pts").write_text("{ 1 2 }")
    else:
        marks = front_landmarks()
        swapped = replace(marks, points=marks.points[:, ::-1])
        write_landmarks(folder / "a.pts", swapped)
    found = collect_photos(folder, NO_DETECTOR)
    assert [photo.name for photo in found.photos] == ["b.png"]
    assert list(codes(found)) == ["a.png"] and "duplicate" not in codes(found).values()


def test_a_copy_of_another_size_or_quality_gets_a_doubt(folder, picture):
    small = cv2.resize(picture, (300, 300), interpolation=cv2.INTER_AREA)
    for name, pixels in (("a.png", picture), ("b.jpg", picture), ("c.png", small)):
        save(folder / name, pixels)
        scale = pixels.shape[0] / picture.shape[0]
        marks = front_landmarks(centre=(200 * scale, 200 * scale), scale=1.2 * scale)
        write_landmarks(folder / name.replace(name[2:], "pts"), marks)
    save(folder / "d.png", np.ascontiguousarray(picture[:, ::-1]))
    write_landmarks(folder / "d.pts", front_landmarks())
    found = collect_photos(folder, NO_DETECTOR)
    notes = {marks.photo: marks.note for marks in found.landmarks}
    copy = "looks like a copy of a.png"
    assert notes == {"a.png": "", "b.jpg": copy, "c.png": copy, "d.png": ""}
    assert found.copies == 2
    # two copies of a photo that is left out are one photo
    assert replace(found, photos=found.photos[1:3]).copies == 1


def test_copies_given_as_arrays_get_a_doubt_too(picture):
    grey = np.clip(picture.astype(int) + 1, 0, 255).astype(np.uint8)
    marks = {f"picture {k}": front_landmarks() for k in (1, 2, 3)}
    pictures = [picture, grey, np.ascontiguousarray(picture[:, ::-1])]
    found = collect_photos(pictures, NO_DETECTOR, Inputs(landmarks=marks))
    notes = [marks.note for marks in found.landmarks]
    assert notes == ["", "looks like a copy of picture 1", ""]
