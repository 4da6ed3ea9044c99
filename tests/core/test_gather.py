"""From folders, clean and dirty, to cut-outs with landmarks."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from bsface.errors import Cancelled, PhotoFailure, ReconstructionError
from bsface.images.folder import list_photos
from bsface.images.read import read_photo
from bsface.landmarks.candidates import CandidateReader
from bsface.landmarks.face_models import find_models
from bsface.landmarks.landmarks import Landmarks, write_landmarks
from bsface.prepare import Inputs, collect_photos
from bsface.problem import Constraint
from bsface.progress import never_cancelled
from bsface.settings import Settings
from bsface.surface.template import load_template

ROOT = Path(__file__).resolve().parents[2]
PHOTOS = ROOT / "examples" / "photos"
LFW = ROOT.parent / "shared" / "photos" / "lfw"
TEMPLATE = load_template()
NO_DETECTOR = Settings(landmarks="468", detector=False)


@pytest.fixture(scope="module")
def models():
    try:
        return find_models()
    except ReconstructionError as error:
        pytest.skip(f"the model files are not installed: {error}")


@pytest.fixture
def folder(tmp_path):
    path = tmp_path / "photos"
    path.mkdir()
    return path


@pytest.fixture(scope="module")
def picture():
    return read_photo(PHOTOS / "000.jpg").pixels


def save(path: Path, image: np.ndarray) -> None:
    done, data = cv2.imencode(path.suffix, np.ascontiguousarray(image[..., ::-1]))
    assert done
    path.write_bytes(data.tobytes())


def front_landmarks(scheme="68", centre=(200.0, 200.0), scale=1.2, name="a.png"):
    """The template seen from the front, without any detector."""
    xyz = TEMPLATE.landmark_xyz[TEMPLATE.schemes[scheme]]
    points = xyz[:, :2] * (scale, -scale) + centre
    return Landmarks(name, scheme, points, np.ones(len(points)), source="hand")


def codes(collection) -> dict[str, str]:
    return {failure.name: failure.code for failure in collection.failures}


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


# --- landmark files, hands ---------------------------------------------------


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


def test_copies_given_as_arrays_get_a_doubt_too(picture):
    grey = np.clip(picture.astype(int) + 1, 0, 255).astype(np.uint8)
    marks = {f"picture {k}": front_landmarks() for k in (1, 2, 3)}
    pictures = [picture, grey, np.ascontiguousarray(picture[:, ::-1])]
    found = collect_photos(pictures, NO_DETECTOR, Inputs(landmarks=marks))
    notes = [marks.note for marks in found.landmarks]
    assert notes == ["", "looks like a copy of picture 1", ""]


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


# --- photos that are no use --------------------------------------------------


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


def test_forty_times_the_same_photo(models, folder, picture):
    save(folder / "0.png", picture)
    for number in range(1, 40):
        shutil.copy(folder / "0.png", folder / f"{number}.png")
    found = collect_photos(folder)
    assert len(found.photos) == 1
    assert set(codes(found).values()) == {"duplicate"}
    assert len(found.failures) == 39


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
    with pytest.raises(ReconstructionError, match="1 set aside.*in 1.png"):
        collect_photos(folder, inputs=Inputs(ignore=("0.png",)))


@pytest.mark.parametrize("photos", [[], ()])
def test_no_photos_given(photos):
    with pytest.raises(ReconstructionError, match="No photos"):
        collect_photos(photos)


@pytest.mark.parametrize("shape", [(40, 60), (40, 60, 3), (40, 60, 4)])
def test_one_picture_in_place_of_several(shape):
    with pytest.raises(ReconstructionError, match="list of them") as caught:
        collect_photos(np.zeros(shape, np.uint8))
    assert str(shape) in str(caught.value)


def test_missing_models_end_the_job_with_the_remedy(tmp_path, monkeypatch, picture):
    for name in ("BSFACE_MODELS", "XDG_CACHE_HOME"):
        monkeypatch.setenv(name, str(tmp_path))
    with pytest.raises(ReconstructionError, match="bsface models fetch"):
        collect_photos([picture])


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


@pytest.mark.parametrize(
    "person",
    ["Arnold_Schwarzenegger", "Colin_Powell", "Donald_Rumsfeld", "George_W_Bush"],
)
def test_press_photos(models, person):
    """The face of the person is the one in the middle of the picture."""
    folder = LFW / person
    if not folder.is_dir():
        pytest.skip("the press photos (../shared/photos/lfw) are not there")
    found = collect_photos(list_photos(folder)[::3])
    assert len(found.photos) == 12
    for photo, marks in zip(found.photos, found.landmarks, strict=True):
        away = marks.points.mean(axis=0) - np.array(photo.size) / 2
        assert np.abs(away).max() < 25, photo.name


def test_names_to_leave_out_must_be_those_of_photos(picture):
    """A slip would let the photo in, unseen."""
    with pytest.raises(ReconstructionError, match=r"no photo 'b.png' to leave out"):
        collect_photos(
            [picture] * 7, NO_DETECTOR, Inputs(ignore=["picture 1", "b.png"])
        )


@pytest.mark.parametrize("ignore", [5, None, b"a.png", [5], [b"a.png"], "a.png"])
def test_what_is_no_list_of_names_to_leave_out(ignore):
    with pytest.raises(TypeError, match="ignore must be a list of photo names"):
        Inputs(ignore=ignore)


def test_names_to_leave_out_come_in_any_list(picture):
    """An iterator that is read twice would leave nothing out the second time."""
    found = [Inputs(ignore=kind(["a.png"])).ignore for kind in (list, tuple, set, iter)]
    assert found == [("a.png",)] * 4
    assert Inputs(ignore=[Path("sub/a.png")]).ignore == ("sub/a.png",)


@pytest.mark.parametrize("landmarks", ["68", 5, [1]])
def test_landmarks_that_are_no_mapping(landmarks):
    with pytest.raises(TypeError, match="landmarks must map photo names"):
        Inputs(landmarks=landmarks)


def test_landmarks_of_no_photo_that_is_there(picture):
    """All of them misnamed: the detector's would be used without a word."""
    marks = front_landmarks("468", name="a.png")
    with pytest.raises(ReconstructionError, match="no photo 'a.png' to have"):
        collect_photos([picture], NO_DETECTOR, Inputs(landmarks={"a.png": marks}))


