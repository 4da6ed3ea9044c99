"""Strangers among the photos: found, named, and nobody else."""

import shutil
from dataclasses import replace
from pathlib import Path

import fake_face
import numpy as np
import pytest
from bsface.errors import ReconstructionError
from bsface.identity.descriptor import (
    Appearance,
    MeanAppearance,
    describe_appearance,
    general_of,
    mean_pattern,
    pattern_variance,
    similarity,
    stored_mean_appearance,
)
from bsface.identity.same_person import FEWEST, split_identities
from bsface.landmarks.face_models import find_models
from bsface.landmarks.landmarks import read_landmarks
from bsface.prepare import Inputs, collect_photos
from bsface.settings import Settings
from bsface.surface.template import load_template

ROOT = Path(__file__).resolve().parents[2]
PHOTOS = ROOT / "examples" / "photos"
LFW = ROOT.parent / "shared" / "photos" / "lfw"
FILES_ONLY = Settings(detector=False)


def likeness_of(sizes, inside=0.4, across=0.05, noise=0.08, seed=0):
    """Matrix of people with some photos each, in shuffled order, and who is who."""
    rng = np.random.default_rng(seed)
    who = rng.permutation(np.repeat(np.arange(len(sizes)), sizes))
    n = len(who)
    scatter = rng.normal(0, noise, (n, n))
    C = np.where(who[:, None] == who, inside, across) + (scatter + scatter.T) / 2**0.5
    np.fill_diagonal(C, 1)
    return C, 1 - np.eye(n), who


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """Eight drawn photos of one person and three of another, varied in pose, light."""
    folder = tmp_path_factory.mktemp("drawn")
    fake_face.person_folder(folder / "anna", 8)
    fake_face.person_folder(folder / "bert", 3, seed=5, skin=fake_face.other_skin)
    anna = sorted((folder / "anna").glob("*.png"))
    return anna, sorted((folder / "bert").glob("*.png"))


# --- from the likeness of pairs to people ---------------------------------------------


@pytest.mark.parametrize("count", [FEWEST, 8, 20, 40])
@pytest.mark.parametrize("seed", range(4))
def test_one_person_stays_whole(count, seed):
    C, W, _ = likeness_of([count], seed=seed)
    found = split_identities(C, W)
    assert found.person.tolist() == list(range(count))
    assert found.strangers == found.doubtful == ()


@pytest.mark.parametrize("sizes", [(20, 1), (25, 5), (18, 17), (20, 3, 1), (12, 4, 4)])
def test_strangers_are_found(sizes):
    C, W, who = likeness_of(sizes)
    found = split_identities(C, W)
    assert found.person.tolist() == np.flatnonzero(who == 0).tolist()
    apart = np.sort(np.concatenate(found.strangers))
    assert apart.tolist() == np.flatnonzero(who != 0).tolist()
    assert found.doubtful == ()


def test_of_two_equal_groups_the_first_photo_decides():
    C, W, who = likeness_of((10, 10))
    assert (
        split_identities(C, W).person.tolist() == np.flatnonzero(who == who[0]).tolist()
    )


def test_less_unlike_is_a_doubt_and_keeps_its_photo():
    n = 30
    C, W, _ = likeness_of([n], noise=0.01)
    low = 0.4 * (0.45 - 0.35 / n**0.5 + 0.03)  # just above the limit for one photo
    C[7], C[:, 7] = low, low
    found = split_identities(C, W)
    assert found.person.tolist() == list(range(n))
    assert [g.tolist() for g in found.doubtful] == [[7]]


def test_photos_that_are_like_none_are_judged_by_level_not_by_group():
    """Blurred photos are less like everybody, each other included: no second person."""
    C, W, _ = likeness_of([30], noise=0.02)
    clear = np.ones(30)
    clear[::3] = 0.75
    C = C * np.outer(clear, clear)
    assert split_identities(C, W).strangers == ()


