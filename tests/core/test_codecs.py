"""HEIC, AVIF and JPEG 2000: turned once, all bits, the right colours, or a sentence."""

import struct
import subprocess
import sys

import numpy as np
import pytest
from bsface.images.decode import LIMITS, Limits
from bsface.images.header import read_header
from bsface.images.read import read_photo
from pictures_for_tests import (
    SRGB_FORMULA,
    by_pillow,
    heic,
    icc_profile,
)
from PIL import Image

pytest.importorskip("pi_heif")
pytest.importorskip("pillow_heif")

PICTURE = np.full((96, 128, 3), 128, np.uint8)
PICTURE[:32, :32] = (255, 0, 0)
PICTURE[:32, -32:] = (0, 255, 0)
PICTURE[-32:, :32] = (0, 0, 255)
RIGHT = np.rot90(PICTURE, -1)
SIX = Image.Exif()
SIX[274] = 6


@pytest.fixture
def read(tmp_path):
    def reader(data: bytes, limits: Limits = LIMITS):
        path = tmp_path / "a.heic"
        path.write_bytes(data)
        return read_photo(path, limits=limits)

    return reader


FILES = {
    "HEIC": lambda: heic(PICTURE),
    "AVIF": lambda: by_pillow("AVIF", PICTURE, quality=95),
    "JPEG 2000": lambda: by_pillow("JPEG2000", PICTURE),
}


def middles(pixels: np.ndarray) -> np.ndarray:
    """Where chroma subsampling and the codec's blocks do not blur."""
    return pixels[8::16, 8::16].astype(int)


@pytest.mark.parametrize("kind", FILES)
def test_header_and_pixels(read, kind):
    data = FILES[kind]()
    header = read_header(data)
    assert (header.format, header.width, header.height) == (kind, 128, 96)
    photo = read(data)
    assert photo.size == (128, 96)
    assert np.abs(middles(photo.pixels) - middles(PICTURE)).max() < 8


@pytest.mark.parametrize("kind", ["HEIC", "AVIF"])
def test_turned_once(read, kind):
    """Phones write both a turn of the box and one of EXIF."""
    if kind == "HEIC":
        data = heic(PICTURE, turn=6)
    else:
        data = by_pillow("AVIF", PICTURE, quality=95, exif=SIX.tobytes())
    photo = read(data)
    assert photo.size == (96, 128)
    assert np.abs(middles(photo.pixels) - middles(RIGHT)).max() < 8


def test_ten_bits_are_kept(read):
    ramp = np.zeros((64, 1024, 3), np.uint16)
    ramp[:] = (np.arange(1024, dtype=np.uint16) << 6)[None, :, None]
    photo = read(heic(ramp, quality=100))
    assert photo.pixels.dtype == np.uint16
    row = np.median(photo.pixels[..., 1], axis=0)
    assert len(np.unique(row)) > 600  # 8 bits have 256
    assert np.abs(row / 65535 - np.arange(1024) / 1023).max() < 0.01


@pytest.mark.parametrize("kind", ["HEIC", "AVIF"])
def test_display_p3_is_converted(read, kind):
    profile = icc_profile("Display P3", SRGB_FORMULA)
    stored = np.full((64, 64, 3), (200, 120, 90), np.uint8)
    if kind == "HEIC":
        data = heic(stored, profile=profile)
    else:
        data = by_pillow("AVIF", stored, quality=95, icc_profile=profile)
    pixels = read(data).pixels
    assert pixels.dtype == np.uint16
    # By LittleCMS: (213, 117, 83).
    assert np.abs(np.median(pixels, axis=(0, 1)) / 257 - (213, 117, 83)).max() < 3


def test_grey_and_sixteen_bits_of_jpeg_2000(read):
    grey = np.tile(np.arange(128, dtype=np.uint16) * 512, (96, 1))
    photo = read(by_pillow("JPEG2000", grey, irreversible=False))
    np.testing.assert_array_equal(photo.pixels, np.repeat(grey[..., None], 3, 2))
    photo = read(by_pillow("JPEG2000", PICTURE[..., 0]))
    np.testing.assert_array_equal(photo.pixels[..., 1], PICTURE[..., 0])
    codestream = by_pillow("JPEG2000", PICTURE, no_jp2=True)
    np.testing.assert_array_equal(read(codestream).pixels, PICTURE)


@pytest.mark.parametrize("kind", FILES)
def test_a_large_picture_is_read_reduced(read, kind):
    photo = read(FILES[kind](), Limits(full_size_pixels=4000))
    assert photo.pixels.shape == (48, 64, 3)
    assert photo.size == (128, 96) and photo.window[2] == 0.5


@pytest.mark.parametrize("kind", FILES)
def test_a_size_bomb_is_judged_by_the_header(read, kind):
    data = FILES[kind]()
    size = (96, 128) if kind == "JPEG 2000" else (128, 96)
    bomb = data.replace(struct.pack(">II", *size), struct.pack(">II", 60000, 60000))
    assert bomb != data
    failure = read(bomb)
    assert failure.code == "too_large" and "60000 x 60000" in failure.reason


@pytest.mark.parametrize("kind", ["HEIC", "AVIF"])
def test_a_first_box_without_room_for_its_head(read, kind):
    data = FILES[kind]()
    for size in range(2, 8):
        failure = read(struct.pack(">I", size) + data[4:])
        assert failure.code == "unreadable" and failure.reason.endswith(".")


@pytest.mark.parametrize("kind", FILES)
def test_cut_short(read, kind):
    data = FILES[kind]()
    failure = read(data[: len(data) * 2 // 3])
    assert failure.reason == "a.heic is damaged or cut short; copy or export it again."


def test_without_the_packages_a_sentence_names_the_remedy(tmp_path):
    for name, file in FILES.items():
        (tmp_path / name).write_bytes(file())
    program = """
import sys
from pathlib import Path
class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("PIL", "pi_heif"):
            raise ImportError(name + " is blocked")
sys.meta_path.insert(0, Blocker())
from bsface.images.read import read_photo
for path in Path(sys.argv[1]).iterdir():
    reason = read_photo(path).reason
    assert reason.startswith(path.name), reason
    assert "pip install 'bsface[heic]'" in reason, reason
"""
    run = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert run.returncode == 0, run.stderr
