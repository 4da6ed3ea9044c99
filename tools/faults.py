"""Kill and starve bsface, and say what came of it.

    python tools/faults.py                    all of it, some twenty minutes
    python tools/faults.py kill --times 200   signals at random moments of a run
    python tools/faults.py batch --times 20   the same for a batch
    python tools/faults.py disk               files can grow to 0 ... 1000 kB only
    python tools/faults.py memory             40 photos in 300 to 900 MB

Prints the tables of docs/robustness.md; the exit code is 1 if a fault was found. A
fault is a file that is neither the old nor the new one, a file left over after SIGINT
or SIGTERM, or a traceback. The short form of it is tests/core/test_faults.py.
"""

from __future__ import annotations

import argparse
import contextlib
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
#: What goes with them, so that it may be there before its file is.
COMPANIONS = ("face.mtl", "face.png", "face_normal.png", "face_displacement.png")
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


def computed(process: subprocess.Popen) -> float:
    """Seconds that a process and those it has waited for have computed (Linux).

    On a machine with other work this says better than a clock where a run is.
    """
    try:
        words = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return float("inf")
    ticks = sum(map(int, words[11:15]))
    return float("inf") if words[0] == "Z" else ticks / os.sysconf("SC_CLK_TCK")


def stop(
    process: subprocess.Popen,
    name: str,
    after: float,
    *,
    whole_group: bool = False,
    clock: Callable[[subprocess.Popen], float] | None = None,
) -> tuple[float, int, str]:
    """Signal after some seconds: seconds until the end, exit code, what was said."""
    if clock is None:
        try:
            _, said = process.communicate(timeout=after)
            return 0.0, process.returncode, said
        except subprocess.TimeoutExpired:
            pass
    else:
        while clock(process) < after:
            time.sleep(0.002)
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
    known = (*wanted, *COMPANIONS)
    others = everything - {folder / path for path in known}
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
    """Runs over three photos with outputs that are there, each stopped by a signal.

    Every second signal falls into the last tenth, in which the files are written.
    """
    rng = random.Random(seed)
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        photos, out = photos_in(place / "photos", 3), place / "out"
        words = [str(photos), *QUICK]
        for path in OUTPUTS:
            words += ["-o", str(out / path)]
        process, lasts = start(words), 0.0
        while (now := computed(process)) < float("inf"):
            lasts = now
            time.sleep(0.002)
        if finish(process):
            raise SystemExit("faults.py: the run fails without any signal too.")
        wanted = {path: (out / path).read_bytes() for path in OUTPUTS}
        endings = []
        for k in range(times):
            shutil.rmtree(out)
            out.mkdir()
            for path in OUTPUTS:
                (out / path).write_bytes(OLD)
            stopping = SIGNALS[k % len(SIGNALS)]
            after = rng.uniform(0.9 * (k % 2), 1.0) * lasts
            ended = stop(start(words), stopping, after, clock=computed)
            endings.append(judge(out, wanted, stopping, ended))
            told(endings[-1])
    return endings


@dataclass(frozen=True)
class Batch:
    """A batch that nothing disturbed.

    Attributes
    ----------
    words : list of str
        Of its command.
    out : Path
    wanted : dict of str to bytes
        What it writes, see `contents`.
    seconds : float
    """

    words: list[str]
    out: Path
    wanted: dict[str, bytes]
    seconds: float


def whole_batch(place: Path) -> Batch:
    """Run a batch of three people to its end."""
    for person in ("ann", "bob", "eve"):
        photos_in(place / "people" / person, 2)
    out = place / "out"
    words = ["batch", str(place / "people"), str(out), "--write=face.npz", *QUICK]
    began = time.perf_counter()
    if finish(start(words)):
        raise SystemExit("One batch alone, which nothing disturbs, fails too.")
    return Batch(words, out, contents(out), time.perf_counter() - began)


def kill_batches(times: int, seed: int, told: Callable[[Ending], None]) -> list[Ending]:
    """Batches of three people, stopped and then finished by the same command."""
    rng = random.Random(seed)
    with tempfile.TemporaryDirectory() as name:
        batch = whole_batch(Path(name))
        words, out, wanted = batch.words, batch.out, batch.wanted
        endings = []
        for k in range(times):
            shutil.rmtree(out)
            stopping = SIGNALS[k % len(SIGNALS)]
            after = rng.uniform(0, 1.05 * batch.seconds)
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


# --- disk, memory ----------------------------------------------------------------


def starve(words: Sequence[str], kind: str, limits: Sequence[int]) -> tuple[str, int]:
    """Runs under limits of the system: a table, and how many went wrong.

    Parameters
    ----------
    words : sequence of str
        Photos and options.
    kind : str
        Name of the limit in the module resource.
    limits : sequence of int
        Bytes.
    """
    import resource

    number = getattr(resource, kind)
    lines = ["| limit, MB | exit code | the last line |", "| --- | --- | --- |"]
    faults = 0
    with tempfile.TemporaryDirectory() as name:
        out = Path(name) / "face.npz"
        for limit in limits:
            out.write_bytes(OLD)
            run = subprocess.run(
                [sys.executable, "-m", "bsface", *words, "-o", str(out)],
                capture_output=True,
                text=True,
                timeout=1200,
                preexec_fn=lambda limit=limit: resource.setrlimit(
                    number, (limit, limit)
                ),
            )
            said = run.stderr.strip().splitlines()[-1].replace(name, "/home/ann")
            kept = out.read_bytes() == OLD
            fault = "Traceback" in run.stderr or kept != bool(run.returncode)
            faults += fault or os.listdir(name) != ["face.npz"]
            lines.append(f"| {limit / 1e6:g} | {run.returncode} | {said} |")
    return "\n".join(lines), faults


def main() -> int:
    """Run the command line; returns the exit code."""
    p = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    kinds = ("kill", "batch", "disk", "memory")
    p.add_argument("what", nargs="?", choices=kinds)
    p.add_argument("--times", type=int, default=200, help="signals (default 200)")
    p.add_argument("--seed", type=int, default=0, help="of the moments (default 0)")
    options = p.parse_args()
    found: list[Ending] = []
    few = options.times if options.what else max(1, options.times // 10)

    def told(ending: Ending) -> None:
        found.append(ending)
        for fault in ending.faults:
            print(f"{ending.signal}: {fault}", flush=True)

    def wanted(kind: str) -> bool:
        return options.what in (None, kind)

    faults = 0
    runs = (("kill", kill_runs, options.times), ("batch", kill_batches, few))
    for kind, disturb, times in runs:
        before = len(found)
        if wanted(kind):
            # Ctrl-C ends a long run with the table of what was done.
            with contextlib.suppress(KeyboardInterrupt):
                disturb(times, options.seed, told)
            print(summary(found[before:]), flush=True)
    with tempfile.TemporaryDirectory() as name:
        if wanted("disk"):
            words = [str(photos_in(Path(name) / "photos", 3)), *QUICK]
            sizes = [0, 1, 10_000, 100_000, 1_000_000]
            faults += _told(starve(words, "RLIMIT_FSIZE", sizes))
        if wanted("memory"):
            sizes = range(300 * 10**6, 901 * 10**6, 100 * 10**6)
            faults += _told(starve([str(PHOTOS)], "RLIMIT_DATA", sizes))
    return int(any(ending.faults for ending in found) or faults > 0)


def _told(result: tuple[str, int]) -> int:
    """Print a table; its faults."""
    print(result[0], flush=True)
    return result[1]


if __name__ == "__main__":
    sys.exit(main())
