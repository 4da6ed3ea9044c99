"""Let two of bsface write to one place at the same time, and say what came of it.

    python tools/two_at_a_time.py             both, some ten minutes
    python tools/two_at_a_time.py writers --times 20   runs with the same outputs
    python tools/two_at_a_time.py batches --times 20   batches with the same folder

Prints tables of docs/robustness.md; the exit code is 1 if a fault was found. A fault is
a file that is not as one of the two alone would have written it, or a batch whose end
is not that of one batch alone.
"""

from __future__ import annotations

import argparse
import random
import shutil
import sys
import tempfile
import time
from pathlib import Path

from faults import OUTPUTS, QUICK, contents, finish, photos_in, start, whole_batch


def two_writers(times: int) -> tuple[str, int]:
    """Two runs with other settings and the same outputs, at the same time."""
    faults, mixed = 0, 0
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        photos, out = photos_in(place / "photos", 2), place / "out"
        words = [[str(photos), *QUICK, f"--set=smooth_mm={mm}"] for mm in (1, 2)]
        for path in OUTPUTS:
            for run in words:
                run += ["-o", str(out / path)]
        wanted = []
        for run in words:
            if finish(start(run)):
                raise SystemExit("two_at_a_time.py: one writer alone fails too.")
            wanted.append(contents(out))
        for _ in range(times):
            shutil.rmtree(out)
            both = [start(run) for run in words]
            faults += any([finish(process) for process in both])
            left = contents(out)
            whose = {
                path: [k for k in (0, 1) if left.get(path) == wanted[k][path]]
                for path in wanted[0]
            }
            faults += set(left) != set(wanted[0]) or not all(whose.values())
            mixed += {0, 1} <= {k for ks in whose.values() if len(ks) == 1 for k in ks}
    return (
        "| two runs with the same outputs | files of both | faults |\n"
        f"| --- | --- | --- |\n| {times} | {mixed} | {faults} |"
    ), faults


def two_batches(times: int, seed: int) -> tuple[str, int]:
    """A second batch with the same folder while the first one runs."""
    rng = random.Random(seed)
    faults, refused = 0, 0
    with tempfile.TemporaryDirectory() as name:
        batch = whole_batch(Path(name))
        for _ in range(times):
            shutil.rmtree(batch.out)
            first = start(batch.words)
            time.sleep(rng.uniform(0, 0.8 * batch.seconds))
            code = finish(start(batch.words))
            faults += finish(first) != 0 or code not in (0, 1)
            refused += code == 1
            faults += contents(batch.out) != batch.wanted
    return (
        "| two batches with the same folder | one of them refused | faults |\n"
        f"| --- | --- | --- |\n| {times} | {refused} | {faults} |"
    ), faults


def main() -> int:
    """Run the command line; returns the exit code."""
    p = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    p.add_argument("what", nargs="?", choices=("writers", "batches"))
    p.add_argument("--times", type=int, default=20, help="default 20")
    p.add_argument("--seed", type=int, default=0, help="of the moments (default 0)")
    options = p.parse_args()
    found = 0
    if options.what in (None, "writers"):
        table, faults = two_writers(options.times)
        print(table, flush=True)
        found += faults
    if options.what in (None, "batches"):
        table, faults = two_batches(options.times, options.seed)
        print(table, flush=True)
        found += faults
    return int(found > 0)


if __name__ == "__main__":
    sys.exit(main())
