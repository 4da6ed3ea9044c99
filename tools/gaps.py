"""Say how long a run goes on between two moments at which it can be stopped.

    python tools/gaps.py --photos 40

Prints a table of docs/robustness.md: for each stage the longest time between two calls
of ``progress``, which may stop the work.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

from bsface import Settings, reconstruct
from bsface.formats import export
from bsface.report.report import write_report
from bsface.texture.bake import bake_texture

ROOT = Path(__file__).resolve().parents[1]
PHOTOS = ROOT / "examples" / "photos"


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
    p.add_argument("--photos", type=int, default=40, help="how many (default 40)")
    p.add_argument("--method", default="joint", help="default joint")
    options = p.parse_args()
    print(gaps(options.photos, options.method), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
