"""What is fuzzed: every loader that reads a file from outside, and what must hold.

A loader either takes a file, and what it gives is then usable, or refuses it with the
promised exception and one sentence. Anything else is a finding.
"""

from __future__ import annotations

import atexit
import json
import shutil
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from bsface.batch.record import RECORD, Outcome, recall, summary_csv
from bsface.cli import info
from bsface.cli.arguments import parse_settings
from bsface.errors import PhotoFailure, ReconstructionError
from bsface.formats import export
from bsface.formats.face_file import face_bytes, load_face, npz_bytes
from bsface.formats.mesh_reader import read_mesh_vertices
from bsface.images.convert import to_srgb
from bsface.images.decode import Limits, judge_header
from bsface.images.header import read_header
from bsface.images.icc import ProfileError, read_profile
from bsface.images.mask_file import mask_file_beside, with_mask
from bsface.images.photo import Photo
from bsface.images.read import read_photo
from bsface.images.video import read_video
from bsface.json_text import to_json
from bsface.landmarks.landmarks import (
    LandmarkFileError,
    Landmarks,
    read_landmarks,
    write_landmarks,
)
from bsface.settings import Settings
from bsface.surface.template import BUNDLED, load_template
from fake_face import bare_reconstruction, painted_reconstruction
from hypothesis import strategies as st

sys.path.insert(0, str(Path(__file__).resolve().parent))

from mutations import inside_zip, mutated  # noqa: E402
from pictures_for_tests import (  # noqa: E402
    SRGB_FORMULA,
    animated,
    by_pillow,
    cmyk,
    heic,
    icc_profile,
    jpeg_with_profile,
    palette,
    png_with_profile,
    table_curve,
)
from videos_for_tests import write_clip  # noqa: E402

# Mutated headers claim pictures of any size; decoding large ones is only slow.
LIMITS = Limits(pixels=1_000_000)


@dataclass(frozen=True)
class Target:
    """A loader to fuzz.

    Attributes
    ----------
    name : str
    inputs : strategy of bytes
    run : callable
        Takes the bytes; True if they were accepted, False if refused in a sentence;
        raises on a finding.
    """

    name: str
    inputs: st.SearchStrategy[bytes]
    run: Callable[[bytes], bool]


def sentence(text: str) -> None:
    """One line with an end, without the words of a programmer."""
    assert text and "\n" not in text and "\r" not in text, repr(text)
    assert text[-1] in ".)", repr(text)
    text.encode("utf-8")  # can be printed


def _loaded(load: Callable, refusal: type[Exception], *args):
    """What a loader makes of its arguments; None if it refuses them in a sentence."""
    try:
        return load(*args)
    except refusal as error:
        sentence(str(error))
        return None


@lru_cache
def _place() -> Path:
    place = Path(tempfile.mkdtemp(prefix="bsface-fuzz-"))
    # A process that dies leaves it, for tools/fuzz.py to name.
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    return place


def _file(name: str, data: bytes) -> Path:
    path = _place() / name
    path.write_bytes(data)
    return path


# --- pictures ------------------------------------------------------------------------


def _pictures() -> list[bytes]:
    rng = np.random.default_rng(0)
    rgb = np.repeat(np.repeat(rng.integers(0, 256, (8, 10, 3)), 4, 0), 4, 1)
    rgb = rgb.astype(np.uint8)
    deep = rgb.astype(np.uint16) * 257
    alpha = np.dstack([rgb, rgb[..., :1]])
    stored = [
        (".jpg", rgb),
        (".png", rgb),
        (".png", deep),
        (".png", alpha),
        (".png", rgb[..., 0]),
        (".tif", rgb),
        (".tif", deep),
        (".bmp", rgb),
        (".webp", rgb),
        (".ppm", rgb),
        (".pgm", rgb[..., 0]),
    ]
    coded = [cv2.imencode(ending, pixels)[1].tobytes() for ending, pixels in stored]
    coded += [cmyk(rgb), palette(rgb), animated([rgb, rgb[::-1]])]
    profile = icc_profile("Display P3", SRGB_FORMULA)
    coded += [png_with_profile(coded[1], profile), jpeg_with_profile(coded[0], profile)]
    return coded


def _optional_pictures() -> list[bytes]:
    """HEIC, AVIF and JPEG 2000."""
    rng = np.random.default_rng(0)
    rgb = np.repeat(np.repeat(rng.integers(0, 256, (4, 5, 3)), 16, 0), 16, 1)
    rgb = rgb.astype(np.uint8)
    ten = (rgb.astype(np.uint16) << 8) & 0xFFC0
    profile = icc_profile("Display P3", SRGB_FORMULA)
    return [
        heic(rgb, quality=50, turn=6),
        heic(ten, quality=50, profile=profile),
        by_pillow("AVIF", rgb, icc_profile=profile),
        by_pillow("JPEG2000", rgb),
        by_pillow("JPEG2000", rgb[..., 0]),
        by_pillow("JPEG2000", rgb, no_jp2=True, irreversible=True),
    ]


