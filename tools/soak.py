"""Run hundreds of unlike jobs in one process, and say what grows.

    python tools/soak.py                 500 jobs, an hour or less
    python tools/soak.py --jobs 50       the short form

The jobs change photo format, method, outputs and texture; every third one is meant to
fail. Memory, open handles, threads and files left behind are counted at every tenth of
the way. The exit code is 1 if one of them grows or a job ends in another way than it
should. Prints a table of docs/robustness.md.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import io
import os
import random
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PHOTOS = ROOT / "examples" / "photos"
sys.path.insert(0, str(ROOT / "tests"))
# FFmpeg asks once, at the first video of the process, which is one written here.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

import cv2  # noqa: E402
import numpy as np  # noqa: E402
from bsface import (  # noqa: E402
    Cancelled,
    ReconstructionError,
    Settings,
    compare,
    load,
    reconstruct,
    track,
    write_landmarks,
)
from bsface.__main__ import main as command_line  # noqa: E402
from bsface.images.read import read_photo  # noqa: E402
from bsface.landmarks.all_faces import faces_in  # noqa: E402
from pictures_for_tests import encoded, heic  # noqa: E402
from videos_for_tests import write_clip  # noqa: E402

QUICK = {
    "control_points": (12, 12),
    "iterations": 1,
    "light_degree": 2,
    "outer_passes": 1,
}
WORDS = [
    "--set=control_points=12,12",
    "--set=iterations=1",
    "--set=light_degree=2",
    "--set=outer_passes=1",
    "--quiet",
]
ENDINGS = (".npz", ".step", ".igs", ".obj", ".nurbs.obj", ".ply", ".stl", ".3mf")
ENDINGS += (".3dm", ".glb")
#: What may be larger in the last half of a run than in the first, as a share.
GROWTH = 0.1


@dataclass(frozen=True)
class Count:
    """What the process holds after so many jobs."""

    jobs: int
    seconds: float
    megabytes: float
    handles: int
    threads: int
    left_behind: int

    def line(self) -> str:
        """A line of the table."""
        return (
            f"| {self.jobs} | {self.seconds:.0f} | {self.megabytes:.0f} "
            f"| {self.handles} | {self.threads} | {self.left_behind} |"
        )


def count(jobs: int, start: float, temporary: Path) -> Count:
    """Count what this process holds now (Linux)."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return Count(
        jobs,
        time.perf_counter() - start,
        pages * os.sysconf("SC_PAGE_SIZE") / 1e6,
        len(os.listdir("/proc/self/fd")) - 1,  # its own
        len(os.listdir("/proc/self/task")),
        len(list(temporary.rglob("*"))),
    )


def lay_out(place: Path) -> dict[str, Path]:
    """Folders of four of the example photos, in the formats that are read."""
    chosen = [read_photo(PHOTOS / f"{k:03d}.jpg") for k in (0, 9, 20, 31)]
    pixels = [photo.bytes8() for photo in chosen]
    writers: dict[str, Callable[[Path, int], object]] = {
        "jpg": lambda f, k: shutil.copy(chosen[k].path, f / f"{k}.jpg"),
        "png": lambda f, k: (f / f"{k}.png").write_bytes(encoded(".png", pixels[k])),
        "tif": lambda f, k: (f / f"{k}.tif").write_bytes(
            encoded(".tif", pixels[k].astype(np.uint16) * 257)
        ),
        "heic": lambda f, k: (f / f"{k}.heic").write_bytes(heic(pixels[k])),
        "marked": lambda f, k: marked(f, chosen[k], k),
        "damaged": lambda f, k: damaged(f, chosen[k].path, k),
    }
    folders = {}
    for name, write in writers.items():
        folders[name] = place / name
        folders[name].mkdir()
        for k in range(4):
            write(folders[name], k)
    folders["video"] = write_clip(place / "clip.mp4", pixels)
    folders["empty"] = place / "empty"
    folders["walls"] = place / "walls"
    for name in ("empty", "walls"):
        folders[name].mkdir()
    for k in range(2):
        wall = np.full((60 + k, 60, 3), 140, np.uint8)
        cv2.imwrite(str(folders["walls"] / f"{k}.png"), wall)
    return folders


def marked(folder: Path, photo, k: int) -> None:
    """A photo with a landmark file and a mask file."""
    shutil.copy(photo.path, folder / f"{k}.jpg")
    (found,) = faces_in(photo.bytes8(), photo.name, Settings())
    write_landmarks(folder / f"{k}.json", found, photo.size)
    cv2.imwrite(
        str(folder / f"{k}.mask.png"), np.full(photo.size[::-1], 255 - 9 * k, np.uint8)
    )


