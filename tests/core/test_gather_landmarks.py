"""Landmark files beside the photos, and landmarks by hand: what they decide."""

import json
import shutil
from dataclasses import replace

import numpy as np
from bsface.landmarks.landmarks import Landmarks, write_landmarks
from bsface.prepare import Inputs, collect_photos
from photo_folders import NO_DETECTOR, PHOTOS, TEMPLATE, codes, front_landmarks, save


def test_landmark_file_wins_and_needs_no_models(folder, picture, monkeypatch, tmp_path):
    monkeypatch.setenv("BSFACE_MODELS", str(tmp_path / "none"))
    save(folder / "a.png", picture)
    marks = front_landmarks()
    write_landmarks(folder / "a.pts", marks)
    found = collect_photos(folder, NO_DETECTOR)
    assert found.landmarks[0].source == "file"
    assert found.landmarks[0].scheme == "68"
    np.testing.assert_allclose(found.landmarks[0].points, marks.points, atol=1e-9)
    # The scheme has no forehead, the cut-out has.
    xyz = TEMPLATE.landmark_xyz[[10]]
    forehead = xyz[:, :2] * (1.2, -1.2) + (200, 200)
    assert (found.photos[0].to_window(forehead) > 0).all()


def test_given_landmarks_win_over_files(folder, picture):
    save(folder / "a.png", picture)
    write_landmarks(folder / "a.pts", front_landmarks())
    given = front_landmarks("40", (190, 205))
    found = collect_photos(folder, NO_DETECTOR, Inputs(landmarks={"a.png": given}))
    assert found.landmarks[0].source == "hand"
    np.testing.assert_array_equal(found.landmarks[0].points, given.points)


def test_landmark_files_beside_the_wrong_photos_get_a_doubt(models, folder):
    """Also those of the same person in another pose, whose faces nearly coincide."""
    names = ("000.jpg", "005.jpg", "011.jpg")
    for name in names:
        shutil.copy(PHOTOS / name, folder)
    seen = collect_photos(folder).landmarks
    noise = np.random.default_rng(0).normal(0, 2, (68, 2))
    for shift in (0, -1):
        for name, other in zip(names, np.roll(np.arange(3), shift), strict=True):
            marks = seen[other].subset("68", TEMPLATE.schemes["68"])
            marks = replace(marks, points=marks.points + noise)
            write_landmarks(folder / f"{name[:3]}.pts", marks)
        found = collect_photos(folder)
        assert [marks.source for marks in found.landmarks] == ["file"] * 3
        doubts = ["marks another place" in marks.note for marks in found.landmarks]
        assert doubts == [bool(shift)] * 3
        said = [x for x in found.identity_warnings if "another place" in x]
        assert len(said) == bool(shift) and all(", ".join(names) in x for x in said)
    notes = [marks.note for marks in collect_photos(folder, NO_DETECTOR).landmarks]
    assert notes == [""] * 3


def test_wrong_landmark_files_are_told_and_the_rest_is_used(folder, picture):
    for number, name in enumerate("abcdef"):
        save(folder / f"{name}.png", picture[number:])
    marks = front_landmarks()
    write_landmarks(folder / "a.pts", marks)
    (folder / "b.pts").write_text("{ 1 2 }")
    swapped = Landmarks("c", "68", marks.points[:, ::-1], marks.weight)
    write_landmarks(folder / "c.pts", swapped)
    far = Landmarks("d", "68", marks.points + 5000, marks.weight)
    write_landmarks(folder / "d.json", far)
    write_landmarks(folder / "e.json", marks, (10, 10))
    found = collect_photos(folder, NO_DETECTOR)
    assert [photo.name for photo in found.photos] == ["a.png"]
    assert codes(found) == {
        "b.png": "implausible",
        "c.png": "implausible",
        "d.png": "implausible",
        "e.png": "implausible",
        "f.png": "no_face",
    }
    reasons = {f.name: f.reason for f in found.failures}
    assert "b.pts" in reasons["b.png"]
    assert "swapped" in reasons["c.png"]
    assert "d.png" in reasons["d.png"]
    assert "e.json" in reasons["e.png"]
    assert "switched off" in reasons["f.png"]


def test_json_of_another_program_does_not_hide_the_photo(models, folder, picture):
    save(folder / "a.png", picture)
    (folder / "a.json").write_text(json.dumps({"camera": "X100", "iso": 200}))
    assert collect_photos(folder).landmarks[0].source == "detected"
