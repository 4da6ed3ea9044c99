"""The person's face in each photo; outlier identities found, named, and nobody else."""

from dataclasses import replace
from pathlib import Path

import cv2
import fake_face
import numpy as np
import pytest
from bsface.errors import PhotoFailure, ReconstructionError
from bsface.identity import face_network
from bsface.identity.choice import choose
from bsface.identity.descriptor import (
    ANCHORS,
    PLACES,
    anchor_points,
    describe_face,
    face_crop,
)
from bsface.identity.face_network import FaceNetwork, read_weights
from bsface.identity.identify import identify
from bsface.identity.same_person import split_identities
from bsface.images.folder import list_photos
from bsface.images.read import read_photo
from bsface.landmarks.candidates import CandidateReader
from bsface.landmarks.face_models import ModelFiles, find_models
from bsface.landmarks.landmarks import Landmarks
from bsface.prepare import Inputs, collect_photos
from bsface.progress import never_cancelled
from bsface.settings import Settings
from bsface.surface.template import load_template
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

ROOT = Path(__file__).resolve().parents[2]
PHOTOS = ROOT / "examples" / "photos"
LFW = ROOT.parent / "shared" / "photos" / "lfw"
FILES_ONLY = Settings(detector=False)


def distances_of(sizes, within=0.4, between=0.75, noise=0.04, seed=0):
    """Matrix of people with some photos each, in shuffled order, and who is who."""
    rng = np.random.default_rng(seed)
    who = rng.permutation(np.repeat(np.arange(len(sizes)), sizes))
    scatter = rng.normal(0, noise, (len(who), len(who)))
    distance = np.where(who[:, None] == who, within, between) + scatter + scatter.T
    np.fill_diagonal(distance, 0)
    return distance, who


def split(distance, **changed):
    n = len(distance)
    known = {"turn": np.zeros(n), "score": np.ones(n)} | changed
    return split_identities(distance, **known)


# --- from distances to people ---------------------------------------------------------


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8, 20, 40])
@pytest.mark.parametrize("seed", range(4))
def test_one_person_stays_whole(count, seed):
    found = split(distances_of([count], seed=seed)[0])
    assert found.person.tolist() == list(range(count))
    assert found.others == () and len(found.doubtful) == 0


@pytest.mark.parametrize(
    "sizes", [(3, 1), (20, 1), (25, 5), (18, 17), (20, 3, 1), (12, 4, 4)]
)
def test_outlier_identities_are_found(sizes):
    distance, who = distances_of(sizes)
    found = split(distance)
    assert found.person.tolist() == np.flatnonzero(who == 0).tolist()
    assert [len(group) for group in found.others] == list(sizes[1:])
    assert all(len(set(who[group])) == 1 for group in found.others)
    assert len(found.doubtful) == 0


def test_of_two_equal_groups_the_first_photo_decides():
    distance, who = distances_of((10, 10))
    found = split(distance)
    assert found.person.tolist() == np.flatnonzero(who == who[0]).tolist()


def test_less_far_is_a_doubt_and_keeps_its_photo():
    distance, _ = distances_of([30], noise=0.01)
    distance[7], distance[:, 7] = 0.58, 0.58
    distance[7, 7] = 0
    found = split(distance)
    assert found.person.tolist() == list(range(30))
    assert found.doubtful.tolist() == [7]


def test_pose_and_landmarks_that_are_unsure_give_room():
    """A profile of the person is further away; so is a face that is hardly seen."""
    distance, _ = distances_of([30], noise=0.01)
    distance[7], distance[:, 7] = 0.63, 0.63
    distance[7, 7] = 0
    far = np.arange(30) == 7
    assert [group.tolist() for group in split(distance).others] == [[7]]
    for told in ({"turn": 60.0 * far}, {"score": 1 - 0.2 * far}):
        found = split(distance, **told)
        assert found.others == () and found.doubtful.tolist() == [7]


def test_photos_with_landmarks_by_hand_are_only_doubted():
    distance, who = distances_of((12, 2))
    other = who == 1
    found = split(distance, keep=other)
    assert found.others == ()
    assert found.doubtful.tolist() == np.flatnonzero(other).tolist()


@pytest.mark.parametrize("count", [2, 3])
def test_few_photos_of_as_many_people_are_all_doubted(count):
    found = split(distances_of([1] * count)[0])
    assert found.doubtful.tolist() == found.person.tolist() == list(range(count))


@given(st.lists(st.integers(1, 12), min_size=1, max_size=4), st.integers(0, 99))
@settings(deadline=None, max_examples=50)
def test_order_of_the_photos_does_not_matter(sizes, seed):
    sizes = [max(sizes) + 1, *sizes]
    distance, who = distances_of(sizes, seed=seed)
    order = np.random.default_rng(seed).permutation(len(who))
    turned = split(distance[np.ix_(order, order)])
    assert sorted(order[turned.person]) == split(distance).person.tolist()


