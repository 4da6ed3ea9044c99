"""A video in a folder of photos, and alone, through the whole of `prepare`."""

import json

import numpy as np
import pytest
from bsface.images.frames import time_code
from bsface.images.read import read_photo
from bsface.landmarks.landmarks import Landmarks
from bsface.prepare import Inputs, collect_photos
from bsface.settings import Settings
from fake_face import person_folder
from videos_for_tests import write_clip

COUNT = 6


@pytest.fixture(scope="module")
def mixed(tmp_path_factory):
    """Two photos with landmark files, and a clip of four with landmarks by name."""
    folder = person_folder(tmp_path_factory.mktemp("mixed"), count=COUNT, side=200)
    given, frames = {}, []
    for k in range(2, COUNT):
        path = folder / f"{k}.png"
        frames.append(read_photo(path).pixels)
        marks = json.loads(path.with_suffix(".json").read_text("utf-8"))["points"]
        name = f"clip.avi {time_code((k - 2) / 10)}"
        given[name] = Landmarks(name, "468", np.array(marks), np.ones(468))
        path.unlink()
        path.with_suffix(".json").unlink()
    return write_clip(folder / "clip.avi", frames), given


def test_photos_and_a_video_in_one_folder(mixed):
    clip, given = mixed
    out = "clip.avi 00:00.200"
    inputs = Inputs(landmarks=given, ignore=[out])
    found = collect_photos(clip.parent, Settings(detector=False), inputs)
    names = {"0.png", "1.png", *given} - {out}
    assert {photo.name for photo in found.photos} == names
    assert [failure.name for failure in found.failures] == [out]
    assert set(found.hashes) == names


def test_a_video_alone(mixed):
    clip, given = mixed
    inputs = Inputs(landmarks=given)
    found = collect_photos(clip, Settings(detector=False), inputs)
    assert [photo.name for photo in found.photos] == list(given)
