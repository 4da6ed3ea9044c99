"""Settings: what is allowed, what is told about the rest, and plain values."""

import dataclasses
import json

import numpy as np
import pytest
from bsface.settings import CHOICES, LIMITS, SWITCHES, WHOLE, Settings
from hypothesis import given
from hypothesis import strategies as st

NAMES = [field.name for field in dataclasses.fields(Settings)]


def allowed(name):
    """Strategy for the allowed values of a setting."""
    if name == "control_points":
        return st.tuples(st.integers(8, 120), st.integers(8, 120))
    if name in CHOICES:
        return st.sampled_from(CHOICES[name])
    if name in SWITCHES:
        return st.booleans()
    low, high = LIMITS[name]
    return st.integers(int(low), int(high)) if name in WHOLE else st.floats(low, high)


def test_every_setting_has_a_rule():
    assert set(NAMES) == {"control_points", *CHOICES, *SWITCHES, *LIMITS}
    assert set(WHOLE) <= set(LIMITS) | set(CHOICES)


@given(st.fixed_dictionaries({}, optional={name: allowed(name) for name in NAMES}))
def test_allowed_values_survive_json(values):
    made = Settings(**values)
    for name, value in values.items():
        assert getattr(made, name) == value
    again = Settings.from_dict(json.loads(json.dumps(made.to_dict())))
    assert again == made
    assert hash(again) == hash(made)
    assert dataclasses.replace(again) == made


anything = st.recursive(
    st.none()
    | st.booleans()
    | st.floats()
    | st.integers()
    | st.text()
    | st.binary()
    | st.just(np.float64("nan")),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.text(), inner, max_size=2)
        | st.tuples(inner, inner)
    ),
    max_leaves=4,
)


@given(name=st.sampled_from(NAMES), value=anything)
def test_anything_is_a_setting_or_gets_a_sentence(name, value):
    try:
        made = Settings(**{name: value})
    except ValueError as error:
        sentence = str(error)
        assert sentence.startswith(name)
        assert sentence.endswith(".")
        assert "\n" not in sentence
        assert len(sentence) < 200
    else:
        assert Settings.from_dict(json.loads(json.dumps(made.to_dict()))) == made


@pytest.mark.parametrize("name", LIMITS)
def test_limits_are_inclusive(name):
    low, high = LIMITS[name]
    for value in (low, high):
        assert getattr(Settings(**{name: value}), name) == value
    for value in (np.nextafter(low, -np.inf), np.nextafter(high, np.inf), np.nan):
        with pytest.raises(ValueError, match=f"{name} must"):
            Settings(**{name: value})


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        (
            {"control_points": (7, 40)},
            "control_points must be two whole numbers from 8 to 120, got (7, 40).",
        ),
        (
            {"control_points": 40},
            "control_points must be two whole numbers from 8 to 120, got 40.",
        ),
        (
            {"method": "magic"},
            "method must be one of joint, imls, paper, motion, got 'magic'.",
        ),
        ({"light_degree": 7}, "light_degree must be one of 1, 2, 3, 4, 5, 6, got 7."),
        ({"detector": "False"}, "detector must be true or false, got 'False'."),
        ({"iterations": 2.5}, "iterations must be a whole number, got 2.5."),
        ({"iterations": "5"}, "iterations must be a number, got '5'."),
        (
            {"eye_distance_mm": 0},
            "eye_distance_mm must lie between 1 and 1000, got 0.",
        ),
        (
            {"distance_mm": float("nan")},
            "distance_mm must lie between 200 and 100000, got nan.",
        ),
    ],
)
def test_sentences(values, sentence):
    with pytest.raises(ValueError) as caught:
        Settings(**values)
    assert str(caught.value) == sentence


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("sign", [1, -1])
def test_numbers_too_long_to_print(name, sign):
    with pytest.raises(ValueError, match=f"{name} must .* got a huge number"):
        Settings(**{name: sign * 10**5000})


def test_unknown_names_are_told_with_the_known_ones():
    with pytest.raises(ValueError, match="no setting colour, size; the settings are"):
        Settings.from_dict({"size": 3, "method": "joint", "colour": 1})
    with pytest.raises(ValueError, match="no setting 3"):
        Settings.from_dict({3: 4})
    for wrong in ([], "joint", None, 5):
        with pytest.raises(ValueError, match="names with values"):
            Settings.from_dict(wrong)


def test_numbers_of_other_libraries_become_plain():
    made = Settings(
        control_points=np.array([12, 14]),
        iterations=np.int64(3),
        smooth_mm=np.float32(0.5),
        detector=np.bool_(False),
        light_degree=2.0,
        landmarks=68,
    )
    assert made.control_points == (12, 14)
    for name in ("iterations", "light_degree"):
        assert type(getattr(made, name)) is int
    assert type(made.smooth_mm) is float
    assert made.detector is False
    assert made.landmarks == "68"
    json.dumps(made.to_dict())


def test_settings_cannot_be_changed():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Settings().method = "paper"


def test_unknown_names_can_be_printed():
    with pytest.raises(ValueError, match="no setting a b") as caught:
        Settings.from_dict({"a\nb\ud800" + "c" * 99: 1})
    str(caught.value).encode("utf-8")


@pytest.mark.parametrize("value", [np.array(["joint"]), ["joint"], None, {"joint"}])
def test_a_choice_is_one_word(value):
    with pytest.raises(ValueError, match="method must be one of joint"):
        Settings(method=value)