def _clips() -> list[bytes]:
    rng = np.random.default_rng(2)
    frames = rng.integers(0, 256, (3, 48, 48, 3)).astype(np.uint8)
    found = []
    for ending in (".mp4", ".avi", ".mkv"):
        path = write_clip(_place() / f"seed{ending}", list(frames))
        found.append(path.read_bytes())
    return found


def _video(data: bytes) -> bool:
    video = read_video(_file("clip.mp4", data), limits=LIMITS)
    if isinstance(video, PhotoFailure):
        sentence(video.reason)
        return False
    assert len(set(video.names)) == len(video.frames) > 0
    for photo in video.photos():
        assert photo.pixels.ndim == 3 and photo.pixels.dtype == np.uint8
    return True


def _profile(data: bytes) -> bool:
    """An ICC profile, and pixels in its colour space."""
    try:
        profile = read_profile(data)
    except ProfileError as error:
        sentence(f"read as sRGB: {error}.")
        return False
    pixels = np.arange(192, dtype=np.uint8).reshape(8, 8, 3)
    assert to_srgb(pixels, profile).shape == (8, 8, 3)
    return True


def _header(data: bytes) -> bool:
    header = read_header(data)
    if header is None:
        return False
    assert header.bytes_per_pixel >= 0
    failure = judge_header(header, "a.jpg")
    if failure is not None:
        sentence(failure.reason)
    return failure is None


def _photo(data: bytes) -> bool:
    path = _file("photo.jpg", data)
    photo = read_photo(path, limits=LIMITS)
    if isinstance(photo, PhotoFailure):
        sentence(photo.reason)
        return False
    assert photo.pixels.ndim == 3 and photo.pixels.shape[2] == 3
    assert np.isfinite(photo.linear()).all()
    return True


def _masks() -> list[bytes]:
    """Masks of a photo of 40 x 32 pixels: every kind of picture is read as one."""
    grey = np.zeros((32, 40), np.uint8)
    grey[8:24, 10:30] = 255
    half = cv2.resize(grey, (80, 64), interpolation=cv2.INTER_AREA)
    alpha = np.dstack([grey] * 4)
    kinds = [(".png", grey), (".png", half), (".png", alpha), (".jpg", grey)]
    coded = [cv2.imencode(ending, pixels)[1].tobytes() for ending, pixels in kinds]
    deep = cv2.imencode(".png", grey.astype(np.uint16) * 257)[1].tobytes()
    return [*coded, deep, heic(np.dstack([half] * 3), quality=50)]


def _mask(data: bytes) -> bool:
    """A photo and the mask that lies beside it."""
    path = _place() / "masked.jpg"
    _file("masked.mask.png", data)
    assert mask_file_beside(path) is not None
    photo = with_mask(Photo("masked.jpg", path, (40, 32), np.zeros((32, 40, 3), "u1")))
    if isinstance(photo, PhotoFailure):
        sentence(photo.reason)
        return False
    assert photo.mask is not None and photo.mask.ndim == 2
    assert 0 <= photo.mask.min() <= photo.mask.max() <= 1
    return True


# --- landmarks, settings -------------------------------------------------------------


def _landmark_files(ending: str) -> list[bytes]:
    rng = np.random.default_rng(1)
    found = []
    for scheme in ("68",) if ending == ".pts" else ("468", "68", "40"):
        count = int(scheme)
        points = rng.uniform(0, 99, (count, 2)).round(2)
        path = _place() / f"seed{ending}"
        marks = Landmarks("a.jpg", scheme, points, np.ones(count))
        write_landmarks(path, marks, (100, 100) if ending == ".json" else None)
        found.append(path.read_bytes())
    return found


def _landmarks(ending: str) -> Callable[[bytes], bool]:
    def run(data: bytes) -> bool:
        path = _file(f"marks{ending}", data)
        found = _loaded(read_landmarks, LandmarkFileError, path, "a.jpg", (100, 100))
        if found is None:
            return False
        assert np.isfinite(found.points).all() and np.isfinite(found.weight).all()
        return True

    return run


def _settings(data: bytes) -> bool:
    """A JSON object, as Blender's operators and face files hold it."""
    try:
        values = json.loads(data)
    except (ValueError, RecursionError):
        return False  # said by whoever reads the JSON
    found = _loaded(Settings.from_dict, ValueError, values)
    if found is None:
        return False
    assert Settings.from_dict(json.loads(json.dumps(found.to_dict()))) == found
    return True