@pytest.mark.parametrize("softness", [float("nan"), float("inf"), -1.0, "a", None])
def test_softness_of_a_constraint_that_is_no_length(softness):
    with pytest.raises(ValueError, match="softness of a constraint"):
        Inputs(constraint=Constraint(np.ones((10, 11), bool), softness))


def test_a_constraint_of_another_kind():
    with pytest.raises(TypeError, match="must be a Constraint, not dict"):
        Inputs(constraint={"points": np.ones((10, 11), bool)})


@pytest.mark.parametrize("photos", ["", np.array(3)], ids=["no name", "a number"])
def test_what_names_no_photos(photos):
    """An unset variable of a shell must not mean the folder one is in."""
    with pytest.raises((ReconstructionError, TypeError), match="give the folder|must"):
        collect_photos(photos, NO_DETECTOR)


def test_a_folder_in_a_list_of_photos(tmp_path):
    with pytest.raises(ReconstructionError, match="is a folder; give the photos in it"):
        collect_photos([tmp_path], NO_DETECTOR)


@pytest.mark.parametrize("weight", [np.inf, np.nan, -1, 1e9])
def test_weights_that_no_landmark_has(picture, weight):
    marks = front_landmarks("468", name="picture 1")
    marks = replace(marks, weight=np.full(468, float(weight)))
    with pytest.raises(ReconstructionError, match="weights from 0 to 100"):
        collect_photos([picture], NO_DETECTOR, Inputs(landmarks={"picture 1": marks}))
