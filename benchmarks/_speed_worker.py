"""One measurement of `speed.py`, in a process of its own: ``WHAT KEY=VALUE ...``.

Its own process, so that the peak of the memory is that of this measurement alone.
Prints a list of rows as JSON.
"""

from __future__ import annotations

import cProfile
import json
import pstats
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

#: Stages of a job in their order.
STAGES = ("landmarks", "motion", "refine", "output")


class StageTimes:
    """A progress callback that notes processor and wall time at the end of each stage.

    Attributes
    ----------
    marks : dict of (float, float)
        Stage -> processor and wall time when it was last heard of.
    """

    def __init__(self, clocks: Callable[[], tuple[float, float]] | None = None) -> None:
        self.clocks = clocks or (lambda: (time.process_time(), time.perf_counter()))
        self.start = self.clocks()
        self.marks: dict[str, tuple[float, float]] = {}

    def __call__(self, step) -> None:
        self.marks[step.stage] = self.clocks()

    def rows(self) -> list[dict]:
        """``stage``, ``cpu`` and ``wall`` seconds of each stage that was there."""
        found, before = [], self.start
        for stage in STAGES:
            if stage not in self.marks:
                continue
            now = self.marks[stage]
            cpu, wall = (b - a for a, b in zip(before, now, strict=True))
            found.append({"stage": stage, "cpu": cpu, "wall": wall})
            before = now
        return found


def peak_megabytes() -> float:
    """Largest memory that this process has had; NaN where that is not known."""
    try:
        import resource
    except ImportError:
        return float("nan")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)


def job(folder: str, net: int = 0) -> list[dict]:
    """The whole way for a folder."""
    from bsface import Settings, reconstruct

    settings = Settings(control_points=(net, net)) if net else Settings()
    times = StageTimes()
    reconstruct(folder, settings, progress=times)
    return times.rows() + [{"stage": "peak", "megabytes": peak_megabytes()}]


def nets(folder: str, sizes: str) -> list[dict]:
    """Everything after the landmarks, for several nets."""
    from bsface import Settings
    from bsface.prepare import collect_photos, make_problem
    from bsface.reconstruct import solve
    from bsface.surface.template import load_template

    collection = collect_photos(folder)
    found = []
    for size in map(int, sizes.split(",")):
        settings = Settings(control_points=(size, size))
        template = load_template().resampled((size, size))
        start = time.process_time(), time.perf_counter()
        solve(make_problem(collection, template, settings))
        cpu, wall = time.process_time() - start[0], time.perf_counter() - start[1]
        found.append({"stage": "solve", "net": size, "cpu": cpu, "wall": wall})
    return found


def profile(folder: str) -> list[dict]:
    """The whole way for a folder, function by function."""
    from bsface import reconstruct

    watch = cProfile.Profile(time.process_time)
    watch.enable()
    reconstruct(folder)
    watch.disable()
    core = Path(sys.modules["bsface"].__file__ or "").resolve().parent
    rows = own_times(pstats.Stats(watch), str(core))
    return sorted(rows, key=lambda row: -row["cpu"])


def own_times(stats: pstats.Stats, folder: str) -> list[dict]:
    """Seconds of each function of a folder, with all that it calls outside of it.

    A product of matrices or a list comprehension is a cost of the function in which it
    stands; what another function of the folder does is not.
    """
    table = stats.stats  # type: ignore[attr-defined]
    below: dict[tuple, dict[tuple, float]] = {f: {} for f in table}
    for f, (*_, callers) in table.items():
        for caller, (*_, seconds) in callers.items():
            below[caller][f] = seconds

    def named(f: tuple) -> bool:
        return f[0].startswith(folder) and not f[2].startswith("<")

    def inside(f: tuple, path: tuple = ()) -> float:
        """Seconds that the folder's functions take below ``f``."""
        total = 0.0
        for g, seconds in below[f].items():
            if named(g):
                total += seconds
            elif g not in path and table[g][3] > 0:
                total += inside(g, (*path, g)) * seconds / table[g][3]
        return total

    return [
        {
            "stage": f"{Path(f[0]).relative_to(folder).as_posix()}: {f[2]}",
            "calls": table[f][1],
            "cpu": max(table[f][3] - inside(f, (f,)), 0.0),
        }
        for f in table
        if named(f)
    ]


def dense(net: int, points: int) -> list[dict]:
    """Eq. 6 as Algorithm 1 prints it, dense and inverted, against the sparse solve."""
    from bsface.solve.paper.shading import (
        NormalField,
        NormalRows,
        ShadingParameters,
        left_matrix,
        normals_of,
        solve_eq6,
    )
    from bsface.surface.template import load_template

    shape = (net, net)
    b = load_template().resampled(shape).surface.vector
    side = round(points**0.5)
    x = (np.arange(side) + 0.5) / side
    uv = np.stack(np.meshgrid(x, x, indexing="ij"), -1).reshape(-1, 2)
    rows = NormalRows.at(shape, uv)
    h = normals_of(b + np.random.default_rng(0).normal(0, 0.3, b.shape), rows)
    field = NormalField(h, np.ones(len(h)))
    parameters = ShadingParameters()

    runs = 5
    start = time.process_time()
    for _ in range(runs):
        ours = solve_eq6(b, field, b, rows, parameters).x
    seconds = (time.process_time() - start) / runs

    start = time.process_time()
    three = lambda T: np.kron(T.toarray(), np.eye(3))  # noqa: E731
    p, target, scale = len(uv), b.ravel(), parameters.frontal_scale_mm**2
    L, T1 = left_matrix(b, rows).toarray(), three(rows.T1)
    flat = three(rows.T) * np.tile([1.0, 1.0, 0.0], p)[:, None]
    unit = float(((rows.T1 @ b) ** 2).sum(1).mean())
    xy, lam = parameters.frontal_weight / scale / p, parameters.lam / unit / p
    hold = parameters.ridge / (scale * len(b))
    A = L.T @ L / p + xy * flat.T @ flat + lam * T1.T @ T1 + hold * np.eye(3 * len(b))
    y = L.T @ h.ravel() / p + xy * flat.T @ (flat @ target)
    y += lam * T1.T @ (T1 @ target) + hold * target
    literal = np.linalg.inv(A) @ y
    literal_seconds = time.process_time() - start
    return [
        {"stage": "sparse solve", "net": net, "points": p, "cpu": seconds},
        {"stage": "dense formula", "net": net, "points": p, "cpu": literal_seconds},
        {"stage": "difference", "mm": float(np.abs(literal - ours).max())},
    ]


def main(what: str, *words: str) -> None:
    """Run one measurement and print its rows."""
    import cv2

    cv2.setNumThreads(1)
    values = {}
    for word in words:
        name, _, text = word.partition("=")
        values[name] = int(text) if text.isdigit() and name != "sizes" else text
    measure = {"job": job, "nets": nets, "profile": profile, "dense": dense}[what]
    rows = measure(**values)
    sys.stdout.write(json.dumps(rows) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