def _words(data: bytes) -> bool:
    """Words of ``--set``, one a line."""
    try:
        parse_settings(data.decode("utf-8", "surrogateescape").split("\n"))
    except ValueError as error:
        assert "\n" not in str(error)
        return False
    return True


# --- npz -----------------------------------------------------------------------------


def _small_template() -> bytes:
    with np.load(BUNDLED) as z:
        arrays = {name: z[name] for name in z.files}
    for name in ("control_points", "identity_modes", "expression_modes"):
        every = arrays[name][..., ::4, ::4, :]
        arrays[name] = every if every.ndim == 3 else every[:1]
    arrays["skin"] = arrays["skin"][::8, ::8]
    return npz_bytes(arrays)


def _template(data: bytes) -> bool:
    found = _loaded(load_template, ValueError, _file("template.npz", data))
    if found is None:
        return False
    inside = found.inside(found.landmark_uv)
    assert inside.shape == (468,) and found.eye_distance > 0
    normals = found.surface.normals(*found.landmark_uv.T)
    assert np.isfinite(normals).all()
    found.resampled((9, 10))
    return True


def _faces() -> list[bytes]:
    whole = painted_reconstruction(count=2, side=48)
    faces = (bare_reconstruction(), whole)
    return [face_bytes(face, "2026-01-01T00:00:00Z") for face in faces]


def _face(data: bytes) -> bool:
    found = _loaded(load_face, ReconstructionError, _file("face.npz", data))
    if found is None:
        return False
    # A surface that the file may hold is one that a file of another kind may take.
    _loaded(export, ReconstructionError, _place() / "face.nurbs.obj", found)
    facts = info.summary(found)
    to_json(facts)
    "\n".join(info._lines(facts))
    assert len(found.cameras) == len(found.photos)
    assert len(found.landmarks) in (0, len(found.photos))
    return True


# --- meshes ---------------------------------------------------------------------------


def _meshes() -> list[bytes]:
    face = bare_reconstruction()
    found = []
    for ending in (".obj", ".ply", ".stl"):
        path = export(_place() / f"seed{ending}", face, tolerance=2.0)
        found.append(path.read_bytes())
    return found


def _mesh(data: bytes) -> bool:
    """The content says little about the kind: each reader gets every file."""
    taken = False
    for ending in (".obj", ".ply", ".stl"):
        path = _file(f"mesh{ending}", data)
        points = _loaded(read_mesh_vertices, ReconstructionError, path)
        if points is not None:
            assert points.ndim == 2 and points.shape[1] == 3 and len(points)
            assert np.isfinite(points).all()
            taken = True
    return taken


# --- what a batch remembers ----------------------------------------------------------


def _records() -> list[bytes]:
    record = {
        "fingerprint": "0" * 64,
        "used": 3,
        "photos": 4,
        "warnings": ["Only 3 photos are used."],
        "files": {},
    }
    return [json.dumps(record, indent=1).encode()]


def _record(data: bytes) -> bool:
    path = _file(RECORD, data)
    found = recall(path.parent, "0" * 64)
    if found is None:
        return False
    assert isinstance(found, Outcome)
    summary_csv([found])
    return True


def targets() -> list[Target]:
    """All of them."""
    pictures = _pictures()
    settings = [json.dumps(Settings().to_dict()).encode()]
    words = [b"method=motion\ncontrol_points=30,30\nlam=1e2\ndetector=false"]
    optional = _optional_pictures()
    profiles = [
        icc_profile("Display P3", curve)
        for curve in (SRGB_FORMULA, table_curve(np.linspace(0, 1, 9) ** 2))
    ]
    return [
        Target("image header", mutated([*pictures, *optional]), _header),
        Target("image file", mutated(pictures), _photo),
        Target("HEIC, AVIF, JPEG 2000", mutated(optional), _photo),
        Target("colour profile", mutated(profiles), _profile),
        Target("video", mutated(_clips()), _video),
        Target("mask file", mutated(_masks()), _mask),
        Target("landmarks .pts", mutated(_landmark_files(".pts")), _landmarks(".pts")),
        Target(
            "landmarks .json", mutated(_landmark_files(".json")), _landmarks(".json")
        ),
        Target("settings as JSON", mutated(settings), _settings),
        Target("settings as words", mutated(words), _words),
        Target("template file", inside_zip([_small_template()]), _template),
        Target("face file", inside_zip(_faces()), _face),
        Target("mesh file", mutated(_meshes()), _mesh),
        Target("record of a batch", mutated(_records()), _record),
    ]
