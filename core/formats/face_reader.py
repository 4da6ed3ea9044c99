"""From the arrays of a face file to a `Reconstruction`.

They come from other people and other versions too: each is judged before it is used.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from .._types import Array
from ..camera.camera import Camera
from ..images.photo import Photo
from ..json_text import from_json
from ..landmarks.landmarks import Landmarks
from ..npz_arrays import floats
from ..photometry.lighting import PhotometricEvidence
from ..problem import Constraint
from ..result import HistoryEntry, PhotoReport, Provenance, Reconstruction, no_photo
from ..settings import Settings
from ..surface.bspline import BSplineSurface
from ..surface.template import Template

Arrays = dict[str, npt.NDArray]

#: Arrays ``camera_*`` with one row for every photo, and the shape of a row.
CAMERA_SHAPES = {"R": (3, 3), "s": (), "t": (2,), "kappa": (), "principal": (2,)}
#: Control points along each side, and how far from the origin they may lie, mm.
MAX_NET, MAX_MM = 256, 1e5
MIN_MM = 1e-3  #: a surface that is smaller than this is none
OTHER_SETTINGS = (
    "The file holds values that this version cannot use for {names}; the defaults are "
    "in their place."
)
OTHER_TEMPLATE = (
    "The face was made of another template than the one it is read with; give that "
    "template too, or its expressions and regions are not right."
)


def face_from_arrays(
    arrays: Arrays, about: dict[str, Any], base: Template
) -> Reconstruction:
    """The face that the arrays of a face file hold.

    Parameters
    ----------
    arrays : dict of str to array
        As in the contract of :mod:`.face_file`; its first five are there.
    about : dict
        What the array ``about`` says; empty without it.
    base : Template
        That the face was made of. Its parts give way to those that the file has.

    Returns
    -------
    Reconstruction
        Its photos have names and sizes, but no pixels.

    Raises
    ------
    ValueError
        When an array is absent or unfit; the text says which, as the middle of a
        sentence.
    """
    surface = _surface(arrays)
    template = _template(arrays, base.resampled(surface.shape))
    cameras = _cameras(arrays)
    names = _names(arrays, "camera_photo", len(cameras)) if cameras else ()
    photos = _photos(arrays, names, cameras)
    landmarks = _landmarks(arrays, names)
    if len(landmarks) not in (0, len(photos)):
        raise ValueError("landmark_count does not fit camera_photo")
    k = len(template.expression_modes)
    expressions = np.zeros((len(photos), k))
    if "expressions" in arrays:
        expressions = floats(arrays, "expressions", len(photos), None)
        if expressions.shape[1] > k:
            raise ValueError("expressions has more columns than the template has modes")
    deviation = "deviation" if "deviation" in arrays else "confidence"
    warnings = _texts(about.get("warnings"))
    digest = arrays.get("template_digest")
    if digest is not None and str(digest) != base.digest():
        warnings += (OTHER_TEMPLATE,)
    settings, unfit = _settings(arrays, surface.shape)
    if unfit:
        warnings += (OTHER_SETTINGS.format(names=", ".join(unfit)),)
    return Reconstruction(
        surface=surface,
        template=template,
        photos=photos,
        landmarks=landmarks,
        cameras=cameras,
        photometric=_photometric(arrays, len(photos)),
        reports=_reports(arrays),
        deviation=_optional(arrays, deviation, *surface.shape),
        settings=settings,
        expressions=expressions,
        constraint=_constraint(arrays, surface.shape),
        history=_history(about),
        warnings=warnings,
        provenance=Provenance(
            program=str(about.get("version", "")),
            libraries=_text_mapping(about.get("libraries")),
            hashes=_text_mapping(about.get("hashes")),
            date=str(about.get("date", "")),
        ),
    )


def _surface(arrays: Arrays) -> BSplineSurface:
    points = floats(arrays, "control_points", None, None, 3)
    if min(points.shape[:2]) < 4 or max(points.shape[:2]) > MAX_NET:
        raise ValueError(
            f"control_points are {points.shape[0]} x {points.shape[1]}; a face has "
            f"from 4 x 4 to {MAX_NET} x {MAX_NET}"
        )
    for name, count in zip(("knots_u", "knots_v"), points.shape[:2], strict=True):
        if not np.array_equal(floats(arrays, name, count + 4), np.arange(count + 4)):
            raise ValueError(f"{name} are not those of a uniform bicubic surface")
    _check_near(points, "control_points")
    spread = points.reshape(-1, 3) - points.mean(axis=(0, 1))
    if np.linalg.svd(spread, compute_uv=False)[1] < MIN_MM:
        raise ValueError("all control_points are at one place or on one line")
    return BSplineSurface(points)


def _check_near(points: Array, name: str) -> None:
    farthest = np.abs(points).max(initial=0)
    if farthest > MAX_MM:
        raise ValueError(
            f"{name} lie up to {farthest:.3g} mm from the origin, more than {MAX_MM:g}"
        )


def _template(arrays: Arrays, base: Template) -> Template:
    """The template with the parts that the file has."""
    parts: dict[str, Any] = {}
    if "outline_uv" in arrays:
        outline = floats(arrays, "outline_uv", None, 2)
        if len(outline) < 3 or outline.min() < 0 or outline.max() > 1:
            raise ValueError("outline_uv must have three corners at least, in [0, 1]")
        parts["outline_uv"] = outline
    if "template_control_points" in arrays:
        shape = (*base.surface.shape, 3)
        points = floats(arrays, "template_control_points", *shape)
        parts["surface"] = BSplineSurface(points)
        parts["landmark_xyz"] = floats(
            arrays, "template_landmark_xyz", *base.landmark_xyz.shape
        )
        parts["eye_centres"] = floats(arrays, "template_eye_centres", 2, 3)
        for name in ("control_points", "landmark_xyz", "eye_centres"):
            _check_near(arrays[f"template_{name}"], f"template_{name}")
    return replace(base, **parts)


def _cameras(arrays: Arrays) -> tuple[Camera, ...]:
    if "camera_R" not in arrays:
        return ()
    n = len(floats(arrays, "camera_R", None, 3, 3))
    columns = {
        k: floats(arrays, f"camera_{k}", n, *s) for k, s in CAMERA_SHAPES.items()
    }
    return tuple(
        Camera(
            R=columns["R"][i],
            s=float(columns["s"][i]),
            t=columns["t"][i],
            kappa=float(columns["kappa"][i]),
            principal=columns["principal"][i],
        )
        for i in range(n)
    )


def _photos(
    arrays: Arrays, names: Sequence[str], cameras: Sequence[Camera]
) -> tuple[Photo, ...]:
    """Names and sizes; a file of version 1 has the size as the picture's centre."""
    n = len(names)
    size = np.array([2 * camera.principal + 1 for camera in cameras]).reshape(n, 2)
    if "camera_size" in arrays:
        size = floats(arrays, "camera_size", n, 2)
    whole = np.clip(np.round(size), 0, 1e9).astype(int)
    return tuple(
        no_photo(name, (int(w), int(h)))
        for name, (w, h) in zip(names, whole, strict=True)
    )


