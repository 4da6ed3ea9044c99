"""The table of bad input: what a user can hand over, and what has to come of it.

Shared by the tests, which run every row through the library and the command line, and
by ``docs/bad_input_page.py``, which writes the messages to ``docs/bad_input.md``.
"""

from __future__ import annotations

import atexit
import contextlib
import io
import json
import os
import pickle
import shutil
import struct
import tempfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any
from unittest import mock

import cv2
import numpy as np
from bsface import __main__
from bsface.surface.template import BUNDLED
from fake_face import person_folder

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = ROOT / "examples" / "photos"
QUICK = [
    "--set=method=motion",
    "--set=control_points=10,11",
    "--set=landmarks=68",
]
SETTINGS = {"method": "motion", "control_points": (10, 11), "landmarks": "68"}


@dataclass(frozen=True)
class PhotoRow:
    """One photo of a folder in which others are good.

    ``code`` is the status that it gets: "used" or a failure code.
    """

    title: str
    name: str
    code: str


@dataclass(frozen=True)
class JobRow:
    """One call that cannot be carried out, or only with a warning.

    ``make`` lays things out in an empty folder and returns the words of the command
    line; ``exit`` is the exit code, ``words`` a part of the sentence. Within
    ``hold()`` the fault lasts, such as a full disk.
    """

    title: str
    make: Callable[[Path], list[str]]
    exit: int
    words: str
    hold: Callable[[], Any] = field(default=contextlib.nullcontext)
    library: bool = True  #: whether the library has this door too


@dataclass(frozen=True)
class Said:
    """What the command line did."""

    exit: int
    printed: str
    errors: str
    left: frozenset[str]  #: files in the folder of the output afterwards


