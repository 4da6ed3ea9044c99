"""Which frames of a video are kept once their faces are known."""

import json

import numpy as np
import pytest
from bsface.errors import PhotoFailure
from bsface.images.decode import Limits
from bsface.images.read import read_photo
from bsface.landmarks.candidates import CandidateReader
from bsface.landmarks.differing import differing_faces
from bsface.landmarks.frame_selection import read_frames
from bsface.progress import never_cancelled
from bsface.settings import Settings
from bsface.surface.template import load_template
from fake_face import person_folder
from videos_for_tests import write_clip

COUNT = 8


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """Pixels and landmarks of a drawn person."""
    folder = person_folder(tmp_path_factory.mktemp("drawn"), count=COUNT, side=200)
    found = []
    for k in range(COUNT):
        pixels = read_photo(folder / f"{k}.png").pixels
        marks = json.loads((folder / f"{k}.json").read_text("utf-8"))["points"]
        found.append((pixels, np.array(marks)))
    return found


def reader(clip: str, points: list[np.ndarray]) -> CandidateReader:
    """With landmarks for the frames of a clip of ten frames a second."""
    from bsface.images.frames import time_code
    from bsface.landmarks.landmarks import Landmarks

    given = {}
    for k, marks in enumerate(points):
        name = f"{clip} {time_code(k / 10)}"
        given[name] = Landmarks(name, "468", marks, np.ones(468))
    return CandidateReader(load_template(), Settings(detector=False), given)


def test_faces_of_a_clip(tmp_path, drawn):
    """Every frame with a face is there, in order; one is set aside."""
    path = write_clip(tmp_path / "a.avi", [pixels for pixels, _ in drawn])
    known = reader("a.avi", [points for _, points in drawn])
    found = read_frames(known, path, "a.avi", ignore=["a.avi 00:00.300"])
    names = [name for name, _ in found]
    assert len(names) == COUNT and names[0] == "a.avi 00:00.000"
    assert names[-1] == "a.avi 00:00.300" and found[-1][1].code == "ignored"
    for name, faces in found[:-1]:
        (face,) = faces
        assert face.photo.name == name and face.failure is None


@pytest.mark.parametrize("limit", [3, 60])
def test_frames_whose_face_is_of_no_use_are_not_chosen(tmp_path, drawn, limit):
    pictures = [pixels for pixels, _ in drawn]
    pictures[::3] = [p // 60 for p in pictures[::3]]  # nearly black
    path = write_clip(tmp_path / "a.avi", pictures)
    known = reader("a.avi", [points for _, points in drawn])
    found = read_frames(known, path, "a.avi", limit=limit)
    sharp = {f"a.avi 00:00.{k}00" for k in range(COUNT) if k % 3}
    assert {name for name, _ in found} <= sharp
    assert len(found) == min(limit, len(sharp))
    assert all(face.failure is None for _, faces in found for face in faces)


def test_a_video_without_a_usable_frame_gives_one_reason(tmp_path, drawn):
    pictures = [pixels // 60 for pixels, _ in drawn]  # nearly black
    path = write_clip(tmp_path / "a.avi", pictures)
    known = reader("a.avi", [points for _, points in drawn])
    ((name, failure),) = read_frames(known, path, "a.avi")
    assert name == "a.avi" and failure.code == "dark"
    assert failure.reason.startswith("None of ")
    assert "frames of a.avi can be used: The face in a.avi 00:00." in failure.reason


def test_at_most_so_many_frames(tmp_path, drawn):
    path = write_clip(tmp_path / "a.avi", [pixels for pixels, _ in drawn])
    known = reader("a.avi", [points for _, points in drawn])
    found = read_frames(known, path, "a.avi", limit=5)
    assert len(found) == 5
    assert [name for name, _ in found] == sorted(name for name, _ in found)


def test_poses_are_spread(drawn):
    """Of frames that come in near-equal pairs, one of each pair is taken first."""
    pairs = [item for item in drawn[:6] for _ in range(2)]
    known = reader("a", [points for _, points in pairs])
    faces = []
    for (pixels, _), name in zip(pairs, known.given, strict=True):
        noise = np.random.default_rng(len(faces)).integers(0, 3, pixels.shape)
        shown = np.minimum(pixels.astype(int) + noise, 255).astype(np.uint8)
        faces.append(known.read(shown, name, never_cancelled))
    chosen = differing_faces([found for (found,) in faces], 6)
    assert sorted({k // 2 for k in chosen}) == list(range(6))


def test_a_video_without_a_face_is_one_sentence(tmp_path, drawn):
    path = write_clip(tmp_path / "a.avi", [pixels for pixels, _ in drawn[:3]])
    nobody = CandidateReader(load_template(), Settings(detector=False), {})
    ((name, failure),) = read_frames(nobody, path, "a.avi")
    assert name == "a.avi" and isinstance(failure, PhotoFailure)
    assert failure.code == "no_face" and "3 frames of a.avi" in failure.reason
    (tmp_path / "b.mp4").write_bytes(b"no film")
    ((name, failure),) = read_frames(nobody, tmp_path / "b.mp4", "b.mp4")
    assert name == "b.mp4" and "is not a video" in failure.reason


@pytest.mark.parametrize("left", [0, 0.4])
def test_a_video_that_changes_while_it_is_read_is_told(tmp_path, drawn, left):
    """Chosen frames that are not held may be gone when they are decoded again."""
    path = write_clip(tmp_path / "a.avi", [pixels for pixels, _ in drawn])
    known = reader("a.avi", [points for _, points in drawn])
    calls = 0

    def change() -> None:
        nonlocal calls
        calls += 1
        if calls == COUNT + 1:  # the end of the first time
            path.write_bytes(path.read_bytes()[: int(left * path.stat().st_size)])

    *found, (name, failure) = read_frames(
        known, path, "a.avi", limits=Limits(held_bytes=0), check_cancelled=change
    )
    assert len(found) < COUNT and (len(found) > 0) == (left > 0)
    assert name == "a.avi" and "while it was read" in failure.reason
