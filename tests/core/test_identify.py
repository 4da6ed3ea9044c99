"""The person's face in each photo of a folder; who else is found is named."""

from dataclasses import replace
from pathlib import Path

import cv2
import fake_face
import numpy as np
import pytest
from bsface.errors import PhotoFailure, ReconstructionError
from bsface.identity.identify import identify
from bsface.images.folder import list_photos
from bsface.images.read import read_photo
from bsface.landmarks.candidates import CandidateReader
from bsface.landmarks.face_models import ModelFiles
from bsface.prepare import Inputs, collect_photos
from bsface.progress import never_cancelled
from bsface.settings import Settings
from bsface.surface.template import load_template

ROOT = Path(__file__).resolve().parents[2]
LFW = ROOT.parent / "shared" / "photos" / "lfw"
FILES_ONLY = Settings(detector=False)


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    """Faces of eight drawn photos, with landmark files."""
    folder = tmp_path_factory.mktemp("drawn")
    fake_face.person_folder(folder, 8)
    reader = CandidateReader(load_template(), FILES_ONLY, {})
    return [reader.read(p, p.name, never_cancelled) for p in list_photos(folder)]


def by_name(others):
    """Describes photos by their names: those given are of another person."""
    return lambda photo, _: np.eye(128)[int(photo.name in others)] * 0.6


def test_outlier_is_left_out_by_name(outcome):
    chosen, warnings = identify(outcome, describe=by_name({"3.png"}))
    failure = chosen[3]
    assert isinstance(failure, PhotoFailure) and failure.code == "other_person"
    assert "3.png" in failure.reason and "one_person" in failure.reason
    assert [f[0].photo.name for k, f in enumerate(outcome) if k != 3] == [
        face.photo.name for k, face in enumerate(chosen) if k != 3
    ]
    assert warnings == ()  # one of eight: the failure says it


def test_a_second_person_in_many_photos_is_told(outcome):
    _, (sentence,) = identify(outcome, describe=by_name({"1.png", "4.png", "6.png"}))
    assert "more than one person" in sentence and "1.png, 4.png, 6.png" in sentence


def test_switched_off_all_photos_are_used(outcome):
    describe = by_name({"1.png", "4.png", "6.png"})
    chosen, warnings = identify(outcome, one_person=False, describe=describe)
    assert chosen == [faces[0] for faces in outcome] and warnings == ()


def test_face_chosen_by_hand_is_kept_with_a_doubt(outcome):
    (face,) = outcome[3]
    marks = replace(face.landmarks, source="hand")
    outcome = [*outcome[:3], (replace(face, landmarks=marks),), *outcome[4:]]
    chosen, (sentence,) = identify(outcome, describe=by_name({"3.png"}))
    assert chosen[3].landmarks.source == "hand"
    assert "Somebody else may be in 3.png" in sentence


def test_face_that_cannot_be_described_is_used(outcome):
    def describe(photo, _):
        return None if photo.name == "3.png" else np.ones(128)

    chosen, warnings = identify(outcome, describe=describe)
    assert chosen == [faces[0] for faces in outcome] and warnings == ()


def test_right_one_of_several_faces_and_its_number(outcome):
    """In one photo somebody else comes first, and larger."""
    (face,) = outcome[3]
    x = face.landmarks.points[:, 0].mean()
    other = replace(
        face,
        photo=replace(face.photo, name="other"),
        landmarks=replace(face.landmarks, points=face.landmarks.points - (x, 0)),
        fit=replace(face.fit, eye_distance=2 * face.fit.eye_distance),
    )
    outcome = [*outcome[:3], (other, face), *outcome[4:]]
    chosen, warnings = identify(outcome, describe=by_name({"other"}))
    assert chosen[3].photo.name == "3.png" and warnings == ()
    assert "face 2 of 2 from the left chosen: most similar" in chosen[3].landmarks.note


def test_person_of_no_use_is_not_replaced_by_a_bystander(outcome):
    (face,) = outcome[3]
    blurred = replace(face, failure=PhotoFailure("3.png", "blurred", "It is blurred."))
    other = replace(face, photo=replace(face.photo, name="other"))
    outcome = [*outcome[:3], (other, blurred), *outcome[4:]]
    assert identify(outcome, describe=by_name({"other"}))[0][3] is blurred.failure


def test_missing_model_is_told_where_it_is_not_needed(outcome, tmp_path):
    nowhere = ModelFiles(tmp_path / "a", tmp_path / "b", tmp_path / "recognition.dat")
    chosen, (sentence,) = identify(outcome, models=nowhere)
    assert chosen == [faces[0] for faces in outcome]
    assert "was not checked" in sentence and "recognition.dat" in sentence
    with pytest.raises(ReconstructionError, match=r"recognition\.dat"):
        identify([outcome[0] * 2, *outcome[1:]], models=nowhere)


# --- real photos ----------------------------------------------------------------------


def press(person, *numbers):
    """Photos of a person, both by number in the order of their names."""
    if not LFW.is_dir():
        pytest.skip("the press photos are not here (../shared/photos/lfw)")
    photos = list_photos(sorted(LFW.iterdir())[person])
    return [photos[k - 1] for k in numbers]


def test_press_photos_of_another_person_are_found(models):
    ours = press(1, *range(20, 26))
    (other,) = press(3, 1)
    found = collect_photos([*ours, other], inputs=Inputs(models=models))
    assert [f.name for f in found.failures] == [other.name]
    assert [p.path for p in found.photos] == ours and found.identity_warnings == ()


def test_person_is_chosen_beside_a_larger_face(models):
    """In one picture somebody else stands beside the person, larger."""
    alone = press(1, 20, 21, 22)
    (other,) = press(3, 1)
    person = read_photo(press(1, 23)[0]).pixels
    larger = cv2.resize(read_photo(other).pixels, None, fx=1.5, fy=1.5)
    person = cv2.copyMakeBorder(
        person, 0, larger.shape[0] - len(person), 0, 0, cv2.BORDER_CONSTANT
    )
    photos = [read_photo(path).pixels for path in alone]
    found = collect_photos([*photos, np.hstack([larger, person])])
    marks = found.landmarks[-1]
    assert marks.faces > 1 and "chosen: most similar" in marks.note
    assert marks.points[:, 0].mean() > larger.shape[1]