# --- from faces to the person's ------------------------------------------------------


def crowd(photos, seed=0):
    """Photos with faces of people by number: photo, distances, who."""
    rng = np.random.default_rng(seed)
    photo = np.repeat(np.arange(len(photos)), [len(people) for people in photos])
    who = np.concatenate([rng.permutation(people) for people in photos])
    scatter = rng.normal(0, 0.03, (len(who), len(who)))
    # Persons of a negative number are in one photo only.
    same = (who[:, None] == who) & (who >= 0)
    distance = np.where(same, 0.4, 0.75) + scatter + scatter.T
    np.fill_diagonal(distance, 0)
    return photo, distance, who


@pytest.mark.parametrize("seed", range(5))
def test_person_is_chosen_among_others(seed):
    """A partner in five photos, strangers who are larger: never the person."""
    photos = [[0]] * 6 + [[0, 1]] * 5 + [[0, -1, -1]] * 8
    photo, distance, who = crowd(photos, seed)
    size = np.where(who == 0, 0.1, 0.3)
    found = choose(photo, distance, size)
    assert (who[found.faces] == 0).all()
    assert photo[found.faces].tolist() == list(range(len(photos)))
    assert len(found.rival) == 0


def test_person_need_not_be_alone_in_any_photo():
    photo, distance, who = crowd([[0, -1]] * 6)
    assert (who[choose(photo, distance, np.ones(12)).faces] == 0).all()


@pytest.mark.parametrize("larger", [0, 1])
def test_of_two_people_in_all_photos_the_larger_and_the_other_is_told(larger):
    photo, distance, who = crowd([[0, 1]] * 7)
    found = choose(photo, distance, np.where(who == larger, 0.2, 0.1))
    assert (who[found.faces] == larger).all()
    assert sorted(found.rival) == np.flatnonzero(who != larger).tolist()


def test_in_one_photo_the_largest():
    photo, distance, _ = crowd([[0, -1, -1]])
    found = choose(photo, distance, np.array([0.1, 0.3, 0.2]))
    assert found.faces.tolist() == [1] and len(found.rival) == 0


@given(st.integers(0, 10_000))
@settings(deadline=None, max_examples=50)
def test_choice_does_not_depend_on_the_order_of_the_photos(seed):
    rng = np.random.default_rng(seed)
    photo, distance, _ = crowd([[0], [0, 1], [0, 1, -1], [0, -1], [0, -1], [1, -1]])
    size = rng.uniform(0.1, 0.2, len(photo))
    order = rng.permutation(len(photo))
    turned = choose(photo[order], distance[np.ix_(order, order)], size[order])
    assert sorted(order[turned.faces]) == sorted(choose(photo, distance, size).faces)


# --- the network ---------------------------------------------------------------------


@pytest.fixture(scope="module")
def models():
    try:
        return find_models()
    except ReconstructionError as error:
        pytest.skip(f"the model files are not installed: {error}")


@pytest.fixture(scope="module")
def network(models):
    return FaceNetwork(models.recognition)


def forward(picture, convolutions, last):
    """The network written out in NumPy, as dlib defines it."""

    def windows(x, side, stride):
        view = np.lib.stride_tricks.sliding_window_view(x, (side, side), (1, 2))
        return view[:, ::stride, ::stride]

    def convolved(x, layer):
        x = np.pad(x, ((0, 0), *[(layer.padding,) * 2] * 2))
        view = windows(x, layer.weight.shape[2], layer.stride)
        out = np.einsum("ihwab,oiab->ohw", view, layer.weight, optimize=True)
        return out + layer.bias[:, None, None]

    def grown(x, shape):
        return np.pad(x, [(0, b - a) for a, b in zip(x.shape, shape, strict=True)])

    x = ((picture - face_network.MEAN_RGB) / 256).transpose(2, 0, 1).astype(float)
    x = np.maximum(convolved(x, convolutions[0]), 0)
    x = windows(x, 3, 2).max(axis=(3, 4))
    for one, two in zip(convolutions[1::2], convolutions[2::2], strict=True):
        y = convolved(np.maximum(convolved(x, one), 0), two)
        if one.stride == 2:
            x = windows(x, 2, 2).mean(axis=(3, 4))
        shape = np.maximum(x.shape, y.shape)
        x = np.maximum(grown(x, shape) + grown(y, shape), 0)
    return x.mean(axis=(1, 2)) @ last


