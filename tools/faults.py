"""Kill bsface at random moments, stop it at every stage, and say what came of it.

    python tools/faults.py                    all of it, some twenty minutes
    python tools/faults.py kill --times 200   signals at random moments of a run
    python tools/faults.py batch --times 20   the same for a batch
    python tools/faults.py memory             40 photos in 300 to 900 MB
    python tools/faults.py gaps --photos 40   seconds between two calls of progress

Prints the tables of docs/robustness.md; the exit code is 1 if a fault was found. A
fault is a file that is neither the old nor the new one, a file left over after SIGINT
or SIGTERM, or a traceback. The short form of it is tests/core/test_faults.py.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PHOTOS = ROOT / "examples" / "photos"
OLD = b"what was there before"
OUTPUTS = ("face.npz", "face.step", "face.obj")
QUICK = ("--set=control_points=12,12", "--set=iterations=1", "--set=light_degree=2")
SIGNALS = ("SIGINT", "SIGTERM", "SIGKILL")


@dataclass(frozen=True)
class Ending:
    """What was there after a signal.

    Attributes
    ----------
    signal : str
    seconds : float
        From the signal to the end of the process.
    code : int
        Exit code; negative: the signal's number.
    new : int
        Outputs that are the new ones; the others are the old ones.
    left_over : int
        Other files.
    faults : tuple of str
    """

    signal: str
    seconds: float
    code: int
    new: int
    left_over: int
    faults: tuple[str, ...]


def photos_in(folder: Path, count: int) -> Path:
    """Some of the example photos in a folder of their own."""
    folder.mkdir(parents=True)
    for path in sorted(PHOTOS.glob("*.jpg"))[:: max(1, 40 // count)][:count]:
        shutil.copy(path, folder)
    return folder


def start(words: list[str]) -> subprocess.Popen:
    """The command line in a process group of its own, as a terminal starts it."""
    return subprocess.Popen(
        [sys.executable, "-m", "bsface", *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # a fixed date, so that equal runs write equal files
        env={**os.environ, "OMP_NUM_THREADS": "1", "SOURCE_DATE_EPOCH": "0"},
    )


def finish(process: subprocess.Popen) -> int:
    """Let the process end; its exit code."""
    process.communicate()
    return process.returncode


def stop(
    process: subprocess.Popen, name: str, after: float, whole_group: bool = False
) -> tuple[float, int, str]:
    """Signal after some seconds: seconds until the end, exit code, what was said."""
    try:
        _, said = process.communicate(timeout=after)
        return 0.0, process.returncode, said
    except subprocess.TimeoutExpired:
        pass
    sent = time.perf_counter()
    number = getattr(signal, name)
    if whole_group:  # Ctrl-C in a terminal reaches all processes
        os.killpg(process.pid, number)
    else:
        process.send_signal(number)
    _, said = process.communicate(timeout=120)
    return time.perf_counter() - sent, process.returncode, said


def judge(
    folder: Path, wanted: dict[str, bytes], name: str, ended: tuple[float, int, str]
) -> Ending:
    """Compare the folder with the old and the new files."""
    seconds, code, said = ended
    faults, new = [], 0
    for path, content in wanted.items():
        found = (folder / path).read_bytes() if (folder / path).exists() else None
        if found == content:
            new += 1
        elif found != OLD:
            faults.append(f"{path} is neither the old nor the new one")
    everything = {p for p in folder.rglob("*") if p.is_file()}
    others = everything - {folder / path for path in wanted}
    if others and name != "SIGKILL":
        faults.append(f"left over: {', '.join(p.name for p in others)}")
    faults += process_faults(name, code, said)
    return Ending(name, seconds, code, new, len(others), tuple(faults))


def process_faults(name: str, code: int, said: str) -> list[str]:
    """What is wrong with the way in which a process ended."""
    faults = []
    if "Traceback" in said and str(ROOT / "core") not in said:
        # Ctrl-C in the first tenth of a second meets Python before its program.
        return []
    if "Traceback" in said:
        faults.append(f"a traceback: {said.strip().splitlines()[-1]}")
    if code not in (0, 130, -getattr(signal, name)):
        faults.append(f"exit code {code}")
    return faults


def kill_runs(times: int, seed: int, told: Callable[[Ending], None]) -> list[Ending]:
    """Runs over three photos with outputs that are there, each stopped by a signal."""
    rng = random.Random(seed)
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        photos, out = photos_in(place / "photos", 3), place / "out"
        words = [str(photos), *QUICK]
        for path in OUTPUTS:
            words += ["-o", str(out / path)]
        began = time.perf_counter()
        code = finish(start(words))
        lasts = time.perf_counter() - began
        if code:
            raise SystemExit("faults.py: the run fails without any signal too.")
        wanted = {path: (out / path).read_bytes() for path in OUTPUTS}
        endings = []
        for k in range(times):
            shutil.rmtree(out)
            out.mkdir()
            for path in OUTPUTS:
                (out / path).write_bytes(OLD)
            stopping = SIGNALS[k % len(SIGNALS)]
            after = rng.uniform(0, 1.05 * lasts)
            endings.append(
                judge(out, wanted, stopping, stop(start(words), stopping, after))
            )
            told(endings[-1])
    return endings


def kill_batches(times: int, seed: int, told: Callable[[Ending], None]) -> list[Ending]:
    """Batches of three people, stopped and then finished by the same command."""
    rng = random.Random(seed)
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        for person in ("ann", "bob", "eve"):
            photos_in(place / "people" / person, 2)
        out = place / "out"
        words = ["batch", str(place / "people"), str(out), "--write=face.npz", *QUICK]
        began = time.perf_counter()
        finish(start(words))
        lasts = time.perf_counter() - began
        wanted = contents(out)
        endings = []
        for k in range(times):
            shutil.rmtree(out)
            stopping = SIGNALS[k % len(SIGNALS)]
            after = rng.uniform(0, 1.05 * lasts)
            seconds, code, said = stop(start(words), stopping, after, whole_group=True)
            out.mkdir(exist_ok=True)
            hidden = 0
            faults = process_faults(stopping, code, said)
            for path, content in contents(out).items():
                if Path(path).name.startswith("."):
                    hidden += 1
                elif content != wanted.get(path):
                    faults.append(f"{path} is not as in a whole batch")
            if hidden and stopping != "SIGKILL":
                faults.append(f"{hidden} files are left over")
            if finish(start(words)) or contents(out) != wanted:
                faults.append("the same command does not end with the same files")
            ending = Ending(stopping, seconds, code, 0, hidden, tuple(faults))
            endings.append(ending)
            told(ending)
    return endings


def contents(folder: Path) -> dict[str, bytes]:
    """Relative name and content of all files of a folder but logs, which hold times."""
    found = sorted(p for p in folder.rglob("*") if p.is_file() and p.name != "log.txt")
    return {str(p.relative_to(folder)): p.read_bytes() for p in found}


def summary(endings: list[Ending]) -> str:
    """A Markdown table, one line a signal."""
    lines = [
        "| signal | times | old files | new files | some of both | hidden files left "
        "| s until the end | faults |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for name in SIGNALS:
        mine = [e for e in endings if e.signal == name]
        if not mine:
            continue
        new = [e.new for e in mine]
        cells = [
            name,
            len(mine),
            sum(n == 0 for n in new),
            sum(n == len(OUTPUTS) for n in new),
            sum(0 < n < len(OUTPUTS) for n in new),
            sum(e.left_over for e in mine),
            f"{max(e.seconds for e in mine):.2f}",
            sum(bool(e.faults) for e in mine),
        ]
        lines.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(lines)


# --- memory ----------------------------------------------------------------------


def starve(limits: Sequence[int]) -> tuple[str, int]:
    """Runs over all example photos under limits in MB: a table, and how many failed."""
    import resource

    lines = ["| limit, MB | exit code | the last line |", "| --- | --- | --- |"]
    faults = 0
    with tempfile.TemporaryDirectory() as name:
        out = Path(name) / "face.npz"
        words = [sys.executable, "-m", "bsface", str(PHOTOS), "-o", str(out)]
        for limit in limits:
            out.write_bytes(OLD)
            run = subprocess.run(
                words,
                capture_output=True,
                text=True,
                timeout=600,
                preexec_fn=lambda limit=limit: resource.setrlimit(
                    resource.RLIMIT_DATA, (limit * 10**6, limit * 10**6)
                ),
            )
            said = run.stderr.strip().splitlines()[-1].replace(name, "/home/ann")
            kept = out.read_bytes() == OLD
            fault = "Traceback" in run.stderr or kept != bool(run.returncode)
            faults += fault or os.listdir(name) != ["face.npz"]
            lines.append(f"| {limit} | {run.returncode} | {said} |")
    return "\n".join(lines), faults


# --- progress ------------------------------------------------------------------------


class Gaps:
    """Seconds between two calls of progress, by stage."""

    def __init__(self) -> None:
        self.calls: dict[str, list[tuple[float, float]]] = {}
        self.last = self._now()

    @staticmethod
    def _now() -> tuple[float, float]:
        return time.perf_counter(), time.thread_time()

    def tell(self, stage: str) -> None:
        wall, own = self._now()
        self.calls.setdefault(stage, []).append(
            (wall - self.last[0], own - self.last[1])
        )
        self.last = self._now()

    def table(self) -> str:
        """A Markdown table, one line a stage."""
        lines = [
            "| stage | calls | longest gap, s | of it computing, s |",
            "| --- | --- | --- | --- |",
        ]
        for stage, gaps in self.calls.items():
            wall, own = max(g[0] for g in gaps), max(g[1] for g in gaps)
            lines.append(f"| {stage} | {len(gaps)} | {wall:.2f} | {own:.2f} |")
        return "\n".join(lines)


def gaps(count: int, method: str) -> str:
    """Longest gaps over the example photos: the run, the texture, page, exports."""
    from bsface import Settings, reconstruct
    from bsface.formats import export
    from bsface.report.report import write_report
    from bsface.texture.bake import bake_texture

    paths = sorted(PHOTOS.glob("*.jpg"))[:count]
    seen = Gaps()
    face = reconstruct(
        paths, Settings(method=method), progress=lambda step: seen.tell(step.stage)
    )
    seen.tell("output")
    texture = bake_texture(face, progress=lambda part: seen.tell("texture"))
    seen.tell("texture")
    with tempfile.TemporaryDirectory() as name:
        page = Path(name) / "face.html"
        write_report(
            page, face, texture=texture, progress=lambda part: seen.tell("page")
        )
        for ending in (".npz", ".step", ".igs", ".obj", ".ply"):
            seen.last = seen._now()
            export(page.with_suffix(ending), face)
            seen.tell(f"export {ending} (no calls inside)")
    return seen.table()


def main() -> int:
    """Run the command line; returns the exit code."""
    p = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    p.add_argument("what", nargs="?", choices=("kill", "batch", "memory", "gaps"))
    p.add_argument("--times", type=int, default=200, help="signals (default 200)")
    p.add_argument("--seed", type=int, default=0, help="of the moments (default 0)")
    p.add_argument("--photos", type=int, default=40, help="for gaps (default 40)")
    p.add_argument("--method", default="joint", help="for gaps (default joint)")
    options = p.parse_args()
    found: list[Ending] = []

    def told(ending: Ending) -> None:
        found.append(ending)
        for fault in ending.faults:
            print(f"{ending.signal}: {fault}", flush=True)

    if options.what in (None, "kill"):
        print(summary(kill_runs(options.times, options.seed, told)), flush=True)
    if options.what in (None, "batch"):
        times = options.times if options.what else max(1, options.times // 10)
        print(summary(kill_batches(times, options.seed, told)), flush=True)
    starved = 0
    if options.what in (None, "memory"):
        table, starved = starve(range(300, 901, 100))
        print(table, flush=True)
    if options.what in (None, "gaps"):
        print(gaps(options.photos, options.method), flush=True)
    return int(any(ending.faults for ending in found) or starved > 0)


if __name__ == "__main__":
    sys.exit(main())
