"""Arrays of npz files that anybody may have written."""

import io
import zipfile

import numpy as np
import pytest
from bsface.npz_arrays import floats, read_arrays

MOST = 10_000


def packed(**arrays) -> io.BytesIO:
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    file.seek(0)
    return file


def test_arrays_come_back():
    given = {"a": np.arange(6.0).reshape(2, 3), "name": np.array("text")}
    found = read_arrays(packed(**given), MOST)
    assert set(found) == set(given)
    np.testing.assert_array_equal(found["a"], given["a"])
    assert str(found["name"]) == "text"


def test_what_is_no_array_is_passed_over():
    file = packed(a=np.zeros(3))
    with zipfile.ZipFile(file, "a") as archive:
        archive.writestr("readme.txt", "hello")
    file.seek(0)
    assert set(read_arrays(file, MOST)) == {"a"}


@pytest.mark.parametrize(
    "file, words",
    [
        (io.BytesIO(b""), "not a zip file"),
        (packed(a=np.zeros(MOST)), "more than 0 MB"),
        (packed(a=np.array([{}], object)), "Object arrays"),
        (
            io.BytesIO(
                packed(a=np.random.default_rng(0).random(500)).getvalue()[:-900]
            ),
            "zip",
        ),
    ],
    ids=["empty", "bomb", "pickle", "cut short"],
)
def test_other_files_are_refused_in_words(file, words):
    with pytest.raises(ValueError, match=words) as caught:
        read_arrays(file, MOST)
    assert "\n" not in str(caught.value)


def test_floats_takes_any_number_and_says_what_is_wrong():
    arrays = {
        "whole": np.arange(4, dtype=np.uint8).reshape(2, 2),
        "text": np.array(["a", "b"]),
        "hole": np.array([1.0, np.nan]),
        "long": np.array([1.0], np.longdouble) * np.longdouble("1e400"),
    }
    found = floats(arrays, "whole", 2, None)
    assert found.dtype == np.float64 and found.tolist() == [[0, 1], [2, 3]]
    assert np.isnan(floats(arrays, "hole", 2, finite=False)[1])
    for name, shape, words in (
        ("none", (2,), "none is missing"),
        ("whole", (2, 3), "whole must hold 2 x 3 numbers"),
        ("whole", (4,), "whole must hold 4 numbers"),
        ("text", (2,), "not <U1"),
        ("hole", (2,), "not finite"),
        ("long", (1,), "not finite"),
    ):
        with pytest.raises(ValueError, match=words):
            floats(arrays, name, *shape)