def _landmarks(arrays: Arrays, names: Sequence[str]) -> tuple[Landmarks, ...]:
    if "landmark_count" not in arrays:
        return ()
    count = floats(arrays, "landmark_count", len(names))
    points = floats(arrays, "landmark_points", None, 2)
    weights = floats(arrays, "landmark_weight", len(points))
    if (count < 0).any() or (count % 1).any() or count.sum() != len(points):
        raise ValueError("landmark_count does not fit landmark_points")
    ends = np.cumsum(count.astype(int))[:-1]
    parts = zip(
        names,
        _names(arrays, "landmark_scheme", len(names)),
        np.split(points, ends),
        np.split(weights, ends),
        strict=False,
    )
    return tuple(Landmarks(*part, source="file") for part in parts)


def _photometric(arrays: Arrays, n: int) -> PhotometricEvidence | None:
    def found(name: str, *shape: int | None) -> Array:
        return floats(arrays, f"photometric_{name}", *shape, finite=False)

    if "photometric_uv" not in arrays:
        return None
    p = len(found("uv", None, 2))
    seen = "photometric_weights" in arrays
    return PhotometricEvidence(
        uv=found("uv", p, 2),
        normals=found("normals", p, 3),
        albedo=found("albedo", p, 3),
        lights=found("lights", None, None),
        weights=found("weights", n, p) if seen else np.zeros((n, p)),
        residual=found("residual", n, p) if seen else np.zeros((n, p)),
        singular_values=found("singular_values", None),
    )