def test_opencv_computes_what_the_layers_say(models, network):
    """The model that OpenCV runs, against its definition written out."""
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 256, (150, 150, 3)).astype(np.uint8)
    picture = cv2.GaussianBlur(picture, (0, 0), 5)
    layers = read_weights(models.recognition.read_bytes())
    both = [forward(view, *layers) for view in (picture, picture[:, ::-1])]
    found = network.describe(picture)
    np.testing.assert_allclose(found, np.mean(both, axis=0), atol=2e-5)
    assert np.linalg.norm(found) > 0.5


def test_a_mirror_image_has_the_same_descriptor(network):
    rng = np.random.default_rng(1)
    picture = rng.integers(0, 256, (150, 150, 3)).astype(np.uint8)
    np.testing.assert_allclose(
        network.describe(picture), network.describe(picture[:, ::-1]), atol=1e-12
    )


@pytest.mark.parametrize("part", [0, 10, 400, 30_000, 22_000_000])
def test_damaged_file_of_the_network_is_told(models, tmp_path, part):
    path = tmp_path / "network.dat"
    path.write_bytes(models.recognition.read_bytes()[:part])
    with pytest.raises(ReconstructionError, match=r"network\.dat is damaged"):
        FaceNetwork(path)


@given(st.binary(max_size=300))
@settings(deadline=None, max_examples=100)
def test_any_bytes_are_read_or_refused(data):
    with pytest.raises(ValueError):
        read_weights(b"\x05con_4\x01\x02" + data)


def test_face_is_cut_out_upright_whatever_its_place_and_turn():
    rng = np.random.default_rng(2)
    for _ in range(5):
        angle, size = rng.uniform(-3, 3), rng.uniform(40, 300)
        turn = np.array(
            [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        )
        shift = rng.uniform(0, 500, 2)
        crop = face_crop(size * PLACES @ turn.T + shift)
        # The square with its margin: twice the side from edge to edge.
        corner = crop.to_image(np.zeros(2), 1)
        opposite = crop.to_image(np.ones(2), 1)
        np.testing.assert_allclose(corner, size * turn @ (-0.25, -0.25) + shift)
        np.testing.assert_allclose(opposite, size * turn @ (1.25, 1.25) + shift)


@pytest.mark.parametrize("scheme", ["468", "68", "40"])
def test_all_schemes_have_the_anchors(scheme):
    rows = load_template().schemes[scheme]
    points = np.stack([rows, rows], axis=1).astype(float)
    marks = Landmarks("a", scheme, points, np.ones(len(rows)))
    assert anchor_points(marks)[:, 0].tolist() == list(ANCHORS)
    weight = np.ones(len(rows))
    weight[np.flatnonzero(np.asarray(rows) == ANCHORS[0])] = 0
    assert anchor_points(replace(marks, weight=weight)) is None


# --- the folder -----------------------------------------------------------------------


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
    if not LFW.is_dir():
        pytest.skip("the press photos are not here (../shared/photos/lfw)")
    return [LFW / person / f"{person}_{k:04d}.jpg" for k in numbers]


def test_press_photos_of_another_person_are_found(models):
    ours = press("Colin_Powell", *range(20, 26))
    found = collect_photos(
        [*ours, *press("George_W_Bush", 1)], inputs=Inputs(models=models)
    )
    assert [f.name for f in found.failures] == ["George_W_Bush_0001.jpg"]
    assert [p.path for p in found.photos] == ours and found.identity_warnings == ()


def test_person_is_chosen_beside_a_larger_face(models):
    """In one picture somebody else stands beside the person, larger."""
    alone = press("Colin_Powell", 20, 21, 22)
    (other,) = press("George_W_Bush", 1)
    person = read_photo(press("Colin_Powell", 23)[0]).pixels
    larger = cv2.resize(read_photo(other).pixels, None, fx=1.5, fy=1.5)
    person = cv2.copyMakeBorder(
        person, 0, larger.shape[0] - len(person), 0, 0, cv2.BORDER_CONSTANT
    )
    photos = [read_photo(path).pixels for path in alone]
    found = collect_photos([*photos, np.hstack([larger, person])])
    marks = found.landmarks[-1]
    assert marks.faces > 1 and "chosen: most similar" in marks.note
    assert marks.points[:, 0].mean() > larger.shape[1]


def test_photos_of_one_made_up_person_are_close(network):
    """Pose, light and expression vary; within the distance of one person."""
    reader = CandidateReader(load_template(), Settings(), {})
    faces = [
        reader.read(path, path.name, never_cancelled)[0]
        for path in list_photos(PHOTOS)[::5]
    ]
    rows = [describe_face(f.photo, f.landmarks, network) for f in faces]
    mean = cdist(rows, rows).sum(axis=1) / (len(rows) - 1)
    assert mean.max() < 0.5