def damaged(folder: Path, path: Path, k: int) -> None:
    """A good photo, half a photo, and half a video."""
    data = path.read_bytes()
    (folder / f"{k}.jpg").write_bytes(data)
    (folder / f"half {k}.jpg").write_bytes(data[: len(data) // 2])
    (folder / f"half {k}.mp4").write_bytes(b"\0\0\0\x18ftypmp42" + data[:500])


class Jobs:
    """The jobs, each of which says how it ended; anything unexpected is raised."""

    def __init__(self, place: Path, rng: random.Random) -> None:
        self.folders, self.out, self.rng = lay_out(place), place / "out", rng
        self.good = ("jpg", "png", "tif", "heic", "marked", "damaged", "video")
        self.out.mkdir()
        self.face = self.out / "first.npz"
        self.command([str(self.folders["jpg"]), "-o", str(self.face), *WORDS], 0)

    def run(self, number: int) -> str:
        """One job; every third one is meant to fail."""
        if number % 3 == 2:
            failing = (self.no_photos, self.wrong_call, self.cancelled)
            job = self.rng.choice((*failing, self.no_place, self.bad_face))
        else:
            job = self.rng.choice((self.by_command, self.by_command, self.by_library))
        return job()

    @staticmethod
    def command(words: list[str], *codes: int) -> str:
        """The command line in this process; its exit code must be one of these."""
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                code = command_line(words)
            except SystemExit as end:
                code = end.code
        if code == 130:  # the command line takes Ctrl-C and SIGTERM for its own
            raise KeyboardInterrupt
        if code not in codes:
            raise RuntimeError(f"exit code {code} of {words}: {err.getvalue()}")
        return f"exit code {code}"

    def by_command(self) -> str:
        source = self.folders[self.rng.choice(self.good[:-1])]
        method = self.rng.choice(("joint", "imls", "paper", "motion"))
        endings = self.rng.sample(ENDINGS, 2)
        words = [str(source), *WORDS, f"--set=method={method}", "--json"]
        for ending in endings:
            words += ["-o", str(self.out / f"face{ending}")]
        if self.rng.random() < 0.2:
            words += ["--report", str(self.out / "page.html")]
        if self.rng.random() < 0.2:
            words += ["--log", str(self.out / "face.log")]
        # Four photos are few for the text's own algorithm, which may then refuse.
        return self.command(words, 0, *[1] * (method in ("paper", "imls")))

    def by_library(self) -> str:
        source = self.folders[self.rng.choice(self.good)]
        photos = source
        if source.is_dir() and self.rng.random() < 0.5:
            files = [p for p in sorted(source.iterdir()) if len(p.stem) == 1]
            found = [read_photo(p) for p in files if p.suffix != ".json"]
            photos = [photo.bytes8() for photo in found if photo]
        face = reconstruct(photos, method="motion", **QUICK)
        before = load(self.face)
        compare(face.surface, before.surface)
        track(photos, before)
        return "a face"

    def no_photos(self) -> str:
        source = self.folders[self.rng.choice(("empty", "walls"))]
        return self.command([str(source), "-o", str(self.out / "a.npz"), *WORDS], 1)

    def wrong_call(self) -> str:
        word = self.rng.choice(("--set=lam=x", "--set=colour=red", "--ask", "-oa.doc"))
        source = str(self.folders["jpg"])
        return self.command([source, "-o", str(self.out / "a.npz"), word], 2)

    def no_place(self) -> str:
        words = ["export", str(self.face), "-o", "/proc/none/face.step"]
        return self.command(words, 1)

    def bad_face(self) -> str:
        path = self.out / "bad.npz"
        data = bytearray(self.face.read_bytes())
        for _ in range(20):
            data[self.rng.randrange(len(data))] ^= 1 << self.rng.randrange(8)
        path.write_bytes(bytes(data))
        return self.command(["info", str(path)], 0, 1)

    def cancelled(self) -> str:
        left = self.rng.randrange(1, 60)

        def progress(step: object) -> None:
            nonlocal left
            left -= 1
            if left == 0:
                raise Cancelled

        source = self.folders[self.rng.choice(self.good)]
        try:
            reconstruct(source, progress=progress, **QUICK)
        except Cancelled:
            return "cancelled"
        return "a face before it was cancelled"


def soak(total: int, seed: int) -> tuple[list[Count], Counter, list[str]]:
    """Run the jobs: counts at every tenth, how they ended, and what was wrong."""
    counts, endings, faults = [], Counter(), []
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as place, tempfile.TemporaryDirectory() as own:
        # What the jobs leave behind is to be seen.
        tempfile.tempdir = own
        try:
            jobs = Jobs(Path(place), random.Random(seed))
            for number in range(total):
                try:
                    endings[jobs.run(number)] += 1
                except (Exception, ReconstructionError) as error:
                    faults.append(f"job {number}: {type(error).__name__}: {error}")
                    print(faults[-1], flush=True)
                if (number + 1) % max(1, total // 10) == 0:
                    counts.append(count(number + 1, start, Path(own)))
                    print(counts[-1].line(), flush=True)
        finally:
            tempfile.tempdir = None
    return counts, endings, faults + growth(counts)


def growth(counts: list[Count]) -> list[str]:
    """What grew from the first half of the run, without its first tenth, to the last.

    In the first tenth every part of the program is loaded once.
    """
    middle = len(counts) // 2
    first, last = counts[1:middle], counts[middle:]
    if not first:
        return []
    found = []
    for name in ("megabytes", "handles", "threads", "left_behind"):
        before = max(getattr(c, name) for c in first)
        after = max(getattr(c, name) for c in last)
        allowed = before * (1 + GROWTH) if name == "megabytes" else before
        if after > allowed:
            found.append(f"{name} grew from {before:.0f} to {after:.0f}")
    return found


def main() -> int:
    """Run the command line; returns the exit code."""
    p = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    p.add_argument("--jobs", type=int, default=500, help="how many (default 500)")
    p.add_argument("--seed", type=int, default=0, help="of the choices (default 0)")
    options = p.parse_args()
    print("| jobs | s | memory, MB | handles | threads | files left behind |")
    print("| --- | --- | --- | --- | --- | --- |", flush=True)
    _, endings, faults = soak(options.jobs, options.seed)
    print()
    for ending, times in sorted(endings.items()):
        print(f"{times} times {ending}")
    for fault in faults:
        print(fault)
    print(f"{len(faults)} faults")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