def test_order_of_the_photos_does_not_matter():
    C, W, who = likeness_of((14, 6, 1))
    order = np.random.default_rng(3).permutation(len(who))
    turned = split_identities(C[np.ix_(order, order)], W)
    assert sorted(order[turned.person]) == split_identities(C, W).person.tolist()


@pytest.mark.parametrize("count", range(FEWEST))
def test_too_few_photos_say_nothing(count):
    found = split_identities(-np.ones((count, count)), np.ones((count, count)))
    assert len(found.person) == count and found.strangers == found.doubtful == ()


# --- from photos to their likeness ----------------------------------------------------


def test_general_patterns_are_their_own_mirror_images():
    general = stored_mean_appearance()
    for stored in (general.mean, general.variance):
        assert np.isfinite(stored).all() and np.ptp(stored) > 0.3
        np.testing.assert_array_equal(stored, stored[..., ::-1])
    assert general.variance.min() >= 0


def test_each_pattern_in_general_leaves_one_person_out():
    rng = np.random.default_rng(4)
    people = [(m, m) for m in rng.uniform(0, 1, (3, 8, 8)).astype(np.float32)]
    general = general_of(people, members=True)
    for k, mean in enumerate(general.mean):
        alone = general_of(people[:k] + people[k + 1 :])
        np.testing.assert_allclose(mean, alone.mean[0], atol=1e-6)


def test_of_a_known_person_the_pattern_without_them_is_taken():
    rng = np.random.default_rng(6)
    shared, *own = rng.normal(0, 0.3, (4, 96, 96)).astype(np.float32)
    ones = np.ones((96, 96), np.float32)
    general = general_of([(shared + o, ones) for o in own], members=True)
    noise = rng.normal(0, 0.1, (6, 96, 96)).astype(np.float32)
    seen = Appearance(shared + own[1] + noise, np.ones((6, 96, 96), np.float32))
    known, _ = similarity(seen, general)
    alone, _ = similarity(seen, MeanAppearance(general.mean[1:2], general.variance))
    np.testing.assert_array_equal(known, alone)


def test_variance_is_that_within_the_sets():
    """The mean may differ between sets, as expressions do: that is no variance."""
    half = np.full((96, 96), 0.5, np.float32)
    sets = [
        Appearance(np.stack([a * half, b * half]), np.ones((2, 96, 96), np.float32))
        for a, b in ((-1, 1), (2, 2))
    ]
    np.testing.assert_allclose(pattern_variance(sets), 0.125, rtol=0.01)


def test_pattern_forgets_light_exposure_and_colour(drawn):
    found = collect_photos(drawn[0][:1], FILES_ONLY)
    photo, marks = found.photos[0], found.landmarks[0]
    linear = photo.linear().astype(float)
    x = np.linspace(0.6, 1.4, linear.shape[1])[None, :, None]
    other = 0.5 * linear * x * (1.0, 0.9, 0.8)
    encoded = np.where(
        other <= 0.0031308, 12.92 * other, 1.055 * other ** (1 / 2.4) - 0.055
    )
    changed = replace(photo, pixels=np.uint16(np.round(65535 * encoded)))
    a, b = (
        describe_appearance([photo], [marks]),
        describe_appearance([changed], [marks]),
    )
    np.testing.assert_array_equal(a.weight, b.weight)
    both = a.weight[0] > 0
    assert np.corrcoef(a.pattern[0][both], b.pattern[0][both])[0, 1] > 0.95


def test_likeness_is_symmetric_and_blind_to_what_is_not_seen():
    rng = np.random.default_rng(0)
    pattern = rng.uniform(-1, 1, (3, 96, 96)).astype(np.float32)
    weight = np.ones_like(pattern)
    weight[0, :, :40] = 0
    none = MeanAppearance(
        np.zeros((1, 96, 96), np.float32), np.ones((96, 96), np.float32)
    )
    C, W = similarity(Appearance(pattern, weight), none)
    np.testing.assert_allclose(C, C.T)
    np.testing.assert_allclose(np.diag(C), 1, rtol=1e-6)
    assert (np.diag(W) == 0).all()
    pattern[0, :, :40] = 7.0
    np.testing.assert_allclose(similarity(Appearance(pattern, weight), none)[0], C)


