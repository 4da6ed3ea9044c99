"""Reading photos: every kind of file ends in the right pixels or in a sentence."""

import base64
import os

import cv2
import numpy as np
import pytest
from bsface.errors import PhotoFailure
from bsface.images.decode import LIMITS, RAW_ENDINGS, Limits
from bsface.images.folder import list_photos
from bsface.images.photo import Photo
from bsface.images.read import read_photo
from hypothesis import given, settings
from hypothesis import strategies as st
from needs import needs_permissions
from pictures_for_tests import bomb, encoded, exif_turned

# 40 x 32 pixels each, made once with Pillow; red is (200, 30, 30).
CMYK_JPEG_PURE_RED = base64.b64decode(
    "/9j/7gAOQWRvYmUAZAAAAAAA/9sAQwAQCwwODAoQDg0OEhEQExgoGhgWFhgxIyUdKDozPTw5Mzg3"
    "QEhcTkBEV0U3OFBtUVdfYmdoZz5NcXlwZHhcZWdj/8AAFAgAIAAoBEMRAE0RAFkRAEsRAP/EABUA"
    "AQEAAAAAAAAAAAAAAAAAAAAH/8QAFBABAAAAAAAAAAAAAAAAAAAAAP/aAA4EQwBNAFkASwAAPwCg"
    "J+n6gAAAAAAAAAAAAAAAAAAAAAAAAAD/2Q=="
)
ANIMATED_WEBP_RED_FIRST = base64.b64decode(
    "UklGRogAAABXRUJQVlA4WAoAAAACAAAAJwAAHwAAQU5JTQYAAAAAAAAAAABBTk1GKgAAAAAAAAAA"
    "ACcAAB8AAAAAAAJWUDhMEQAAAC8nwAcAB1CPItej/4GI6H8AAEFOTUYqAAAAAAAAAAAAJwAAHwAA"
    "AAAAAFZQOEwRAAAALyfABwAHUOR61KP/gYjofwAA"
)
ANIMATED_PNG_RED_FIRST = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAACgAAAAgCAIAAADvz61XAAAACGFjVEwAAAACAAAAAPONk3AAAAAa"
    "ZmNUTAAAAAAAAAAoAAAAIAAAAAAAAAAAAAAAAQAAorP4PgAAAC1JREFUeJztzTEBAAAEADAE0T+K"
    "WAr4PVuB5XTHh3pZxWKxWCwWi8VisVgsPi1PQQFE/XcV8gAAABpmY1RMAAAAAQAAACgAAAAgAAAA"
    "AAAAAAAAAAABAAA5wBLqAAAAMWZkQVQAAAACeJztzTEBAAAEADAE0T+KWAr4PVuBZU/Hh3pZxWKx"
    "WCwWi8VisVgsPi1OlwFEFhsqEgAAAABJRU5ErkJggg=="
)
GIF = base64.b64decode(
    "R0lGODdhKAAgAIEAAMgeHgAAAAAAAAAAACwAAAAAKAAgAAAIPAABCBxIsKDBgwgTKlzIsKHDhxAj"
    "SpxIsaLFixgzatzIsaPHjyBDihxJsqTJkyhTqlzJsqXLlzBjyiwYEAA7"
)