def _constraint(arrays: Arrays, shape: tuple[int, int]) -> Constraint | None:
    if "constraint_points" not in arrays:
        return None
    points = floats(arrays, "constraint_points", *shape) != 0
    softness = float(floats(arrays, "constraint_softness_mm"))
    if softness < 0:
        raise ValueError("constraint_softness_mm is negative")
    return Constraint(points, softness)


def _settings(
    arrays: Arrays, shape: tuple[int, int]
) -> tuple[Settings, tuple[str, ...]]:
    """Settings of the run, and the names of those whose values cannot be used.

    Unknown settings, of another version, are passed over.
    """
    values = from_json(arrays, "settings", dict)
    settings, unfit = Settings(), []
    with contextlib.suppress(ValueError):
        settings = Settings.of(settings, {"control_points": shape})
    for name in settings.to_dict():
        if name in values:
            try:
                settings = Settings.of(settings, {name: values[name]})
            except ValueError:
                unfit.append(name)
    return settings, tuple(unfit)


def _reports(arrays: Arrays) -> tuple[PhotoReport, ...]:
    out = []
    for row in from_json(arrays, "report", list):
        if not isinstance(row, Mapping):
            raise ValueError("report is not a list of photos")
        number = {
            name: _number(value)
            for name, value in row.items()
            if name in PhotoReport.__dataclass_fields__
            and name not in ("name", "status", "reason")
        }
        name, status, reason = (
            str(row.get(key, "")) for key in ("name", "status", "reason")
        )
        out.append(PhotoReport(name, status, reason, **number))
    return tuple(out)


def _history(about: Mapping[str, Any]) -> tuple[HistoryEntry, ...]:
    rows = about.get("history")
    out = []
    for row in rows if isinstance(rows, list) else ():
        if isinstance(row, Mapping):
            numbers = (row.get("residual"), row.get("step_mm"))
            stage = str(row.get("stage", ""))
            out.append(HistoryEntry(stage, *map(_number, numbers)))
    return tuple(out)


def _number(value: object) -> float:
    """NaN for what is no number, or too large for one."""
    try:
        return float(value) if isinstance(value, int | float) else math.nan
    except OverflowError:
        return math.nan


def _names(arrays: Arrays, name: str, count: int) -> tuple[str, ...]:
    found = arrays.get(name, np.zeros(0))
    if found.shape != (count,) or found.dtype.kind != "U":
        raise ValueError(f"{name} must hold {count} names")
    return tuple(str(item) for item in found)


def _texts(value: object) -> tuple[str, ...]:
    return tuple(map(str, value)) if isinstance(value, list) else ()


def _text_mapping(value: object) -> dict[str, str]:
    if not isinstance(value, Mapping):
        return {}
    return {str(key): str(item) for key, item in value.items()}


def _optional(arrays: Arrays, name: str, *shape: int | None) -> Array | None:
    return floats(arrays, name, *shape, finite=False) if name in arrays else None