def test_what_all_faces_share_makes_nobody_alike():
    """Two people on one common pattern: unlike once it is subtracted."""
    rng = np.random.default_rng(1)
    shared, *own = rng.uniform(-1, 1, (3, 96, 96)).astype(np.float32)
    shared = (shared + shared[:, ::-1]) / 2
    pattern = np.stack([shared + 0.4 * own[k] for k in (0, 0, 1, 1)])
    seen = Appearance(pattern, np.ones_like(pattern))
    ones = np.ones((96, 96), np.float32)
    mean = mean_pattern([Appearance(shared[None], ones[None])])[None]
    C, _ = similarity(seen, MeanAppearance(mean, ones))
    plain, _ = similarity(seen, MeanAppearance(np.zeros_like(mean), ones))
    assert plain[0, 2] > 0.7 > 0.4 > C[0, 2]


# --- the folder -----------------------------------------------------------------------


def test_drawn_strangers_are_left_out_by_name(drawn):
    anna, bert = drawn
    found = collect_photos([*anna, *bert], FILES_ONLY)
    assert len(found.photos) == 8
    assert [f.code for f in found.failures] == ["other_person"] * 3
    assert [p.path for p in found.photos] == anna
    for failure in found.failures:
        assert failure.name in failure.reason and "one_person" in failure.reason
    (sentence,) = found.identity_warnings
    assert all(failure.name in sentence for failure in found.failures)


def test_switched_off_all_photos_are_used(drawn):
    found = collect_photos(
        [*drawn[0], *drawn[1]], replace(FILES_ONLY, one_person=False)
    )
    assert (
        len(found.photos) == 11
        and found.failures == ()
        and found.identity_warnings == ()
    )


def test_one_drawn_person_stays_whole(drawn):
    found = collect_photos(drawn[0], FILES_ONLY)
    assert (
        len(found.photos) == 8
        and found.failures == ()
        and found.identity_warnings == ()
    )


def test_strangers_are_found_with_fewer_landmarks_asked_for(drawn):
    settings = replace(FILES_ONLY, landmarks="68")
    assert len(collect_photos([*drawn[0], *drawn[1]], settings).photos) == 8


def test_photos_with_fewer_landmarks_are_not_compared(drawn):
    """Their look cannot be read; they are used."""
    few = {}
    for path in drawn[1]:
        marks = read_landmarks(path.with_suffix(".json"))
        few[path.name] = marks.subset("68", load_template().schemes["68"])
    # both folders have these names, so gather numbers them
    numbered = {f"{name} (2)": marks for name, marks in few.items()}
    found = collect_photos(
        [*drawn[0], *drawn[1]], FILES_ONLY, Inputs(landmarks=numbered)
    )
    assert len(found.photos) == 11 and found.identity_warnings == ()


@pytest.fixture(scope="module")
def press(tmp_path_factory):
    """Twelve press photos of one man, three of another."""
    if not LFW.is_dir():
        pytest.skip("the press photos are not here (../shared/photos/lfw)")
    try:
        find_models()
    except ReconstructionError as error:
        pytest.skip(f"the model files are not installed: {error}")
    folder = tmp_path_factory.mktemp("press")
    for person, numbers in (("Colin_Powell", range(20, 32)), ("George_W_Bush", (1, 2))):
        for k in numbers:
            shutil.copy(LFW / person / f"{person}_{k:04d}.jpg", folder)
    return folder


def test_press_photos_of_another_man(press):
    """Nobody's photos are in the stored patterns."""
    found = collect_photos(press)
    apart = {f.name for f in found.failures if f.code == "other_person"}
    assert apart == {"George_W_Bush_0001.jpg", "George_W_Bush_0002.jpg"}