def run(words: list[str], folder: Path) -> Said:
    """Run the command line in this process."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = __main__.main(words)
    left = frozenset(os.listdir(folder)) if folder.is_dir() else frozenset()
    return Said(code, out.getvalue(), err.getvalue(), left)


# --- photos --------------------------------------------------------------------------


def encoded(ending: str, rgb: np.ndarray, *options: int) -> bytes:
    order = [2, 1, 0] + [3] * (rgb.shape[2] == 4) if rgb.ndim == 3 else None
    data = rgb if order is None else np.ascontiguousarray(rgb[..., order])
    done, buffer = cv2.imencode(ending, data, list(options))
    assert done
    return buffer.tobytes()


def bomb(width: int, height: int) -> bytes:
    """A PNG of some bytes that claims a picture of any size."""

    def chunk(name: bytes, body: bytes) -> bytes:
        crc = zlib.crc32(name + body)
        return struct.pack(">I", len(body)) + name + body + struct.pack(">I", crc)

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    body = chunk(b"IDAT", zlib.compress(b"\0" * 1000)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + body


def exif_turned(jpeg: bytes, orientation: int) -> bytes:
    tiff = b"MM\0*\0\0\0\x08" + struct.pack(">HHHIHHI", 1, 274, 3, 1, orientation, 0, 0)
    body = b"Exif\0\0" + tiff
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(body) + 2) + body + jpeg[2:]


class Folder:
    """Lays out photos of a drawn person with landmark files beside them."""

    def __init__(self, folder: Path, count: int) -> None:
        store = person_folder(folder.with_name("drawn"), count=count, side=160)
        self.folder = folder
        folder.mkdir(parents=True)
        self.stock = []
        for index in range(count):
            pixels = cv2.imread(str(store / f"{index}.png"))[..., ::-1]
            record = json.loads((store / f"{index}.json").read_text())
            self.stock.append((pixels, np.array(record["points"])))
        shutil.rmtree(store)

    def next(self) -> tuple[np.ndarray, np.ndarray]:
        """A photo that was not used yet, and its 468 landmarks."""
        return self.stock.pop()

    def save(
        self,
        name: str,
        pixels: np.ndarray | bytes,
        points: Any = None,
        *options: int,
        **record: Any,
    ) -> None:
        path = self.folder / name
        data = (
            pixels
            if isinstance(pixels, bytes)
            else encoded(path.suffix, pixels, *options)
        )
        path.write_bytes(data)
        if points is not None:
            content = {"scheme": "468", "points": np.asarray(points).tolist(), **record}
            path.with_suffix(".json").write_text(json.dumps(content))


def photo_rows(folder: Path) -> list[PhotoRow]:
    """A folder with every kind of bad photo, and some good ones."""
    lay = Folder(folder, 32)
    rows: list[PhotoRow] = []

    def add(title: str, name: str, code: str, *content: Any, **record: Any) -> None:
        lay.save(name, *content, **record)
        rows.append(PhotoRow(title, name, code))

    side = 160
    for index in range(3):
        add("a good photo", f"good {index}.png", "used", *lay.next())

    # pictures that are read, however they are stored
    pixels, points = lay.next()
    add("16 bits", "deep.png", "used", pixels.astype(np.uint16) * 257, points)
    pixels, points = lay.next()
    grey = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
    add("grey", "grey.png", "used", grey, points)
    pixels, points = lay.next()
    alpha = np.dstack([pixels, np.full(pixels.shape[:2], 99, np.uint8)])
    add("with alpha", "alpha.png", "used", alpha, points)
    pixels, points = lay.next()
    # stored lying, seen upright: the landmarks speak of the picture as it is seen
    jpeg = encoded(".jpg", np.rot90(pixels), cv2.IMWRITE_JPEG_QUALITY, 95)
    add("turned by EXIF", "turned.jpg", "used", exif_turned(jpeg, 6), points)
    pixels, points = lay.next()
    long = "Фото 写真 é 😀 " + "x" * 90 + ".png"
    add("long name in several scripts", long, "used", pixels, points)
    pixels, points = lay.next()
    jpeg = encoded(".jpg", pixels, cv2.IMWRITE_JPEG_QUALITY, 95)
    add("JPEG named .png", "wrong ending.png", "used", jpeg, points)

    # files that are no pictures
    jpeg, png = (encoded(k, lay.next()[0]) for k in (".jpg", ".png"))
    add("text renamed .jpg", "text.jpg", "unreadable", b"Dear photo,\nyours")
    add("zero bytes", "empty.jpg", "unreadable", b"")
    add("JPEG cut short", "short.jpg", "unreadable", jpeg[: len(jpeg) // 2])
    add("PNG cut short", "short.png", "unreadable", png[: len(png) // 2])
    dot = np.zeros((1, 1, 3), np.uint8)
    add("1 x 1 pixel", "dot.png", "unreadable", dot)
    add("30,000 x 30,000 pixels", "huge.png", "too_large", bomb(30000, 30000))
    add("GIF", "moving.gif", "unreadable", b"GIF89a" + struct.pack("<HH", 99, 99))
    heic = b"\0\0\0\x18ftypheic" + b"\0" * 50
    add("HEIC of a phone", "phone.heic", "unreadable", heic)
    (folder / "loop.jpg").symlink_to(folder / "loop.jpg")
    rows.append(PhotoRow("symbolic link to itself", "loop.jpg", "unreadable"))
    (folder / "gone.jpg").symlink_to(folder / "moved away.jpg")
    rows.append(PhotoRow("symbolic link to nothing", "gone.jpg", "unreadable"))
    if hasattr(os, "mkfifo"):
        os.mkfifo(folder / "pipe.jpg")
        rows.append(PhotoRow("named pipe", "pipe.jpg", "unreadable"))

    # pictures of no use
    pixels, points = lay.next()
    add("a photo", "once.png", "used", pixels, points)
    add("the same photo again", "twice.png", "duplicate", pixels, points)
    pixels, points = lay.next()
    dark = (pixels * 0.02).astype(np.uint8)
    add("nearly black", "night.png", "dark", dark, points)
    pixels, points = lay.next()
    white = np.full_like(pixels, 255)
    add("nearly white", "snow.png", "bright", white, points)
    pixels, points = lay.next()
    soft = cv2.GaussianBlur(pixels, (0, 0), 8)
    add("out of focus", "soft.png", "blurred", soft, points)
    pixels, points = lay.next()
    small = np.full_like(pixels, 90)
    small[60:100, 60:100] = cv2.resize(pixels, (40, 40), interpolation=cv2.INTER_AREA)
    add("small face", "far.png", "small_face", small, points / 4 + 60)
    add("no landmark file, detector off", "bare.png", "no_face", lay.next()[0])

    # landmark files
    def marks(
        title: str,
        change: Callable[[np.ndarray], Any],
        code: str = "implausible",
        **record: Any,
    ) -> None:
        pixels, points = lay.next()
        add(title, f"marks {len(rows)}.png", code, pixels, change(points), **record)

    marks("landmarks: wrong count", lambda p: p[:-1])
    marks("landmarks: NaN", lambda p: np.where(np.arange(468)[:, None] == 5, np.nan, p))
    marks("landmarks: huge numbers", lambda p: p * 1e9)
    marks("landmarks: x and y swapped", lambda p: p[:, ::-1])
    marks("landmarks: upside down", lambda p: side - 1 - p)
    marks("landmarks: mirrored", lambda p: p * (-1, 1) + (side - 1, 0))
    marks("landmarks: all at one place", lambda p: p * 0 + 80, "small_face")
    marks("landmarks: beside the picture", lambda p: p + 5000)
    marks("landmarks: of another picture size", lambda p: p, image_size=[10, 10])
    marks("landmarks: unknown scheme", lambda p: p, scheme="500")
    marks("landmarks: text for numbers", lambda p: [["a", "b"]] * 468)
    marks("landmarks: weights below zero", lambda p: p, weights=[-1] * 468)
    pixels, points = lay.next()
    add("landmarks: .pts of another program", "pts.png", "implausible", pixels)
    (folder / "pts.pts").write_text("version: 1\nn_points: 68\n{\n1 2\n}\n")
    pixels, points = lay.next()
    add("landmarks: broken JSON", "json.png", "implausible", pixels)
    (folder / "json.json").write_text('{"scheme": "468", "points": [[')
    return rows


# --- photos that the detector looks at -----------------------------------------------


def detector_rows(folder: Path) -> list[PhotoRow]:
    """Photos without landmark files; needs the model files."""
    folder.mkdir(parents=True)
    pictures = [cv2.imread(str(EXAMPLES / f"{k:03d}.jpg")) for k in (0, 5, 11, 20, 2)]
    rows = []

    def add(title: str, name: str, code: str, pixels: np.ndarray) -> None:
        cv2.imwrite(str(folder / name), pixels)
        rows.append(PhotoRow(title, name, code))

    for k in range(3):
        add("a good photo", f"good {k}.png", "used", pictures[k])
    wall = np.full((300, 300, 3), 140, np.uint8)
    add("no face", "wall.png", "no_face", wall)
    add("all black", "black.png", "no_face", wall * 0)
    add("all white", "white.png", "no_face", wall * 0 + 255)
    add("two faces", "two.png", "used", np.hstack([pictures[3], pictures[4]]))
    add("upside down", "fallen.png", "used", pictures[4][::-1, ::-1])
    return rows


# --- calls ---------------------------------------------------------------------------


@lru_cache
def _drawn(count: int) -> Path:
    place = Path(tempfile.mkdtemp(prefix="bsface-bad-input-"))
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    return person_folder(place / "photos", count=count, side=160)


def good_folder(folder: Path, count: int = 3) -> str:
    return str(shutil.copytree(_drawn(count), folder / "photos"))


def call(make: Callable[[Path], str], *words: str, out: str = "face.npz"):
    """Words for photos that ``make`` lays out; ``out`` is the output's name."""

    def words_for(folder: Path) -> list[str]:
        target = out if out.startswith("/") else str(folder / "out" / out)
        return [make(folder), "-o", target, *QUICK, "--set=detector=false", *words]

    return words_for


