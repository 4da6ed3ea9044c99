"""Outlier identities found by the distances of faces, and nobody else."""

import numpy as np
import pytest
from bsface.identity.same_person import split_identities
from hypothesis import given, settings
from hypothesis import strategies as st


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
