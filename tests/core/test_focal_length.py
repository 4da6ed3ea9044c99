"""The focal length that a photo's file names, in pixels of the photo."""

import math
import struct
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from bsface.camera.camera import Camera
from bsface.images.exif import exif_fields
from bsface.images.focal_length import focal_length_px
from bsface.images.header import read_header
from bsface.images.photo import cut
from bsface.images.read import read_photo
from bsface.landmarks.observations import believable_focal, principal_point
from bsface.surface.template import load_template
from hypothesis import given
from hypothesis import strategies as st
from pictures_for_tests import by_pillow, heic
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

pytest.importorskip("pi_heif")
pytest.importorskip("pillow_heif")

WIDTH, HEIGHT = 80, 60
GREY = np.full((HEIGHT, WIDTH, 3), 128, np.uint8)
FOCAL, X, Y, DENSITY, UNIT, ZOOM, FILM = 37386, 40962, 40963, 41486, 41488, 41988, 41989
PHONE = {FILM: 26, X: WIDTH, Y: HEIGHT, FOCAL: 4.2}
KINDS = ["JPEG", "PNG", "WebP", "TIFF", "HEIC", "AVIF"]
EXPECTED = 26 / math.hypot(36, 24) * math.hypot(WIDTH, HEIGHT)


def exif_of(tags, turn=None):
    exif = Image.Exif()
    if turn is not None:
        exif[274] = turn
    numbers = {k: IFDRational(v) if v % 1 else v for k, v in tags.items()}
    exif.get_ifd(0x8769).update(numbers)
    return exif.tobytes()


def file_of(tags, kind="JPEG", pixels=GREY, **options):
    write = heic if kind == "HEIC" else partial(by_pillow, kind)
    return write(pixels, exif=exif_of(tags), **options)


def focal_of(tags, kind="JPEG", pixels=GREY, **options):
    data = np.frombuffer(file_of(tags, kind, pixels, **options), np.uint8)
    kind = read_header(data).format
    return focal_length_px(data, kind, (pixels.shape[1], pixels.shape[0]))


@pytest.mark.parametrize("kind", KINDS)
def test_every_format_says_it(kind):
    assert focal_of(PHONE, kind) == pytest.approx(EXPECTED)


@pytest.mark.parametrize("turn", [1, 3, 6, 8])
def test_a_turned_photo_has_the_same(tmp_path, turn):
    path = tmp_path / "a.jpg"
    Image.fromarray(GREY).save(path, exif=exif_of(PHONE, turn))
    photo = read_photo(path)
    assert photo.size in ((WIDTH, HEIGHT), (HEIGHT, WIDTH))
    assert photo.focal_px == pytest.approx(EXPECTED)
    assert cut(photo, (5, 5, 50, 50)).focal_px == photo.focal_px


def test_a_smaller_copy_has_it_in_its_own_pixels():
    assert focal_of(PHONE | {X: 4000, Y: 3000}) == pytest.approx(EXPECTED)


@pytest.mark.parametrize(
    "tags",
    [
        {},
        {FILM: 26, X: 100, Y: 100},
        PHONE | {FILM: 0},
        PHONE | {FILM: 5},
        PHONE | {ZOOM: 2.5},
    ],
    ids=["nothing", "cropped", "none", "no lens", "zoomed"],
)
def test_what_is_not_sure_is_not_known(tags):
    assert focal_of(tags) is None


def test_a_picture_that_no_camera_frames_so_was_cropped():
    assert focal_of({FILM: 26}, pixels=GREY[:, :60]) is None
    assert focal_of({FILM: 26}, pixels=GREY[:51]) is None


def test_a_crop_that_an_editor_notes():
    xmp = b'<x:xmpmeta><rdf:Description crs:HasCrop="True"/></x:xmpmeta>'
    assert focal_of(PHONE, xmp=xmp) is None
    assert focal_of(PHONE, xmp=xmp.replace(b"True", b"False")) is not None


@pytest.mark.parametrize("turned", [False, True])
def test_a_sensor_whose_pixels_are_stated(turned):
    """A lens of 50.5 mm before a sensor that is 22.4 mm wide."""
    tags = {FOCAL: 50.5, X: 4272, Y: 3204, DENSITY: 4272 / 22.4 * 25.4, UNIT: 2}
    pixels = np.ascontiguousarray(np.swapaxes(GREY, 0, 1)) if turned else GREY
    found = focal_of(tags, pixels=pixels)
    assert found == pytest.approx(50.5 / 22.4 * WIDTH, rel=1e-3)


