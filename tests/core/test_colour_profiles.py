"""Colour profiles: a copy in another colour space gives the pixels of its sRGB twin."""

import io
import struct

import cv2
import numpy as np
import pytest
from bsface.images.colour import encode_srgb
from bsface.images.convert import is_srgb, to_srgb
from bsface.images.embedded import coded_profile
from bsface.images.icc import ProfileError, read_profile
from bsface.images.photo import cut
from bsface.images.read import read_photo
from hypothesis import given, settings
from hypothesis import strategies as st
from pictures_for_tests import (
    SRGB_FORMULA,
    encoded,
    formula_curve,
    icc_profile,
    jpeg_with_profile,
    png_with_profile,
    power_curve,
    rgb_to_xyz,
    table_curve,
)
from PIL import Image, ImageCms

RNG = np.random.default_rng(3)
# Smooth, of all hues and down to black, so that JPEG keeps it.
SMALL = RNG.integers(0, 256, (6, 8, 3)).astype(np.float32)
TWIN = np.clip(cv2.resize(SMALL, (80, 60), interpolation=cv2.INTER_CUBIC), 0, 255)
TWIN = TWIN.astype(np.uint8)
MUTED = (TWIN * 0.4 + 80).astype(np.uint8)  # about as colourful as skin
STEPS = np.linspace(0, 1, 1024)
SRGB_STEPS = np.where(STEPS <= 0.04045, STEPS / 12.92, ((STEPS + 0.055) / 1.055) ** 2.4)
BEST = (
    cv2.IMWRITE_JPEG_QUALITY,
    100,
    cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
    cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
)
SPACES = {
    "P3, formula": ("Display P3", SRGB_FORMULA, None),
    "P3, table": ("Display P3", table_curve(SRGB_STEPS), None),
    "Adobe RGB": ("Adobe RGB", power_curve(563 / 256), 563 / 256),
}


def copy_of(rgb: np.ndarray, space: str, gamma: float | None) -> np.ndarray:
    """The same colours with 16 bits in another space; sRGB's curve without gamma."""
    c = rgb / 255
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    there = linear @ (np.linalg.solve(rgb_to_xyz(space), rgb_to_xyz("sRGB"))).T
    there = np.clip(there, 0, 1)
    stored = there ** (1 / gamma) if gamma else encode_srgb(there)
    return np.round(stored * 65535).astype(np.uint16)


def tiff_with_profile(rgb: np.ndarray, profile: bytes) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(rgb).save(buffer, "TIFF", icc_profile=profile)
    return buffer.getvalue()


def webp_with_profile(rgb: np.ndarray, profile: bytes) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(rgb).save(buffer, "WEBP", icc_profile=profile, lossless=True)
    return buffer.getvalue()


@pytest.fixture
def read(tmp_path):
    def reader(data: bytes):
        path = tmp_path / "a.jpg"
        path.write_bytes(data)
        return read_photo(path)

    return reader


@pytest.mark.parametrize("kind", SPACES)
def test_a_copy_gives_the_pixels_of_its_srgb_twin(read, kind):
    space, curve, gamma = SPACES[kind]
    copy = copy_of(TWIN, space, gamma)
    photo = read(png_with_profile(encoded(".png", copy), icc_profile(space, curve)))
    assert photo.pixels.dtype == np.uint16
    assert photo.note == ""
    assert np.abs(photo.pixels / 257 - TWIN).max() < 1
    # Without the profile the same file is off by much more.
    assert np.abs(copy / 257 - TWIN).max() > 8


@pytest.mark.parametrize("kind", ["jpeg", "jpeg in parts", "tiff", "webp"])
def test_profiles_of_all_kinds_of_files(read, kind):
    """Copies of 8 bits: their rounding costs up to 1.5 steps, JPEG some more."""
    profile = icc_profile("Display P3", SRGB_FORMULA)
    copy = (copy_of(MUTED, "Display P3", None) / 257).round().astype(np.uint8)
    if kind.startswith("jpeg"):
        data = encoded(".jpg", copy, *BEST)
        data = jpeg_with_profile(data, profile, 100 if "parts" in kind else 65000)
    else:
        data = {"tiff": tiff_with_profile, "webp": webp_with_profile}[kind](
            copy, profile
        )
    error = np.abs(read(data).pixels / 257 - MUTED)
    assert error.max() < (8 if kind.startswith("jpeg") else 1.5)
    assert np.median(error) < 1


CURVES = {
    "power": power_curve(1.8),
    "identity": b"curv" + bytes(8),
    "table": table_curve(STEPS**2.2),
    "short table": table_curve(np.linspace(0, 1, 20) ** 2),
    "formula 0": formula_curve(0, 2.2),
    "formula 1": formula_curve(1, 2.4, 0.9, 0.1),
    "formula 2": formula_curve(2, 2.4, 0.8, 0.1, 0.05),
    "formula 3": SRGB_FORMULA,
    "formula 4": formula_curve(4, 2.2, 0.9, 0.08, 0.2, 0.05, 0.02, 0.0),
}