def _file(folder: Path) -> str:
    path = folder / "portrait.jpg"
    path.write_bytes(b"a file")
    return str(path)


def _empty(folder: Path) -> str:
    (folder / "photos").mkdir()
    (folder / "photos" / "notes.txt").write_text("no pictures here")
    return str(folder / "photos")


def _unreadable(folder: Path) -> str:
    (folder / "photos").mkdir()
    for name in ("a.jpg", "b.png"):
        (folder / "photos" / name).write_text("no picture")
    return str(folder / "photos")


def _loop(folder: Path) -> str:
    (folder / "photos").symlink_to(folder / "photos")
    return str(folder / "photos")


def _output_is_folder(folder: Path) -> str:
    (folder / "out" / "face.npz").mkdir(parents=True)
    return good_folder(folder)


def _output_below_file(folder: Path) -> str:
    (folder / "out").write_text("a file")
    return good_folder(folder)


@contextlib.contextmanager
def full_disk() -> Iterator[None]:
    with mock.patch("os.replace", side_effect=OSError(28, "No space left on device")):
        yield


@contextlib.contextmanager
def little_memory() -> Iterator[None]:
    with mock.patch.object(__main__, "reconstruct", side_effect=MemoryError):
        yield


@contextlib.contextmanager
def no_models() -> Iterator[None]:
    place = "bsface.evidence.face_models.model_folders"
    with mock.patch(place, return_value=(Path("/nowhere/models"),)):
        yield