def test_a_density_that_belongs_to_another_size_is_not_used():
    """Half as large, but the sensor's pixels as they were."""
    tags = {FOCAL: 50.5, X: 2136, Y: 1602, DENSITY: 4272 / 22.4 * 25.4, UNIT: 2}
    assert focal_of(tags) is None


def test_arrays_have_none():
    assert read_photo(GREY).focal_px is None


@cache
def phone_file(kind):
    return file_of(PHONE, kind)


@given(st.data())
def test_damaged_files_are_read_without_an_error(data):
    kind = data.draw(st.sampled_from(KINDS))
    file = bytearray(phone_file(kind))
    for _ in range(data.draw(st.integers(1, 6))):
        file[data.draw(st.integers(0, len(file) - 1))] = data.draw(st.integers(0, 255))
    file = file[: data.draw(st.integers(1, len(file)))]
    array = np.frombuffer(bytes(file), np.uint8)
    found = focal_length_px(array, kind, (WIDTH, HEIGHT))
    assert found is None or found > 0
    assert isinstance(exif_fields(array.data, kind), dict)


SHORT, LONG, RATIONAL, TEXT = 3, 4, 5, 2
ENTRIES = st.tuples(
    st.sampled_from(
        [FOCAL, X, Y, DENSITY, UNIT, ZOOM, FILM, 256, 257, 258, 277, 34665]
    ),
    st.integers(0, 18),
    st.integers(0, 5),
    st.integers(0, 200),
)


def tiff_of(entries):
    """A file of one directory: tag, type, number of values, and where they stand."""
    rows = b"".join(struct.pack("<HHII", *entry) for entry in entries)
    return struct.pack("<2sHIH", b"II", 42, 8, len(entries)) + rows + bytes(8)


@given(st.lists(ENTRIES, max_size=12))
def test_tags_of_any_type_and_length_are_read_without_an_error(entries):
    data = np.frombuffer(tiff_of(entries), np.uint8)
    header = read_header(data)
    assert header is None or header.format == "TIFF"
    exif = b"Exif\0\0" + data.tobytes()
    segment = struct.pack(">HH", 0xFFE1, len(exif) + 2) + exif
    photo = np.frombuffer(b"\xff\xd8" + segment, np.uint8)
    for file, kind in ((data, "TIFF"), (photo, "JPEG")):
        assert isinstance(exif_fields(file.data, kind), dict)
        found = focal_length_px(file, kind, (WIDTH, HEIGHT))
        assert found is None or found > 0


@pytest.mark.parametrize(
    "kind", [(TEXT, 4, 0), (RATIONAL, 0, 0), (RATIONAL, 1, 90_000)]
)
def test_a_width_that_is_no_number_counts_as_missing(kind):
    """The 35 mm entry beside it is used."""
    rows = tiff_of([(X, *kind), (FILM, SHORT, 1, 26)])
    data = tiff_of([(34665, LONG, 1, 26)])[:22] + bytes(4) + rows[8:]
    assert focal_length_px(
        np.frombuffer(data, np.uint8), "TIFF", (WIDTH, HEIGHT)
    ) == pytest.approx(EXPECTED)


def test_a_crop_shows_by_a_face_that_no_camera_is_so_near_to():
    template = load_template()
    photo = read_photo(GREY)
    camera = Camera(np.eye(3), 0.3, np.zeros(2), 0.0, principal_point(photo))
    Q = template.landmark_xyz
    seen = (camera.project(Q), Q, np.ones(len(Q)))
    for distance, believed in ((150, False), (300, True), (3000, True)):
        told = replace(photo, focal_px=camera.s * distance)
        expected = told.focal_px if believed else None
        assert believable_focal(told, *seen) == expected
    assert believable_focal(photo, *seen) is None


def box(kind, body):
    return struct.pack(">I4s", 8 + len(body), kind) + body


def test_an_item_list_that_claims_much_is_left_soon():
    """65535 empty extents in each of 20000 items: read one by one it takes hours."""
    infe = box(
        b"infe", struct.pack(">I", 2 << 24) + struct.pack(">HH4s", 7, 0, b"Exif")
    )
    items = struct.pack(">HHH", 1, 0, 65535) * 20_000
    iloc = box(b"iloc", struct.pack(">IBBH", 0, 0, 0, 20_000) + items)
    iinf = box(b"iinf", struct.pack(">IH", 0, 1) + infe)
    file = box(b"ftyp", b"heic") + box(b"meta", bytes(4) + iinf + iloc)
    assert exif_fields(memoryview(file), "HEIC") == {}
