"""The person's face among all that the photos show."""

import numpy as np
import pytest
from bsface.identity.choice import choose
from hypothesis import given, settings
from hypothesis import strategies as st


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
    """A partner in five photos, others who are larger: never the person."""
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
