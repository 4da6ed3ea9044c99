#!/usr/bin/env python3
"""Time and memory of the job: stages, number of photos, nets, sizes of photos.

    python benchmarks/speed.py                      everything, on the example photos
    python benchmarks/speed.py --parts photos nets  only these tables
    python benchmarks/speed.py --photos FOLDER      other photos

Times are those of the processor, on one thread, so that they do not depend on what else
the machine does; each measurement runs in a process of its own, whose peak of memory is
noted.  Written into ``--out``: ``speed.csv``.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from _speed_worker import STAGES
from _table import text_table, write_csv
from bsface.images.folder import list_photos

ROOT = Path(__file__).resolve().parents[1]
EXAMPLE = ROOT / "examples" / "photos"
WORKER = Path(__file__).with_name("_speed_worker.py")
PARTS = ("import", "photos", "nets", "pixels", "profile", "formula")

COUNTS = (10, 20, 40, 80, 160, 320)
NETS = (20, 30, 40, 60, 80)
NET_PHOTOS = 20
#: Megapixels, and of how many photos; 0 = as they are. Forty of twelve is the usual
#: case of a phone.
PIXELS = ((0, 10), (1, 10), (4, 10), (12, 10), (24, 10), (12, 40), (12, 320))
PROFILED = 40  #: photos of the profile
LISTED = 15  #: functions of it that are listed
FORMULA = (40, 2500)  #: net, points

Row = dict[str, object]


def main() -> None:
    """Run the command line."""
    options = arguments()
    paths = list_photos(options.photos)
    print(f"{platform.machine()}, {len(paths)} photos of {options.photos}", flush=True)
    rows: list[Row] = []
    with tempfile.TemporaryDirectory(prefix="bsface-speed-") as folder:
        for part in options.parts:
            measured = list(_MEASURE[part](paths, Path(folder)))
            rows += [{"part": part, **row} for row in measured]
            write_csv(options.out / "speed.csv", rows)
            print("\n" + _TABLE[part](measured), flush=True)
    print(f"\nwritten: {options.out}/speed.csv")


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--photos", type=Path, default=EXAMPLE)
    parser.add_argument(
        "--parts", nargs="+", choices=PARTS, default=PARTS, metavar="PART",
        help=f"of {', '.join(PARTS)}",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "speed")
    return parser.parse_args()


# ---------------------------------------------------------------- measurements
def measure_import(paths: Sequence[Path], folder: Path) -> Iterable[Row]:
    """``import bsface`` beside an empty program, seconds of the processor."""
    program = "import time; {}; print(time.process_time())"
    for name, words in (("empty", "pass"), ("numpy", "import numpy"),
                        ("bsface", "import bsface")):  # fmt: skip
        runs = [
            float(child([sys.executable, "-c", program.format(words)]))
            for _ in range(5)
        ]
        yield {"stage": name, "cpu": float(np.median(runs))}


def measure_photos(paths: Sequence[Path], folder: Path) -> Iterable[Row]:
    """The whole job for more and more photos."""
    for count in COUNTS:
        made = photo_folder(folder / f"photos-{count}", paths, count)
        for row in worker("job", folder=made):
            yield {"photos": count, **row}


def measure_nets(paths: Sequence[Path], folder: Path) -> Iterable[Row]:
    """All after the landmarks, for larger and larger nets."""
    made = photo_folder(folder / "nets", paths, NET_PHOTOS)
    for row in worker("nets", folder=made, sizes=",".join(map(str, NETS))):
        yield {"photos": NET_PHOTOS, **row}


def measure_pixels(paths: Sequence[Path], folder: Path) -> Iterable[Row]:
    """The whole job for larger and larger photos."""
    for megapixels, count in PIXELS:
        name = f"pixels-{megapixels}-{count}"
        made = photo_folder(folder / name, paths, count, megapixels)
        for row in worker("job", folder=made):
            yield {"photos": count, "megapixels": megapixels, **row}


def measure_profile(paths: Sequence[Path], folder: Path) -> Iterable[Row]:
    """Where the default job spends its time: the costliest functions, and the rest."""
    made = photo_folder(folder / "profile", paths, PROFILED)
    rows = worker("profile", folder=made)
    rest = sum(number(row["cpu"]) for row in rows[LISTED:])
    yield from rows[:LISTED]
    yield {"stage": "all other functions", "cpu": rest}


def measure_formula(paths: Sequence[Path], folder: Path) -> Iterable[Row]:
    """The local solve against the dense formula."""
    net, points = FORMULA
    yield from worker("dense", net=net, points=points)


def worker(what: str, **values: object) -> list[Row]:
    """Rows of a measurement in a process of its own."""
    words = [f"{name}={value}" for name, value in values.items()]
    return json.loads(child([sys.executable, str(WORKER), what, *words]))


def child(words: Sequence[str]) -> str:
    """What a program prints last, run on one thread."""
    one = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}
    done = subprocess.run(
        words, env={**os.environ, **one}, stdout=subprocess.PIPE, text=True, check=True
    )
    return done.stdout.strip().splitlines()[-1]


def photo_folder(
    folder: Path, paths: Sequence[Path], count: int, megapixels: float = 0
) -> Path:
    """A folder of ``count`` photos, enlarged to a size, none of them twice.

    When there are not enough photos they are used again with a narrow border cut off,
    so that the program does not take them for duplicates.
    """
    folder.mkdir()
    for k in range(count):
        turn, index = divmod(k, len(paths))
        image = cv2.imread(str(paths[index]))
        if image is None:
            raise SystemExit(f"{paths[index]} cannot be read.")
        image = image[2 * turn :, 2 * turn :]
        if megapixels:
            scale = (megapixels * 1e6 / (image.shape[0] * image.shape[1])) ** 0.5
            image = cv2.resize(
                image, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC
            )
        cv2.imwrite(str(folder / f"{k:03d}.jpg"), image)
    return folder


# ---------------------------------------------------------------------- tables
def by_stage(rows: Iterable[Row], keys: Sequence[str]) -> list[Row]:
    """One row a job: processor seconds of each stage, their sum, peak of memory."""
    jobs: dict[tuple, Row] = {}
    for row in rows:
        at = tuple(row.get(key) for key in keys)
        job = jobs.setdefault(at, dict(zip(keys, at, strict=True)))
        if row["stage"] == "peak":
            job["megabytes"] = row["megabytes"]
        else:
            job[str(row["stage"])] = row["cpu"]
            job["all"] = number(job.get("all", 0.0)) + number(row["cpu"])
    for job in jobs.values():
        job["ratio"] = number(job["all"]) / number(job["landmarks"])
        job["each"] = number(job["all"]) / number(job["photos"])
    return list(jobs.values())


def number(value: object) -> float:
    """A cell as a number."""
    return float(value)  # type: ignore[arg-type]


_SECONDS = [(name, name, ".1f") for name in (*STAGES, "all")]
_JOB = [
    *_SECONDS,
    ("ratio", "all / landmarks", ".2f"),
    ("each", "a photo", ".2f"),
    ("megabytes", "peak MB", ".0f"),
]


def job_table(rows: Sequence[Mapping[str, object]], keys: Sequence[str]) -> str:
    """Stages of several jobs."""
    jobs = by_stage([dict(row) for row in rows], keys)
    for job in jobs:
        if job.get("megapixels") == 0:
            job["megapixels"] = "as they are"
    return text_table(jobs, _JOB, [(key, key) for key in keys])


def net_table(rows: Sequence[Row]) -> str:
    """Nets, and the time for each control point."""
    for row in rows:
        row["point"] = 1000 * number(row["cpu"]) / number(row["net"]) ** 2
    columns = [("cpu", "seconds", ".1f"), ("point", "ms a control point", ".1f")]
    return text_table(rows, columns, [("net", "net")])


def profile_table(rows: Sequence[Row]) -> str:
    """Seconds and share of each function."""
    total = sum(number(row["cpu"]) for row in rows)
    for row in rows:
        row["share"] = number(row["cpu"]) / total
    columns = [
        ("calls", "calls", ".0f"),
        ("cpu", "s", ".2f"),
        ("share", "share", ".0%"),
    ]
    return text_table(rows, columns, [("stage", "function")])


def formula_table(rows: Sequence[Row]) -> str:
    """Seconds of both forms, their ratio and difference."""
    found = {str(row["stage"]): row for row in rows}
    ours, dense = (number(found[k]["cpu"]) for k in ("sparse solve", "dense formula"))
    net, points = (found["sparse solve"][k] for k in ("net", "points"))
    return (
        f"Eq. 6 at {net}x{net} with {points} normals: sparse {ours:.3f} s, dense "
        f"{dense:.1f} s, ratio {dense / ours:.0f}, largest difference "
        f"{number(found['difference']['mm']):.1e} mm"
    )


def import_table(rows: Sequence[Row]) -> str:
    """Time to start, less that of an empty program."""
    cpu = {str(row["stage"]): number(row["cpu"]) for row in rows}
    own = {name: cpu[name] - cpu["empty"] for name in ("numpy", "bsface")}
    return (
        f"import bsface: {own['bsface']:.2f} s of the processor, of which numpy "
        f"{own['numpy']:.2f} s"
    )


_MEASURE = {
    "import": measure_import,
    "photos": measure_photos,
    "nets": measure_nets,
    "pixels": measure_pixels,
    "profile": measure_profile,
    "formula": measure_formula,
}
_TABLE = {
    "import": import_table,
    "photos": lambda rows: job_table(rows, ["photos"]),
    "nets": net_table,
    "pixels": lambda rows: job_table(rows, ["megapixels", "photos"]),
    "profile": profile_table,
    "formula": formula_table,
}


if __name__ == "__main__":
    main()