@pytest.mark.parametrize("kind", CURVES)
def test_profiles_are_read_as_littlecms_reads_them(kind):
    data = icc_profile("Adobe RGB", CURVES[kind])
    levels = np.arange(0, 256, 15)
    rgb = np.stack(np.meshgrid(levels, levels, levels), -1).reshape(18, -1, 3)
    rgb = rgb.astype(np.uint8)
    expected = ImageCms.profileToProfile(
        Image.fromarray(rgb),
        ImageCms.ImageCmsProfile(io.BytesIO(data)),
        ImageCms.createProfile("sRGB"),
        renderingIntent=ImageCms.Intent.RELATIVE_COLORIMETRIC,
        flags=ImageCms.Flags.NOOPTIMIZE | ImageCms.Flags.HIGHRESPRECALC,
    )
    found = to_srgb(rgb, read_profile(data)) / 257
    assert np.abs(found - np.asarray(expected)).max() < 1


def test_srgb_under_any_name_leaves_the_pixels_alone(read):
    for curve in (SRGB_FORMULA, table_curve(SRGB_STEPS)):
        profile = icc_profile("sRGB", curve)
        assert is_srgb(read_profile(profile))
        photo = read(png_with_profile(encoded(".png", TWIN), profile))
        assert photo.pixels.dtype == np.uint8
        np.testing.assert_array_equal(photo.pixels, TWIN)
    assert not is_srgb(read_profile(icc_profile("sRGB", power_curve(1.8))))


def test_grey_profile(read):
    profile = icc_profile("sRGB", power_curve(1.0), b"GRAY")
    grey = TWIN[..., 0]
    photo = read(png_with_profile(encoded(".png", grey), profile))
    expected = encode_srgb(grey / 255)
    assert np.abs(photo.pixels / 65535 - expected[..., None]).max() < 1e-3


def test_codes_of_h273(read):
    """PNG's cICP with the primaries of Display P3, and what is not a curve of ours."""
    copy = copy_of(TWIN, "Display P3", None)
    chunk = struct.pack(">I4s4B", 4, b"cICP", 12, 13, 0, 1)
    png = encoded(".png", copy)
    photo = read(png[:33] + chunk + bytes(4) + png[33:])
    assert np.abs(photo.pixels / 257 - TWIN).max() < 1
    assert coded_profile(1, 13) is None
    with pytest.raises(ProfileError, match="code 9"):
        coded_profile(9, 9)


def test_adobe_rgb_of_a_camera_that_embeds_no_profile(read):
    """EXIF's interoperability index R03 (DCF 2.0)."""

    def entry(tag: int, kind: int, count: int, value: bytes) -> bytes:
        body = struct.pack(">HHHI", 1, tag, kind, count) + value
        return body + bytes(4)

    exif = b"MM\0*\0\0\0\x08" + entry(34665, 4, 1, struct.pack(">I", 26))
    exif += entry(40965, 4, 1, struct.pack(">I", 44)) + entry(1, 2, 4, b"R03\0")
    body = b"Exif\0\0" + exif
    copy = (copy_of(MUTED, "Adobe RGB", 563 / 256) / 257).round().astype(np.uint8)
    jpeg = encoded(".jpg", copy, *BEST)
    segment = b"\xff\xe1" + struct.pack(">H", len(body) + 2) + body
    error = np.abs(read(jpeg[:2] + segment + jpeg[2:]).pixels / 257 - MUTED)
    assert error.max() < 8 and np.median(error) < 1


@pytest.mark.parametrize(
    "profile, words",
    [
        (b"nothing", "damaged"),
        (icc_profile("sRGB", SRGB_FORMULA, b"CMYK"), "not one of RGB"),
        (icc_profile("sRGB", b"mAB " + bytes(20)), "unknown kind of curve"),
        (icc_profile("sRGB", SRGB_FORMULA).replace(b"rXYZ", b"A2B0"), "tables"),
        (icc_profile("sRGB", SRGB_FORMULA)[:200], "tables|damaged|curve"),
    ],
)
def test_a_profile_that_cannot_be_used_is_noted(read, profile, words):
    photo = read(png_with_profile(encoded(".png", TWIN), profile))
    np.testing.assert_array_equal(photo.pixels, TWIN)
    assert photo.note.startswith("read as sRGB: its colour profile")
    with pytest.raises(ProfileError, match=words):
        read_profile(profile)
    # The note goes with the cut-out.
    assert cut(photo, (0, 0, 20, 20)).note == photo.note


GOOD = icc_profile("Display P3", table_curve(np.linspace(0, 1, 9) ** 2))


@given(st.lists(st.tuples(st.integers(0, len(GOOD) - 1), st.integers(0, 255))))
@settings(max_examples=200, deadline=None)
def test_a_damaged_profile_is_refused_or_gives_pixels(changes):
    data = bytearray(GOOD)
    for at, value in changes:
        data[at] = value
    try:
        profile = read_profile(bytes(data))
    except ProfileError:
        return
    assert to_srgb(TWIN[:8, :8], profile).shape == (8, 8, 3)
    assert np.isfinite(profile.linear_srgb(TWIN / 255)).all()