def corners_picture(dtype=np.uint8) -> np.ndarray:
    """RGB 64 x 48 with another colour in each corner."""
    top = np.iinfo(dtype).max
    image = np.full((48, 64, 3), top // 2, dtype)
    image[:16, :16] = (top, 0, 0)
    image[:16, -16:] = (0, top, 0)
    image[-16:, :16] = (0, 0, top)
    return image


@pytest.fixture
def read(tmp_path):
    def reader(data: bytes, name: str = "a.jpg", limits: Limits = LIMITS):
        path = tmp_path / name
        path.write_bytes(data)
        return read_photo(path, limits=limits)

    return reader


# --- pixels ------------------------------------------------------------------


@pytest.mark.parametrize("ending", [".png", ".bmp", ".tif", ".webp", ".ppm"])
def test_lossless_formats_give_the_same_rgb(read, ending):
    image = corners_picture()
    options = (cv2.IMWRITE_WEBP_QUALITY, 101) if ending == ".webp" else ()
    photo = read(encoded(ending, image, *options), "a" + ending)
    np.testing.assert_array_equal(photo.pixels, image)
    assert photo.size == (64, 48)


@pytest.mark.parametrize("ending", [".png", ".tif"])
def test_sixteen_bits_are_kept(read, ending):
    image = corners_picture(np.uint16)
    image[20, 20] = (1, 257, 40000)
    photo = read(encoded(ending, image), "a" + ending)
    np.testing.assert_array_equal(photo.pixels, image)


def test_grey_and_alpha_and_palette_become_three_channels(read):
    grey = corners_picture()[..., 1]
    photo = read(encoded(".png", grey), "a.png")
    np.testing.assert_array_equal(photo.pixels, np.repeat(grey[..., None], 3, 2))
    rgba = np.dstack([corners_picture(), np.full((48, 64), 128, np.uint8)])
    photo = read(encoded(".png", rgba), "b.png")
    np.testing.assert_array_equal(photo.pixels, corners_picture())
    bilevel = encoded(".png", grey, cv2.IMWRITE_PNG_BILEVEL, 1)
    assert read(bilevel, "c.png").pixels.shape == (48, 64, 3)


def test_cmyk_jpeg_is_converted(read):
    pixels = read(CMYK_JPEG_PURE_RED).pixels
    assert pixels.shape == (32, 40, 3)
    assert (np.abs(pixels[..., 0].astype(int) - 255) < 8).all()
    assert (pixels[..., 1:] < 8).all()


@pytest.mark.parametrize(
    "data, name",
    [(ANIMATED_WEBP_RED_FIRST, "a.webp"), (ANIMATED_PNG_RED_FIRST, "a.png")],
)
def test_of_an_animation_the_first_frame_is_read(read, data, name):
    assert tuple(read(data, name).pixels[5, 5]) == (200, 30, 30)


TURNS = {
    1: lambda a: a,
    2: lambda a: a[:, ::-1],
    3: lambda a: a[::-1, ::-1],
    4: lambda a: a[::-1],
    5: lambda a: a.swapaxes(0, 1),
    6: lambda a: np.rot90(a, -1),
    7: lambda a: a.swapaxes(0, 1)[::-1, ::-1],
    8: lambda a: np.rot90(a),
}


@pytest.mark.parametrize("orientation", range(1, 9))
def test_exif_orientation_is_applied(read, orientation):
    image = corners_picture()
    jpeg = encoded(".jpg", image, cv2.IMWRITE_JPEG_QUALITY, 100)
    photo = read(exif_turned(jpeg, orientation))
    expected = TURNS[orientation](image)
    assert photo.pixels.shape == expected.shape
    assert photo.size == expected.shape[1::-1]
    # Corners' middles: chroma subsampling blurs the edges.
    difference = np.abs(photo.pixels.astype(int) - expected)[4:12, 4:12]
    assert difference.max() < 12


def test_large_photo_is_read_reduced_and_keeps_its_coordinates(read):
    limits = Limits(full_size_pixels=1000)
    image = np.zeros((161, 241, 3), np.uint8)
    image[96:112, 48:64] = 255  # centre (55.5, 103.5)
    data = exif_turned(encoded(".jpg", image), 1)
    photo = read(data, limits=limits)
    assert photo.size == (241, 161)
    assert photo.window == (0.0, 0.0, 1 / 8)
    weight = photo.pixels[..., 0].astype(float)
    y, x = np.mgrid[: weight.shape[0], : weight.shape[1]]
    centre = np.array([(x * weight).sum(), (y * weight).sum()]) / weight.sum()
    np.testing.assert_allclose(photo.to_original(centre), (55.5, 103.5), atol=0.5)
    turned = read(exif_turned(encoded(".jpg", image), 6), limits=limits)
    assert turned.size == (161, 241)


def test_unicode_and_long_names(tmp_path):
    name = "Фото 写真 é 😀 " + "x" * 100 + ".png"
    (tmp_path / name).write_bytes(encoded(".png", corners_picture()))
    (path,) = list_photos(tmp_path)
    photo = read_photo(path)
    assert isinstance(photo, Photo)
    assert photo.name == name


def test_wrong_ending_of_a_real_picture_does_not_matter(read):
    assert read(encoded(".png", corners_picture()), "a.jpg")


# --- files that are no use ---------------------------------------------------


def bad_files() -> dict[str, tuple[bytes, str, str]]:
    picture = np.random.default_rng(0).integers(0, 255, (200, 300, 3), np.uint8)
    jpeg, png = encoded(".jpg", picture), encoded(".png", picture)
    pixel = np.zeros((1, 1, 3), np.uint8)
    return {
        "text": (b"Dear photo,\nyours", "unreadable", "not a picture"),
        "zero bytes": (b"", "unreadable", "zero bytes"),
        "zeros": (b"\0" * 5000, "unreadable", "not a picture"),
        "short jpeg": (jpeg[: len(jpeg) // 2], "unreadable", "cut short"),
        "short png": (png[: len(png) // 2], "unreadable", "cut short"),
        "head of a jpeg": (jpeg[:20], "unreadable", "not a picture"),
        "1 x 1": (encoded(".png", pixel), "unreadable", "1 x 1"),
        "30000 x 30000": (bomb(30000, 30000), "too_large", "30000 x 30000"),
        "16-bit bomb": (bomb(13000, 13000, 16, 6), "too_large", "13000"),
        "no width": (bomb(0, 100), "unreadable", "0 x 100"),
        "gif": (GIF, "unreadable", "GIF"),
        "heic without content": (
            b"\0\0\0\x18ftypheic" + b"\0" * 50,
            "unreadable",
            "damaged",
        ),
        "float": (
            encoded(".tif", np.ones((40, 40, 3), np.float32)),
            "unreadable",
            "floating-point numbers of",  # 16 bits (LogLuv) by older versions of OpenCV
        ),
        "grey float": (
            encoded(".tif", np.ones((40, 40), np.float32)),
            "unreadable",
            "floating-point numbers of 32 bits",
        ),
        # OpenCV fails on these with an error of its own.
        "double": (
            encoded(".tif", np.ones((40, 40, 3), np.float64)),
            "unreadable",
            "floating-point numbers of 64 bits",
        ),
        "signed": (
            encoded(".tif", np.ones((40, 40, 3), np.int16)),
            "unreadable",
            "signed numbers of 16 bits",
        ),
    }


@pytest.mark.parametrize("kind", bad_files())
def test_bad_file_gives_one_sentence_with_its_name(read, kind):
    data, code, words = bad_files()[kind]
    failure = read(data, "portrait 7.jpg")
    assert isinstance(failure, PhotoFailure)
    assert not failure
    assert failure.code == code
    assert words in failure.reason
    assert "portrait 7.jpg" in failure.reason
    assert failure.reason.endswith(".")
    assert "\n" not in failure.reason


def test_missing_folder_and_pipe_and_loop(tmp_path):
    assert read_photo(tmp_path / "none.jpg").code == "unreadable"
    assert read_photo(tmp_path).code == "unreadable"
    loop = tmp_path / "loop.jpg"
    loop.symlink_to(loop)
    assert "loop.jpg" in read_photo(loop).reason
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe.jpg")
        assert "regular" in read_photo(tmp_path / "pipe.jpg").reason


@needs_permissions
def test_unreadable_permission(tmp_path):
    path = tmp_path / "secret.jpg"
    path.write_bytes(encoded(".jpg", corners_picture()))
    path.chmod(0)
    assert "permission" in read_photo(path).reason


def test_damaged_files_leave_stderr_alone(tmp_path, capfd):
    for number, (data, *_) in enumerate(bad_files().values()):
        path = tmp_path / f"{number}.jpg"
        path.write_bytes(data)
        read_photo(path)
    for ending in (".bmp", ".ppm", ".tif"):
        data = encoded(ending, corners_picture())
        path.write_bytes(data[: len(data) // 2])
        assert not read_photo(path)
    assert capfd.readouterr().err == ""


def test_animation_that_ends_opencv(read):
    """Its frames are torn; only the picture that is not one of them is looked at."""
    data = ANIMATED_PNG_RED_FIRST
    at = data.index(b"fdAT") + 8
    torn = data[:at] + b"\xff" * 30 + data[at + 30 :]
    assert tuple(read(torn, "a.png").pixels[5, 5]) == (200, 30, 30)
    at = data.index(b"IDAT") + 10
    assert not read(data[:at] + b"\xff" * 9 + data[at + 9 :], "a.png")


def test_the_thumbnail_of_a_raw_file_is_not_the_photo(read):
    thumbnail = encoded(".tif", corners_picture())
    for ending in RAW_ENDINGS:
        failure = read(thumbnail, f"a{ending}")
        assert failure.code == "unreadable" and "raw photo" in failure.reason
    assert read(thumbnail, "a.tif")


@given(data=st.data())
@settings(max_examples=60, deadline=None)
def test_damaged_pictures_end_in_a_photo_or_a_sentence(tmp_path_factory, data):
    ending = data.draw(st.sampled_from([".jpg", ".bmp", ".webp", ".ppm"]))
    content = bytearray(encoded(ending, corners_picture()))
    for _ in range(data.draw(st.integers(1, 6))):
        at = data.draw(st.integers(0, len(content) - 1))
        content[at] = data.draw(st.integers(0, 255))
    path = tmp_path_factory.mktemp("damaged") / ("a" + ending)
    path.write_bytes(bytes(content[: data.draw(st.integers(0, len(content)))]))
    photo = read_photo(path)
    if photo:
        assert photo.pixels.dtype in (np.uint8, np.uint16)
        assert photo.pixels.shape[2] == 3
    else:
        assert photo.reason


# --- arrays ------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore:the matrix subclass")
def test_arrays_of_all_allowed_kinds():
    image = corners_picture()
    for array in (image, np.dstack([image, image[..., :1]]), image.astype(float) / 255):
        photo = read_photo(array, "p")
        assert photo.path is None
        assert photo.size == (64, 48)
        np.testing.assert_array_equal(photo.bytes8(), image)
    for grey in (image[..., 0], np.asmatrix(image[..., 0])):
        assert read_photo(grey, "p").pixels.shape == (48, 64, 3)
    foreign = read_photo((image.astype(np.uint16) * 257).astype(">u2"), "p")
    np.testing.assert_array_equal(foreign.bytes8(), image)


@pytest.mark.parametrize(
    "array, words",
    [
        (np.zeros((5, 5, 3), np.uint8), "5 x 5"),
        (np.zeros((50, 50, 2), np.uint8), "shape"),
        (np.zeros(50, np.uint8), "shape"),
        (np.zeros((50, 50, 3), np.int64), "int64"),
        (np.full((50, 50, 3), np.nan), "finite"),
        (np.full((50, 50, 3), 2.0), "outside"),
        (np.zeros((50, 50, 3), bool), "bool"),
        (np.zeros((50, 50, 3), object), "object"),
    ],
)
def test_bad_arrays(array, words):
    failure = read_photo(array, "picture 3")
    assert not failure
    assert words in failure.reason
    assert "picture 3" in failure.reason