class Hostile:
    """Unpickling it would make a folder."""

    def __reduce__(self) -> tuple:
        return os.mkdir, ("hostile",)


def _template(change: Callable[[dict[str, np.ndarray]], Any]):
    """A template file in which something is wrong."""

    def words_for(folder: Path) -> list[str]:
        with np.load(BUNDLED, allow_pickle=False) as z:
            arrays = {k: z[k] for k in z.files}
        for name in ("identity_modes", "expression_modes"):
            arrays[name] = arrays[name][:1]
        path = folder / "template.npz"
        content = change(arrays)
        if isinstance(content, bytes):
            path.write_bytes(content)
        elif content is not None:
            np.savez(path, **content)
        return call(good_folder, f"--template={path}")(folder)

    return words_for


def _without_detector(words: list[str]) -> list[str]:
    return [w for w in words if w != "--set=detector=false"]


def job_rows() -> list[JobRow]:
    """Calls that fail as a whole."""
    photos = [
        JobRow("no such folder", call(lambda f: str(f / "none")), 1, "cannot open"),
        JobRow("a file instead of a folder", call(_file), 1, "is a file"),
        JobRow("a folder without pictures", call(_empty), 1, "holds no photos"),
        JobRow("no picture can be read", call(_unreadable), 1, "None of the 2 photos"),
        JobRow("folder linked to itself", call(_loop), 1, "cannot open"),
        JobRow(
            "a folder name that is too long",
            call(lambda f: str(f / ("x" * 300))),
            1,
            "cannot open",
        ),
        JobRow(
            "all photos set aside",
            call(good_folder, "--ignore=0.png", "--ignore=1.png", "--ignore=2.png"),
            1,
            "3 are set aside",
        ),
        JobRow(
            "the detector's files are missing",
            lambda f: _without_detector(call(lambda f: str(EXAMPLES))(f)),
            1,
            "dev.py setup",
            no_models,
        ),
        JobRow("one photo", call(lambda f: good_folder(f, 1)), 0, "one photo"),
        JobRow("two photos", call(lambda f: good_folder(f, 2)), 0, "Only 2 photos"),
    ]
    output = [
        JobRow("the output is a folder", call(_output_is_folder), 2, "is a folder"),
        JobRow("the output's folder is a file", call(_output_below_file), 2, "a file"),
        JobRow(
            "a place where nothing can be written",
            call(good_folder, out="/proc/none/face.npz"),
            1,
            "cannot be written",
        ),
        JobRow("the disk is full", call(good_folder), 1, "free space", full_disk),
        JobRow("unknown ending", call(good_folder, out="face.doc"), 2, "ending"),
        JobRow("no ending", call(good_folder, out="face"), 2, "ending"),
        JobRow("not enough memory", call(good_folder), 1, "memory", little_memory),
    ]
    options = [
        ("net too small", "control_points=3,3"),
        ("net too large", "control_points=500,500"),
        ("not a number", "distance_mm=NaN"),
        ("infinite", "smooth_mm=Infinity"),
        ("negative", "iterations=-1"),
        ("a fraction where a whole number is wanted", "iterations=2.5"),
        ("text for a number", "lam=much"),
        ("neither true nor false", "detector=perhaps"),
        ("unknown method", "method=magic"),
        ("unknown setting", "colour=red"),
        ("no value", "method"),
    ]
    wrong = [
        JobRow(
            f"setting: {title}",
            call(good_folder, f"--set={word}"),
            2,
            word.split("=")[0],
        )
        for title, word in options
    ]
    said = "is not a template file"
    templates = [
        JobRow("template: missing", _template(lambda a: None), 2, said),
        JobRow("template: text", _template(lambda a: b"hello"), 2, said),
        JobRow(
            "template: a pickle", _template(lambda a: pickle.dumps(Hostile())), 2, said
        ),
        JobRow(
            "template: pickled objects inside",
            _template(lambda a: a | {"skin": np.array([Hostile()], object)}),
            2,
            said,
        ),
        JobRow(
            "template: wrong shape",
            _template(lambda a: a | {"landmark_uv": a["landmark_uv"][:9]}),
            2,
            "landmark_uv must hold",
        ),
        JobRow(
            "template: NaN",
            _template(lambda a: a | {"control_points": a["control_points"] * np.nan}),
            2,
            "not finite",
        ),
        JobRow(
            "template: something is missing",
            _template(lambda a: {k: v for k, v in a.items() if k != "skin"}),
            2,
            "skin is missing",
        ),
    ]
    commands = [
        JobRow(title, make, 1, words, library=False)
        for title, make, words in (
            (
                "export: no such file",
                lambda f: ["export", str(f / "none.npz"), "-o", str(f / "a.obj")],
                "there is no such file",
            ),
            (
                "export: not a face file",
                lambda f: ["export", str(BUNDLED), "-o", str(f / "a.obj")],
                "not a face file",
            ),
            ("info: text", lambda f: ["info", _file(f)], "not a readable .npz file"),
            (
                "batch: no such folder",
                lambda f: ["batch", str(f / "none"), str(f / "out")],
                "cannot open this folder",
            ),
            (
                "batch: no folders in it",
                lambda f: ["batch", good_folder(f), str(f / "out")],
                "has no sub-folders",
            ),
        )
    ]
    return [*photos, *output, *wrong, *templates, *commands]


# --- the page ------------------------------------------------------------------------


def message(row: JobRow, said: Said) -> str:
    """The sentence of a call: the last line, or the note that the row is about."""
    lines = said.errors.strip().splitlines()
    return next((x for x in lines if row.exit == 0 and row.words in x), lines[-1])


def table_line(folder: Path, *cells: object) -> str:
    """A line of the page, with the test's folder shown as a user's."""
    text = (str(cell).replace(str(folder), "/home/ann") for cell in cells)
    text = (cell.replace(str(ROOT), "/opt/bsface") for cell in text)
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in text) + " |"
