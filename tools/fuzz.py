"""Fuzz every loader with mutated files, and say how many were taken and refused.

    python tools/fuzz.py --examples 20000
    python tools/fuzz.py --only "face file" --seed 7
    python tools/fuzz.py --minutes 10

The loaders and what must hold are those of tests/fuzz/targets.py. A finding is printed
with its traceback and the file that shows it, made as small as can be; the exit code
is then 1. Prints a table of docs/robustness.md.
"""

from __future__ import annotations

import argparse
import os
import random
import subprocess
import sys
import tempfile
import time
import traceback
from pathlib import Path

import hypothesis

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "tests" / "fuzz")]
# FFmpeg asks once, at the first video of the process, which is one written here.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

from targets import Target, targets  # noqa: E402


class OutOfTime(BaseException):
    """Ends the search; no `Exception`, for which hypothesis would look for a cause."""


def fuzz(
    target: Target, examples: int, seed: int, minutes: float
) -> tuple[int, int, bool]:
    """Inputs, how many of them were accepted, and whether there was a finding."""
    counts = [0, 0]
    end = time.perf_counter() + 60 * minutes

    @hypothesis.seed(seed)
    @hypothesis.settings(
        max_examples=examples,
        deadline=None,
        database=None,
        derandomize=False,
        suppress_health_check=list(hypothesis.HealthCheck),
    )
    @hypothesis.given(data=target.inputs)
    def check(data: bytes) -> None:
        if time.perf_counter() > end:
            raise OutOfTime
        counts[0] += 1
        counts[1] += target.run(data)

    try:
        check()
    except OutOfTime:
        pass
    except Exception:
        traceback.print_exc()
        return counts[0], counts[1], True
    return counts[0], counts[1], False


def main() -> int:
    """Run the command line; returns the exit code."""
    p = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    p.add_argument("--examples", type=int, default=20000, help="files a loader")
    p.add_argument("--minutes", type=float, default=60, help="at most, a loader")
    p.add_argument("--seed", type=int, default=None, help="default: another each time")
    p.add_argument("--only", metavar="LOADER", help="one of them, by its name")
    options = p.parse_args()
    if options.only is None:
        return fuzz_all(options)
    known = {target.name: target for target in targets()}
    if options.only not in known:
        p.error(f"no loader {options.only!r}; there are: {', '.join(known)}.")
    target = known[options.only]
    start = time.perf_counter()
    tried, taken, found = fuzz(
        target, options.examples, options.seed or 0, options.minutes
    )
    seconds = time.perf_counter() - start
    print(
        f"| {target.name} | {tried} | {taken} | {tried - taken} | {int(found)} "
        f"| {seconds:.0f} |",
        flush=True,
    )
    return int(found)


def fuzz_all(options: argparse.Namespace) -> int:
    """Every loader in a process of its own: a library may end it."""
    seed = random.randrange(2**31) if options.seed is None else options.seed
    print(f"seed {seed}\n\n| loader | files | taken | refused | findings | s |")
    print("| --- | --- | --- | --- | --- | --- |", flush=True)
    findings = 0
    for target in targets():
        words = [
            f"--{name}={getattr(options, name)}" for name in ("examples", "minutes")
        ]
        words.append(f"--seed={seed}")
        code = subprocess.run(
            [sys.executable, __file__, *words, f"--only={target.name}"]
        ).returncode
        findings += code != 0
        if code < 0:
            print(
                f"{target.name}: the process died of signal {-code}; the file is the "
                f"newest of {tempfile.gettempdir()}/bsface-fuzz-*",
                flush=True,
            )
    return int(findings > 0)


if __name__ == "__main__":
    sys.exit(main())
