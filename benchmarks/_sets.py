"""Photo sets with ground truth, and the measure that comes with them.

A set is a folder with ``images/`` and ``ground_truth.npz``; ``evaluate.py`` lies in the
data folder above and is imported from there, so that everybody is measured alike.
"""

from __future__ import annotations

import importlib.util
import multiprocessing
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import numpy as np
from _faces import Face
from bsface.problem import PhotoCollection

ROOT = Path(__file__).resolve().parents[1]
Result = TypeVar("Result")
EVAL = ROOT.parent / "shared" / "eval"
GIVEN_TEMPLATE = ROOT.parent / "shared" / "template" / "template_40x40.npz"


@dataclass(frozen=True)
class FaceSet:
    """One set of photos.

    Attributes
    ----------
    name : str
        Its folder below the data folder, such as ``ict-a/S1``.
    photos : Path
    truth : dict
        Arrays of ``ground_truth.npz``.
    """

    name: str
    photos: Path
    truth: dict[str, Any]

    @property
    def eye_distance(self) -> float:
        """Of the ground truth, mm."""
        return float(self.truth["eye_distance_mm"])

    def face(self) -> Face:
        """The ground truth as a face; drawn is the part that counts."""
        points = np.asarray(self.truth["vertices"], float)
        triangles = np.asarray(self.truth["triangles"], int)
        counts = np.asarray(self.truth["mask"], bool)[triangles].all(1)
        marks = points[np.asarray(self.truth["landmark_indices"], int)]
        return Face(points, triangles, marks, triangles[counts])

    def areas(self) -> Any:
        """Area around each vertex that counts, 0 for the others; sum 1, ``(v,)``."""
        points = np.asarray(self.truth["vertices"], float)
        triangles = np.asarray(self.truth["triangles"], int)
        a, b, c = (points[triangles[:, k]] for k in range(3))
        size = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        area = np.bincount(triangles.ravel(), np.repeat(size, 3), len(points))
        area = area * np.asarray(self.truth["mask"], bool)
        return area / area.sum()


@dataclass(frozen=True)
class Score:
    """Errors of one face on one set, as `evaluate.py` measures them.

    Attributes
    ----------
    mean, median, rms, std, p90 : float
        Distance from the ground truth, % of the eye distance.
    normals : float
        Mean angle between the normals, degrees.
    error : (v,) array
        Distance at each vertex of the ground truth, %; NaN where it does not count.
    transform : (scale, R, t)
        From the face to the ground truth.
    """

    mean: float
    median: float
    rms: float
    std: float
    p90: float
    normals: float
    error: Any = field(repr=False)
    transform: tuple[float, Any, Any] = field(repr=False)


def load_measure(data: Path) -> ModuleType:
    """The module ``evaluate.py`` of the data folder."""
    path = data / "evaluate.py"
    if not path.is_file():
        raise SystemExit(f"{path} is missing: --data must name a folder that has it.")
    spec = importlib.util.spec_from_file_location("evaluate", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def find_sets(data: Path, names: list[str] | None = None) -> list[str]:
    """Names of the sets to run.

    All sets of the folder, but the ones under ideal conditions (``*-lambert``): their
    linear 16-bit pictures are not photographs. Asked for by name, they are run too.
    """
    if names:
        missing = [n for n in names if not (data / n / "ground_truth.npz").is_file()]
        if missing:
            raise SystemExit(f"{data} has no set {', '.join(missing)}.")
        return names
    found = sorted(p.parent for p in data.glob("*/*/ground_truth.npz"))
    kept = [p for p in found if not p.parent.name.endswith("-lambert")]
    if not kept:
        raise SystemExit(f"{data} has no sets (folders PERSON/SET/ground_truth.npz).")
    return [p.relative_to(data).as_posix() for p in kept]


def load_set(data: Path, name: str) -> FaceSet:
    """Read a set."""
    with np.load(data / name / "ground_truth.npz", allow_pickle=False) as z:
        truth = {k: z[k] for k in z.files}
    return FaceSet(name, data / name / "images", truth)


def some_photos(collection: PhotoCollection, which: Iterable[int]) -> PhotoCollection:
    """A collection of some of the photos, by their numbers."""
    which = list(which)
    return replace(
        collection,
        photos=tuple(collection.photos[i] for i in which),
        landmarks=tuple(collection.landmarks[i] for i in which),
    )


def each_set(
    work: Callable[[str], Result], names: Sequence[str], jobs: int
) -> Iterator[Result]:
    """Results of ``work(name)`` in the order of the names, in ``jobs`` processes.

    ``work`` must be picklable (a `functools.partial` of a function of a module).
    """
    if jobs == 1:
        yield from map(work, names)
        return
    # Not forked: OpenCV's threads do not survive that.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context) as pool:
        yield from pool.map(work, names)


def score(measure: ModuleType, face: Face, of: FaceSet) -> Score:
    """Measure a face once (the search for closest points is slow)."""
    found = measure.evaluate(
        face.points, of.truth, triangles=face.triangles, landmarks=face.landmarks
    )
    move = found["transform"]
    return Score(
        *(found[f"{k}_pct"] for k in ("mean", "median", "rms", "std", "p90")),
        found["normal_error_deg"],
        100 * found["error_mm"] / of.eye_distance,
        (move["scale"], np.array(move["R"]), np.array(move["t"])),
    )
