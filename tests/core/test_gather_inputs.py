"""What is given beside the photos, and what is no list of photos."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bsface.errors import PhotoFailure, ReconstructionError
from bsface.images.sources import is_name_of, photo_names
from bsface.prepare import Inputs, collect_photos
from bsface.problem import Constraint
from bsface.reconstruct import reconstruct
from bsface.surface.template import load_template
from photo_folders import NO_DETECTOR, front_landmarks


@pytest.mark.parametrize("photos", [[], ()])
def test_no_photos_given(photos):
    with pytest.raises(ReconstructionError, match="No photos"):
        collect_photos(photos)


@pytest.mark.parametrize("shape", [(40, 60), (40, 60, 3), (40, 60, 4)])
def test_one_picture_in_place_of_several(shape):
    with pytest.raises(ReconstructionError, match="list of them") as caught:
        collect_photos(np.zeros(shape, np.uint8))
    assert str(shape) in str(caught.value)


@pytest.mark.parametrize("photos", ["", np.array(3)], ids=["no name", "a number"])
def test_what_names_no_photos(photos):
    """An unset variable of a shell must not mean the folder one is in."""
    with pytest.raises((ReconstructionError, TypeError), match="give the folder|must"):
        collect_photos(photos, NO_DETECTOR)


def test_a_folder_in_a_list_of_photos(tmp_path):
    with pytest.raises(ReconstructionError, match="is a folder; give the photos in it"):
        collect_photos([tmp_path], NO_DETECTOR)


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


@pytest.mark.parametrize("weight", [np.inf, np.nan, -1, 1e9])
def test_weights_that_no_landmark_has(picture, weight):
    marks = front_landmarks("468", name="picture 1")
    marks = replace(marks, weight=np.full(468, float(weight)))
    with pytest.raises(ReconstructionError, match="weights from 0 to 100"):
        collect_photos([picture], NO_DETECTOR, Inputs(landmarks={"picture 1": marks}))


@pytest.mark.parametrize("softness", [float("nan"), float("inf"), -1.0, "a", None])
def test_softness_of_a_constraint_that_is_no_length(softness):
    with pytest.raises(ValueError, match="softness of a constraint"):
        Inputs(constraint=Constraint(np.ones((10, 11), bool), softness))


def test_a_constraint_of_another_kind():
    with pytest.raises(TypeError, match="must be a Constraint, not dict"):
        Inputs(constraint={"points": np.ones((10, 11), bool)})


def test_one_misnamed_among_others(picture):
    """A table may be of more photos, but a slip of a name must not pass unnoticed."""
    marks = front_landmarks("468", name="picture 1")
    given = {"picture 1": marks, "pictuer 2": marks}
    found = collect_photos([picture], NO_DETECTOR, Inputs(landmarks=given))
    told = "No photo has the name of these given landmarks: pictuer 2."
    assert found.hints == (told,)


def test_names_are_unlike_each_other_whatever_the_files_are_called():
    """Two names that are no text look alike; a number may be another's name."""
    wanted = ["a\udce9.jpg", "a\udcea.jpg", "b.jpg", "a?.jpg (1)", "c\nd.jpg"]
    found = photo_names(wanted)
    assert found == ["a?.jpg (2)", "a?.jpg (3)", "b.jpg", "a?.jpg (1)", "c\\nd.jpg"]


@pytest.mark.parametrize(
    ("name", "known"),
    [
        ("clip.mp4 00:12.433", True),
        ("clip.mp4 00:12.433 frame 300", True),
        ("clip.mp4", True),
        ("a.jpg", True),
        ("a.jpg typo", False),
        ("clip.mp4frame", False),
    ],
)
def test_names_of_frames_begin_with_that_of_their_video(name, known):
    assert is_name_of(name, ("a.jpg", "clip.mp4")) == known


@pytest.mark.parametrize("value", ["yes", 1, None])
def test_recursive_is_a_switch_for_lists_too(value):
    with pytest.raises(TypeError, match="recursive must be true or false"):
        reconstruct([np.zeros((40, 40, 3), np.uint8)], recursive=value)


@pytest.mark.parametrize("shape", [(4, 4), (121, 20)])
def test_a_template_of_another_size_is_named(shape):
    surface = load_template().surface.resampled(shape)
    with pytest.raises(ReconstructionError, match=r"given as the template has \d+ x"):
        reconstruct([np.zeros((40, 40, 3), np.uint8)], template=surface)


def test_the_reason_of_a_failure_is_a_sentence():
    with pytest.raises(TypeError, match=r"reason must be a sentence, not NoneType\.$"):
        PhotoFailure("a.jpg", "blurred", None)
