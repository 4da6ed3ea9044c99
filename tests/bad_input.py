"""The table of bad input: calls that cannot be carried out, or only with a warning.

The tests run every row through the library, the command line and Blender's operators
(`bad_input_doors`). Bad photos in a good folder: `bad_photos`.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import pickle
import shutil
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from bad_photos import EXAMPLES
from bsface.surface.template import BUNDLED
from fake_face import person_folder
from permissions import as_ordinary_user, little_memory, no_larger_files

ROOT = Path(__file__).resolve().parents[1]
QUICK = [
    "--set=method=motion",
    "--set=control_points=10,11",
    "--set=landmarks=68",
]
SETTINGS = {"method": "motion", "control_points": (10, 11), "landmarks": "68"}


@dataclass(frozen=True)
class JobRow:
    """One call that cannot be carried out, or only with a warning.

    ``make`` lays things out in an empty folder and returns the words of the command
    line; ``exit`` is the exit code, ``words`` a part of the sentence. Within
    ``hold()`` the fault lasts, such as a full disk; all faults are real.
    """

    title: str
    make: Callable[[Path], list[str]]
    exit: int
    words: str
    hold: Callable[[], Any] = contextlib.nullcontext
    library: bool = True  #: whether the library has this door too
    blender: str = "reconstruct"  #: operator that meets the fault; "" = none
    models: bool = False  #: whether the face models are needed


# --- calls ---------------------------------------------------------------------------


@lru_cache
def _drawn(count: int, yaw: float = 25.0) -> Path:
    place = Path(tempfile.mkdtemp(prefix="bsface-bad-input-"))
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    low = -25.0 if yaw == 25.0 else yaw
    return person_folder(place / "photos", count=count, side=160, yaw=(low, yaw))


def good_folder(folder: Path, count: int = 3) -> str:
    return str(shutil.copytree(_drawn(count), folder / "photos"))


def _profiles(folder: Path) -> str:
    return str(shutil.copytree(_drawn(3, 75.0), folder / "photos"))


def _forty_times(folder: Path) -> str:
    good_folder(folder, 1)
    for ending in (".png", ".json"):
        first = folder / "photos" / f"0{ending}"
        for number in range(1, 40):
            shutil.copy(first, first.with_stem(str(number)))
    return str(folder / "photos")


def _walls(folder: Path, grey: int = 140) -> str:
    """Two small pictures without a face."""
    (folder / "photos").mkdir()
    for name in ("a.png", "b.png"):
        side = 48 + (name > "b")
        wall = np.full((side, side, 3), grey, np.uint8)
        cv2.imwrite(str(folder / "photos" / name), wall)
    return str(folder / "photos")


def _deep(folder: Path) -> str:
    """A path of some 3,000 characters."""
    deep = folder.joinpath(*["x" * 200] * 15)
    deep.mkdir(parents=True)
    return good_folder(deep)


def _locked(folder: Path) -> str:
    path = good_folder(folder)
    Path(path).chmod(0)
    return path


def _read_only_output(folder: Path) -> str:
    (folder / "out").mkdir()
    (folder / "out").chmod(0o555)
    return good_folder(folder)


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
    return str(folder / "photos")


def _notes(folder: Path) -> str:
    (folder / "photos").mkdir()
    (folder / "photos" / "notes.txt").write_text("no pictures here")
    return str(folder / "photos")


def _unreadable(folder: Path) -> str:
    (folder / "photos").mkdir()
    for name in ("a.jpg", "b.png"):
        (folder / "photos" / name).write_text("no picture")
    return str(folder / "photos")


def _loop(folder: Path) -> str:
    folder.mkdir(exist_ok=True)
    (folder / "photos").symlink_to(folder / "photos")
    return str(folder / "photos")


def _output_is_loop(folder: Path) -> str:
    (folder / "out").symlink_to("out")
    return good_folder(folder)


def _output_is_folder(folder: Path) -> str:
    (folder / "out" / "face.npz").mkdir(parents=True)
    return good_folder(folder)


def _output_below_file(folder: Path) -> str:
    (folder / "out").write_text("a file")
    return good_folder(folder)


def small_disk() -> Any:
    return no_larger_files(5000)


@contextlib.contextmanager
def no_models() -> Iterator[None]:
    """No folder in which a library outside of Blender looks holds the models."""
    names = {"XDG_CACHE_HOME": "/nowhere", "BSFACE_MODELS": "/nowhere"}
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(names)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


def _vast(folder: Path) -> str:
    """96 megapixels that take no room on the disk but 288 MB in memory."""
    photos = Path(good_folder(folder))
    with (photos / "9.pgm").open("wb") as file:
        start = file.write(b"P5\n12000 8000\n255\n")
        file.truncate(start + 96_000_000)
    return str(photos)


def _bomb_file(folder: Path) -> list[str]:
    """A small file that claims and holds a thousand megabytes of zeros."""
    path = folder / "face.npz"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("control_points.npy", "w", force_zip64=True) as member,
    ):
        for _ in range(1000):
            member.write(bytes(1_000_000))
    return ["info", str(path)]


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
        JobRow("an empty name", call(lambda f: ""), 1, "is empty", blender=""),
        JobRow("a file instead of a folder", call(_file), 1, "is a file"),
        JobRow("an empty folder", call(_empty), 1, "holds no photos"),
        JobRow("a folder without pictures", call(_notes), 1, "holds no photos"),
        JobRow(
            "a folder that may not be read",
            call(_locked),
            1,
            "check its permissions",
            as_ordinary_user,
        ),
        JobRow("no picture can be read", call(_unreadable), 1, "None of the 2 photos"),
        JobRow("folder linked to itself", call(_loop), 1, "cannot open"),
        JobRow(
            "a folder name that is too long",
            call(lambda f: str(f / ("x" * 300))),
            1,
            "cannot open",
        ),
        JobRow(
            "a path that is too long",
            call(lambda f: str(f.joinpath(*["x" * 200] * 25))),
            1,
            "cannot open",
        ),
        JobRow("a path of 3,000 characters", call(_deep), 0, "Only 3 photos"),
        JobRow(
            "a photo to leave out that is not there",
            call(good_folder, "--ignore=9.png"),
            1,
            "There is no photo '9.png'",
        ),
        JobRow(
            "all photos set aside",
            call(good_folder, "--ignore=0.png", "--ignore=1.png", "--ignore=2.png"),
            1,
            "All 3 photos are set aside",
        ),
        JobRow(
            "the detector's files are missing",
            lambda f: _without_detector(call(lambda f: str(EXAMPLES))(f)),
            1,
            "bsface models fetch",
            no_models,
            blender="",  # the extension's zip brings them
        ),
        JobRow(
            "no face in any photo",
            lambda f: _without_detector(call(_walls)(f)),
            1,
            "(2 no face found)",
            models=True,
        ),
        JobRow(
            "all photos black",
            lambda f: _without_detector(call(lambda f: _walls(f, 0))(f)),
            1,
            "(2 no face found)",
            models=True,
        ),
        JobRow("profiles only", call(_profiles), 0, "from the front"),
        JobRow("the same photo 40 times", call(_forty_times), 0, "one photo"),
        JobRow("one photo", call(lambda f: good_folder(f, 1)), 0, "one photo"),
        JobRow("two photos", call(lambda f: good_folder(f, 2)), 0, "Only 2 photos"),
    ]
    output = [
        JobRow("the output is a folder", call(_output_is_folder), 2, "is a folder"),
        JobRow("the output's folder is a file", call(_output_below_file), 2, "a file"),
        JobRow("a link in a circle", call(_output_is_loop), 2, "a link in a circle"),
        JobRow(
            "a place where nothing can be written",
            call(good_folder, out="/proc/none/face.npz"),
            1,
            "cannot be written",
        ),
        JobRow(
            "a folder that is read-only",
            call(_read_only_output),
            2,
            "no permission",
            as_ordinary_user,
        ),
        JobRow("the disk fills up", call(good_folder), 1, "free space", small_disk),
        JobRow("unknown ending", call(good_folder, out="face.doc"), 2, "ending"),
        JobRow("no ending", call(good_folder, out="face"), 2, "ending"),
    ]
    output = [replace(row, blender="export") for row in output]
    photos.append(JobRow("not enough memory", call(_vast), 1, "memory", little_memory))
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
            library="=" in word,
            blender="reconstruct" if "=" in word else "",
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
    templates = [replace(row, blender="") for row in templates]
    commands = [
        JobRow(title, make, 2, words, library=False, blender="")
        for title, make, words in (
            (
                "batch: links in a circle",
                lambda f: ["batch", _loop(f), f"{_loop(f / 'sub')}/out"],
                "a link in a circle",
            ),
            (
                "batch: an empty name",
                lambda f: ["batch", "", str(f / "out")],
                "is empty",
            ),
        )
    ]
    commands += [
        JobRow(title, make, 1, words, library=False, blender="")
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
            ("info: a zip bomb", _bomb_file, "holds more than"),
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
