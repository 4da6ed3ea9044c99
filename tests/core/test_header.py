"""What the header of a picture file says, before it is decoded."""

import numpy as np
import pytest
from bsface.images.header import read_header
from hypothesis import given, settings
from hypothesis import strategies as st
from pictures_for_tests import encoded


@pytest.mark.parametrize(
    "ending", [".jpg", ".png", ".bmp", ".tif", ".webp", ".ppm", ".pgm"]
)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_header_says_what_decoding_gives(ending, dtype):
    if dtype == np.uint16 and ending in (".jpg", ".bmp", ".webp"):
        pytest.skip(f"{ending} has no 16 bits here")
    image = np.zeros((37, 53, 3) if ending != ".pgm" else (37, 53), dtype)
    header = read_header(encoded(ending, image))
    assert header is not None
    assert (header.width, header.height) == (53, 37)
    if ending not in (".webp", ".bmp"):
        assert header.bytes_per_pixel == image.nbytes / (37 * 53)


@given(st.binary(max_size=200), st.integers(0, 7))
@settings(max_examples=300, deadline=None)
def test_header_of_any_bytes_does_not_fail(data, kind):
    start = [
        b"",
        b"\xff\xd8\xff",
        b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR",
        b"BM",
        b"II*\0\x08\0\0\0",
        b"RIFF\0\0\0\0WEBPVP8X",
        b"P6\n",
        b"\0\0\0\x0cjP  \r\n\x87\nihdr",
    ][kind]
    header = read_header(start + data)
    assert header is None or header.pixels >= 0
