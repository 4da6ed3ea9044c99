"""HDR and wide colours: the copy of a picture in HLG or PQ gives the picture again."""

import io
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from bsface.images.ebml import below, elements
from bsface.images.embedded import coded_profile, embedded_profile
from bsface.images.hdr import hlg_light, hlg_scene, pq_light
from bsface.images.icc import ProfileError
from bsface.images.read import read_photo
from bsface.images.video import read_video
from bsface.images.video_colour import (
    VideoColour,
    frame_converter,
    read_colour,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from pictures_for_tests import rgb_to_xyz
from videos_for_tests import with_colour, write_clip

PQ, HLG = 16, 18
LIGHT = {PQ: pq_light, HLG: hlg_light}
LUMA = {5: (0.299, 0.114), 1: (0.2126, 0.0722), 9: (0.2627, 0.0593)}
EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "photos" / "005.jpg"
PICTURE = cv2.resize(
    cv2.imread(str(EXAMPLE)), (240, 240), interpolation=cv2.INTER_AREA
)[..., ::-1]
BT2020 = rgb_to_xyz("BT.2020")


def stored_values(rgb: np.ndarray, transfer: int) -> np.ndarray:
    """HDR values in [0, 1] and the primaries of BT.2020, of an sRGB picture.

    The curves are inverted by a table, of the functions that are tested elsewhere.
    """
    c = rgb / 255
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    there = linear @ np.linalg.solve(BT2020, rgb_to_xyz("sRGB")).T
    steps = np.linspace(0, 1, 100_000)
    return np.interp(there, LIGHT[transfer](steps), steps)


def matrix(code: int) -> np.ndarray:
    """RGB to YCbCr."""
    r, b = LUMA[code]
    y = np.array([r, 1 - r - b, b])
    blue, red = (np.eye(3)[2] - y) / (2 - 2 * b), (np.eye(3)[0] - y) / (2 - 2 * r)
    return np.stack([y, blue, red])


def as_bt601(stored: np.ndarray, code: int) -> np.ndarray:
    """What a decoder that knows BT.601 only makes of pictures of another matrix."""
    rgb = stored @ (np.linalg.inv(matrix(5)) @ matrix(code)).T
    return np.round(np.clip(rgb, 0, 1) * 255).astype(np.uint8)


def test_curves_at_values_that_their_standards_print():
    """BT.2100 tables 4 and 5, BT.2408 table 1: reference white, and signal 0.5."""
    assert hlg_light(0.75) == pytest.approx(1, abs=1e-3)
    assert pq_light(0.58) == pytest.approx(1, abs=1e-2)
    assert hlg_light(0.5) / hlg_light(1.0) == pytest.approx(1 / 12, rel=1e-6)
    assert pq_light(1.0) * 203 == pytest.approx(10000)
    assert pq_light(0.508078) * 203 == pytest.approx(100, rel=1e-4)
    assert hlg_light(0.0) == pq_light(0.0) == 0
    for light in LIGHT.values():
        assert (np.diff(light(np.linspace(0, 1, 5000))) >= 0).all()
    # Smooth where its two parts meet.
    low, middle, high = hlg_light(np.array([0.4999, 0.5, 0.5001]))
    assert high - middle == pytest.approx(middle - low, rel=1e-3)


def test_scene_and_screen_of_hlg():
    """The screen shows each colour of the scene times its luminance to the 0.2."""
    scene = np.random.default_rng(2).uniform(0.01, 1, (50, 3)).astype(np.float32)
    luminance = scene @ np.array([0.2126, 0.7152, 0.0722])
    screen = (scene * luminance[:, None] ** 0.2).astype(np.float32)
    np.testing.assert_allclose(hlg_scene(screen), scene, rtol=1e-5)


@pytest.mark.parametrize("transfer", [PQ, HLG])
def test_an_hdr_clip_gives_the_picture(tmp_path, transfer):
    """Through whichever OpenCV is installed."""
    stored = stored_values(PICTURE, transfer)
    path = write_clip(tmp_path / "a.mp4", [as_bt601(stored, 9)])
    with_colour(path, 9, transfer, 9)
    assert read_colour(path) == VideoColour(9, transfer, 9)
    photo = next(read_video(path).photos())
    assert photo.note == "" and photo.pixels.dtype == np.uint16
    # As it is stored it is 20 to 40 levels away; the writer is 2 off, PQ is steep.
    assert np.abs(photo.pixels / 257 - PICTURE).mean() < 8


@pytest.mark.parametrize("transfer", [PQ, HLG])
@pytest.mark.parametrize("converted", [False, True])
def test_both_kinds_of_opencv(transfer, converted):
    """With steps of eight bits: what a video is, decoded without loss."""
    stored = stored_values(PICTURE, transfer)
    frame = as_bt601(stored, 9)
    if converted:
        light = np.clip(LIGHT[transfer](stored), 0, 1)
        light = np.clip(light @ np.linalg.solve(rgb_to_xyz("sRGB"), BT2020).T, 0, 1)
        if transfer == HLG:
            light *= (light @ np.array([0.2126, 0.7152, 0.0722]))[..., None] ** 0.2
        frame = np.round(light ** (1 / 2.4) * 255).astype(np.uint8)
    convert = frame_converter(VideoColour(9, transfer, 9), converted)
    assert np.abs(convert(frame) / 257 - PICTURE).mean() < 1.5


def test_matrix_of_bt709(tmp_path):
    """Phones' videos of standard range: the right colours with any OpenCV."""
    path = write_clip(tmp_path / "a.mp4", [as_bt601(PICTURE / 255, 1)])
    with_colour(path, 1, 1, 1)
    photo = next(read_video(path).photos())
    assert photo.pixels.dtype == np.uint8
    assert np.abs(photo.pixels.mean((0, 1)) - PICTURE.mean((0, 1))).max() < 3.5
    convert = frame_converter(VideoColour(1, 1, 1), False)
    away = convert(as_bt601(PICTURE / 255, 1)).astype(int) - PICTURE
    assert np.abs(away).max() <= 2


def test_nothing_said_is_nothing_done(tmp_path):
    path = write_clip(tmp_path / "a.avi", [PICTURE])
    assert read_colour(path) == VideoColour()
    frame = PICTURE.copy()
    assert frame_converter(VideoColour(), False)(frame) is frame
    assert frame_converter(VideoColour(1, 13, 2), True)(frame) is frame
    assert read_colour(tmp_path / "none.mp4") == VideoColour()


def test_an_unknown_curve_is_noted(tmp_path):
    path = write_clip(tmp_path / "a.mp4", [PICTURE])
    with_colour(path, 1, 10, 1)
    assert "brightness curve (code 10)" in read_video(path).note
    with pytest.raises(ProfileError):
        frame_converter(VideoColour(1, 10, 1))


# --- Matroska -------------------------------------------------------------------------


def element(name: int, body: bytes) -> bytes:
    """With a size of eight bytes, as encoders write what they fill in later."""
    length = (name.bit_length() + 7) // 8
    return (
        name.to_bytes(length, "big") + (len(body) | 1 << 56).to_bytes(8, "big") + body
    )


def matroska(primaries: int, transfer: int, code: int) -> bytes:
    numbers = {0x55BA: transfer, 0x55B1: code, 0x55BB: primaries}
    body = b"".join(element(name, bytes([n])) for name, n in numbers.items())
    for name in (0x55B0, 0xE0, 0xAE, 0x1654AE6B, 0x18538067):
        body = element(0xEC, b"\0" * 5) + element(name, body)
    return element(0x1A45DFA3, b"\x42\x82\x84webm") + body


def test_colours_of_matroska(tmp_path):
    path = tmp_path / "a.webm"
    path.write_bytes(matroska(9, 18, 9))
    assert read_colour(path) == VideoColour(9, 18, 9)
    # A live recording does not know how long its segment is.
    live = matroska(9, 16, 9)
    at = live.index(b"\x18\x53\x80\x67") + 5
    path.write_bytes(live[:at] + b"\xff" * 7 + live[at + 7 :])
    assert read_colour(path) == VideoColour(9, 16, 9)


@given(st.lists(st.tuples(st.integers(0x81, 0xFE), st.binary(max_size=20)), max_size=6))
def test_elements_are_found_again(parts):
    data = memoryview(b"".join(element(name, body) for name, body in parts))
    assert [(name, bytes(body)) for name, body in elements(data)] == parts
    for name, _ in parts:
        wanted = [body for other, body in parts if other == name]
        assert [bytes(body) for body in below(data, name)] == wanted


@settings(max_examples=300)
@given(st.binary(max_size=300), st.integers(0, 200), st.sampled_from(["mkv", "mp4"]))
def test_any_bytes_are_read_without_a_fault(tmp_path_factory, noise, at, kind):
    path = tmp_path_factory.mktemp("fuzz", numbered=True) / f"a.{kind}"
    if kind == "mkv":
        good = matroska(9, 18, 9)
    else:
        colr = struct.pack(">I4s4s3HB", 19, b"colr", b"nclx", 9, 18, 9, 0)
        good = bytes(8) + struct.pack(">I4s", 105, b"hvc1") + bytes(78) + colr
        for name in (b"stsd", b"stbl", b"minf", b"mdia", b"trak", b"moov"):
            good = struct.pack(">I4s", len(good) + 8, name) + good
    path.write_bytes(good[:at] + noise + good[at + len(noise) :])
    found = read_colour(path)
    assert isinstance(found, VideoColour)
    for code in (found.primaries, found.transfer, found.matrix):
        assert 0 <= code < 2**64
    if not noise:
        assert found == VideoColour(9, 18, 9)


# --- stills -------------------------------------------------------------------------


@pytest.mark.parametrize("transfer", [PQ, HLG])
def test_an_hdr_still_gives_the_picture(tmp_path, transfer):
    """HEIC of ten bits with a box of codes, as cameras and phones write it."""
    pillow_heif = pytest.importorskip("pillow_heif")
    pytest.importorskip("pi_heif")
    stored = np.round(stored_values(PICTURE, transfer) * 65535).astype(np.uint16)
    size = PICTURE.shape[1::-1]
    picture = pillow_heif.from_bytes("RGB;16", size, stored.tobytes())
    codes = {"color_primaries": 9, "transfer_characteristics": transfer}
    buffer = io.BytesIO()
    picture.save(
        buffer, quality=95, save_nclx_profile=True, matrix_coefficients=9, **codes
    )
    path = tmp_path / "a.heic"
    path.write_bytes(buffer.getvalue())
    photo = read_photo(path)
    assert photo.note == ""
    assert np.abs(photo.pixels / 257 - PICTURE).mean() < 3


def test_codes_of_avif():
    """The box is that of HEIC: the picture's bytes are not looked at."""
    colr = struct.pack(">I4s4s3HB", 19, b"colr", b"nclx", 9, 16, 9, 0x80)
    box = colr
    for name, head in ((b"ipco", b""), (b"iprp", b""), (b"meta", bytes(4))):
        box = struct.pack(">I4s", len(head + box) + 8, name) + head + box
    profile = embedded_profile(np.frombuffer(box, np.uint8), "AVIF")
    assert profile is not None
    stored = np.array([0.2, 0.4, 0.5])
    expected = coded_profile(9, 16).linear_srgb(stored)
    np.testing.assert_array_equal(profile.linear_srgb(stored), expected)
    # Grey stays grey, of the light of the curve.
    grey = profile.linear_srgb(np.full(3, 0.5))
    np.testing.assert_allclose(grey, np.full(3, pq_light(0.5)), rtol=1e-3)


def test_large_frames_are_converted_in_pieces():
    frame = cv2.resize(PICTURE, (1600, 1200))
    convert = frame_converter(VideoColour(9, HLG, 9), True)
    whole = convert(frame)
    np.testing.assert_array_equal(whole[1100:], convert(frame[1100:].copy()))
