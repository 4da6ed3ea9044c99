"""From folders of photos to cut-outs with landmarks."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from bsface.errors import Cancelled
from bsface.images.folder import list_photos
from bsface.images.read import read_photo
from bsface.landmarks.candidates import CandidateReader
from bsface.landmarks.landmarks import write_landmarks
from bsface.prepare import collect_photos
from bsface.progress import never_cancelled
from bsface.settings import Settings
from photo_folders import NO_DETECTOR, PHOTOS, TEMPLATE, front_landmarks, save

ROOT = Path(__file__).resolve().parents[2]
LFW = ROOT.parent / "shared" / "photos" / "lfw"

# --- the good case -----------------------------------------------------------


def test_folder_to_cut_outs(models, folder):
    names = ["002.jpg", "000.jpg", "010.jpg"]
    for name in names:
        shutil.copy(PHOTOS / name, folder)
    found = collect_photos(folder)
    assert [photo.name for photo in found.photos] == sorted(names)
    assert found.failures == ()
    for photo, marks in zip(found.photos, found.landmarks, strict=True):
        assert marks.photo == photo.name
        assert marks.scheme == "468"
        assert marks.source == "detected"
        assert marks.faces == 1
        assert marks.note == ""
        assert ((marks.weight > 0) & (marks.weight <= 1)).all()
        # Nothing of the face is cut off.
        inside = photo.to_window(marks.points)
        h, w = photo.pixels.shape[:2]
        assert (inside > -1).all()
        assert (inside < (w, h)).all()
        whole = read_photo(PHOTOS / photo.name)
        x0, y0 = (int(v) for v in photo.window[:2])
        part = whole.pixels[y0 : y0 + h, x0 : x0 + w]
        np.testing.assert_array_equal(photo.pixels, part)


def test_same_photos_as_folder_paths_and_arrays(models, picture, folder):
    save(folder / "a.png", picture)
    save(folder / "b.png", np.ascontiguousarray(picture[10:]))
    as_folder = collect_photos(folder)
    as_paths = collect_photos(list_photos(folder))
    as_arrays = collect_photos([picture, picture[10:]])
    for other in (as_paths, as_arrays):
        for a, b in zip(as_folder.landmarks, other.landmarks, strict=True):
            np.testing.assert_array_equal(a.points, b.points)
    assert [p.name for p in as_arrays.photos] == ["picture 1", "picture 2"]


def test_large_photo_gives_a_small_cut_out(models, picture):
    large = cv2.resize(picture, (2400, 2400), interpolation=cv2.INTER_CUBIC)
    (photo,) = collect_photos([large]).photos
    assert max(photo.pixels.shape) <= 1024
    assert photo.size == (2400, 2400)
    small, big = (
        collect_photos([picture]).landmarks[0],
        collect_photos([large]).landmarks[0],
    )
    expected = (small.points + 0.5) * 6 - 0.5
    error = np.linalg.norm(big.points - expected, axis=1)
    assert np.sqrt((error**2).mean()) < 0.02 * np.ptp(expected[:, 0])


def test_sixteen_bits_and_grey(models, picture):
    grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    deep = picture.astype(np.uint16) * 257
    found = collect_photos([grey, deep])
    assert len(found.photos) == 2
    assert found.photos[1].pixels.dtype == np.uint16


@pytest.mark.parametrize("scheme", ["68", "40"])
def test_setting_selects_the_scheme(models, picture, scheme):
    whole = collect_photos([picture]).landmarks[0]
    part = collect_photos([picture], Settings(landmarks=scheme, detector=True))
    assert part.landmarks[0].scheme == scheme
    np.testing.assert_array_equal(
        part.landmarks[0].points, whole.points[TEMPLATE.schemes[scheme]]
    )


def test_turned_photo_has_landmarks_of_the_turned_picture(models, picture):
    upright = collect_photos([picture]).landmarks[0].points
    turned = collect_photos([np.rot90(picture, -1)]).landmarks[0].points
    expected = np.column_stack([399 - upright[:, 1], upright[:, 0]])
    error = np.linalg.norm(turned - expected, axis=1)
    assert np.sqrt((error**2).mean()) < 2


def test_paths_of_one_name_keep_apart(models, tmp_path, picture):
    for name in ("x", "y"):
        (tmp_path / name).mkdir()
    save(tmp_path / "x" / "a.png", picture)
    save(tmp_path / "y" / "a.png", picture[5:])
    found = collect_photos([tmp_path / "x" / "a.png", tmp_path / "y" / "a.png"])
    assert [photo.name for photo in found.photos] == ["a.png (1)", "a.png (2)"]


# --- several faces -----------------------------------------------------------


def beside(picture, left: float, right: float) -> np.ndarray:
    """One picture with two faces, each scaled about its own middle."""
    parts = []
    for scale in (left, right):
        matrix = cv2.getRotationMatrix2D((199.5, 199.5), 0, scale)
        parts.append(cv2.warpAffine(picture, matrix, (400, 400)))
    return np.hstack(parts)


def test_largest_of_several_faces(models, picture):
    (marks,) = collect_photos([beside(picture, 0.6, 1.0)]).landmarks
    assert marks.faces == 2
    assert "face 2 of 2 from the left" in marks.note
    assert "largest" in marks.note
    assert marks.points[:, 0].mean() > 400


# --- faces at the edge -------------------------------------------------------


@pytest.mark.parametrize("shift, told", [(0, False), (150, True)])
def test_face_cut_by_the_edge_gets_a_note(shift, told):
    """The picture ends in the middle of the face, or far from it."""
    picture = np.zeros((400, 400 - shift, 3), np.uint8)
    marks = front_landmarks("468", name="picture 1")
    reader = CandidateReader(TEMPLATE, NO_DETECTOR, {"picture 1": marks})
    (face,) = reader.read(picture, "picture 1", never_cancelled)
    assert ("cut by the picture's edge" in face.landmarks.note) == told
    if told:
        outside = (marks.points[:, 0] >= 400 - shift - 0.5).mean()
        assert f"{100 * outside:.0f} %" in face.landmarks.note


# --- progress ----------------------------------------------------------------


def test_progress_rises_to_the_end(folder, picture):
    for number in range(3):
        save(folder / f"{number}.png", picture[number:])
        write_landmarks(folder / f"{number}.pts", front_landmarks())
    steps = []
    collect_photos(folder, NO_DETECTOR, progress=steps.append)
    overall = [step.overall for step in steps]
    assert overall == sorted(overall)
    assert overall[0] == 0
    assert overall[-1] == 1
    assert {step.total for step in steps} == {3}
    assert "1.png" in "".join(step.message for step in steps)


def test_cancel(models, picture):
    def stop(step):
        if step.done == 1:
            raise Cancelled

    with pytest.raises(Cancelled):
        collect_photos([picture, picture[1:]], progress=stop)


# --- real photos -------------------------------------------------------------


@pytest.mark.parametrize("person", range(4))
def test_press_photos(models, person):
    """The face of the person is the one in the middle of the picture."""
    if not LFW.is_dir():
        pytest.skip("the press photos (../shared/photos/lfw) are not there")
    folder = sorted(LFW.iterdir())[person]
    found = collect_photos(list_photos(folder)[::3])
    assert len(found.photos) == 12
    for photo, marks in zip(found.photos, found.landmarks, strict=True):
        away = marks.points.mean(axis=0) - np.array(photo.size) / 2
        assert np.abs(away).max() < 25, photo.name
