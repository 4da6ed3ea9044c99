"""The project's own file, ``face.npz``: a reconstruction without pixels.

Contract (version 2), readable by ``numpy.load(path, allow_pickle=False)``:

==================  ===========================================================
``control_points``  float64 (M, N, 3), millimetres; first index u (the picture's
                    x), second v (downwards); x to the picture's right, y up,
                    z to the camera
``knots_u``         float64 (M + 4,): 0 .. M+3, valid interval [3, M]
``knots_v``         float64 (N + 4,): 0 .. N+3, valid interval [3, N]
``settings``        JSON text: all settings of the run
``report``          JSON text: a list with one entry for every photo of the
                    folder (name, status, reason, pose, residual)
``outline_uv``      float64 (k, 2): the face's outline in (u, v) of [0, 1]
``about``           JSON text: file version, program version, versions of the
                    libraries, date, hash of each photo, history, warnings
``template_*``      ``control_points`` (M, N, 3), ``landmark_xyz`` (468, 3),
                    ``eye_centres`` (2, 3) of the template, and the digest of
                    the rest of it
``camera_*``        one row for every used photo: ``camera_photo`` (name),
                    ``camera_size`` (n, 2), ``camera_R`` (n, 3, 3), ``camera_s``
                    (n,), ``camera_t`` (n, 2), ``camera_kappa`` (n,),
                    ``camera_principal`` (n, 2)
``landmark_*``      of the same photos, joined: ``landmark_count`` (n,),
                    ``landmark_scheme`` (n,), ``landmark_points`` (sum, 2),
                    ``landmark_weight`` (sum,)
``expressions``     float64 (n, k): of the same photos
``deviation``       float64 (M, N), mm; left out when unknown
``photometric_*``   ``uv`` (p, 2), ``normals`` (p, 3), ``albedo`` (p, 3),
                    ``lights`` (n, 9), ``singular_values`` (k,), and with three
                    digits ``weights`` and ``residual`` (n, p); left out when
                    the run had none
``constraint_*``    ``points`` (M, N) bool and ``softness_mm``; left out when no
                    control point was held
==================  ===========================================================

The first five are the promise; readers must tolerate the absence of the others.
Version 1 had ``confidence`` for ``deviation`` and none of the sizes, expressions,
hashes, weights and the template's parts.
"""

from __future__ import annotations

import datetime
import io
import os
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from .._types import Array
from ..camera.camera import Camera
from ..errors import ReconstructionError
from ..files import replacing
from ..images.photo import Photo
from ..json_text import from_json, to_json
from ..kinds import expect, expect_paths
from ..landmarks.landmarks import Landmarks
from ..npz_arrays import floats, open_file, read_arrays
from ..photometry.lighting import PhotometricEvidence
from ..problem import Constraint
from ..result import HistoryEntry, PhotoReport, Provenance, Reconstruction, no_photo
from ..settings import Settings
from ..surface.bspline import BSplineSurface
from ..surface.template import Template, load_template

Arrays = dict[str, npt.NDArray]

FILE_VERSION = 2
#: Face files have a few megabytes; a small file may claim to hold anything.
MAX_BYTES = 500_000_000
#: Control points along each side, and how far from the origin they may lie, mm.
MAX_NET, MAX_MM = 256, 1e5
MIN_MM = 1e-3  #: a surface that is smaller than this is none
_CAMERA = {"R": (3, 3), "s": (), "t": (2,), "kappa": (), "principal": (2,)}
_TEMPLATE = ("landmark_xyz", "eye_centres")
OTHER_TEMPLATE = (
    "The face was made of another template than the one it is read with; give that "
    "template too, or its expressions and regions are not right."
)
_ROUNDED = ("weights", "residual")  # stored as float16


# ------------------------------------------------------------------ writing
def save_face(
    path: str | os.PathLike, face: Reconstruction, *, date: str | None = None
) -> Path:
    """Write a face file; see `Reconstruction.save`.

    ``.npz`` is added when the name has no ending.
    """
    path = Path(path)
    if not path.suffix:
        path = path.with_suffix(".npz")
    with replacing(path) as temporary:
        temporary.write_bytes(face_bytes(face, date))
    return path


def face_bytes(face: Reconstruction, date: str | None = None) -> bytes:
    """The bytes of a face file; see `Reconstruction.save`."""
    return npz_bytes(face_arrays(face, date or _now()))


def face_arrays(face: Reconstruction, date: str) -> Arrays:
    """The arrays of a face file, by name."""
    m, n = face.surface.shape
    template, origin = face.template, face.provenance
    about = {
        "file_version": FILE_VERSION,
        "program": "bsface",
        "version": origin.program,
        "libraries": origin.libraries,
        "date": date,
        "units": "mm",
        "hashes": origin.hashes,
        "history": [entry._asdict() for entry in face.history],
        "warnings": face.warnings,
    }
    arrays: Arrays = {
        "control_points": face.surface.control_points,
        "knots_u": np.arange(m + 4, dtype=np.float64),
        "knots_v": np.arange(n + 4, dtype=np.float64),
        "settings": np.array(to_json(face.settings.to_dict())),
        "report": np.array(to_json(face.reports)),
        "about": np.array(to_json(about)),
        "outline_uv": template.outline_uv,
        "template_control_points": template.surface.control_points,
        "template_digest": np.array(template.digest()),
        **{f"template_{name}": getattr(template, name) for name in _TEMPLATE},
    }
    if face.cameras:
        arrays["camera_photo"] = np.array([p.name for p in face.photos])
        arrays["camera_size"] = np.array([p.size for p in face.photos], float)
        arrays["expressions"] = face.expressions
        for name in _CAMERA:
            values = [getattr(camera, name) for camera in face.cameras]
            arrays[f"camera_{name}"] = np.array(values, float)
    if face.landmarks:
        marks = face.landmarks
        arrays["landmark_count"] = np.array([len(m.points) for m in marks])
        arrays["landmark_scheme"] = np.array([m.scheme for m in marks])
        arrays["landmark_points"] = np.concatenate([m.points for m in marks])
        arrays["landmark_weight"] = np.concatenate([m.weight for m in marks])
    if face.deviation is not None:
        arrays["deviation"] = face.deviation
    if face.photometric is not None:
        for name, value in vars(face.photometric).items():
            kind = np.float16 if name in _ROUNDED else np.float64
            arrays[f"photometric_{name}"] = np.asarray(value, kind)
    if face.constraint is not None:
        arrays["constraint_points"] = np.asarray(face.constraint.points, bool)
        arrays["constraint_softness_mm"] = np.array(face.constraint.softness_mm)
    return arrays


def npz_bytes(arrays: Arrays) -> bytes:
    """An ``.npz`` archive whose bytes depend on the arrays alone.

    ``numpy.savez`` stamps each member with the present time; here all carry the
    first date that the zip format knows.
    """
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as target:
        for name, value in arrays.items():
            member = io.BytesIO()
            np.lib.format.write_array(member, np.asarray(value), allow_pickle=False)
            info = zipfile.ZipInfo(f"{name}.npy", date_time=(1980, 1, 1, 0, 0, 0))
            info.compress_type = zipfile.ZIP_DEFLATED
            info.create_system = 3
            info.external_attr = 0o644 << 16
            target.writestr(info, member.getvalue(), compresslevel=6)
    return archive.getvalue()


def _now() -> str:
    """The time in UTC, or that of ``SOURCE_DATE_EPOCH`` (reproducible-builds.org)."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    zone = datetime.UTC
    if epoch.isdecimal():
        moment = datetime.datetime.fromtimestamp(int(epoch), zone)
    else:
        moment = datetime.datetime.now(zone)
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")


# ------------------------------------------------------------------ reading
def load_face(
    path: str | os.PathLike, template: Template | None = None
) -> Reconstruction:
    """Read a face file.

    Parameters
    ----------
    path : path-like
    template : Template, optional
        That the face was made of, if it was not the bundled one.

    Returns
    -------
    Reconstruction
        Its photos have names and sizes, but no pixels.

    Raises
    ------
    ReconstructionError
        When the file is absent, damaged, not a face file, or of a newer version.
    """
    expect_paths(path=path)
    expect(Template | None, "a Template", template=template)
    try:
        with open_file(path) as file:
            return read_face(file, os.fspath(path), template)
    except FileNotFoundError:
        raise ReconstructionError(
            f"{path}: there is no such file; give the .npz of a reconstruction."
        ) from None
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise ReconstructionError(
            f"{path}: not a readable .npz file ({why}); write it again with bsface."
        ) from None


def read_face(
    file: BinaryIO, path: str, template: Template | None = None
) -> Reconstruction:
    """As `load_face`, from an open file; ``path`` is its name in messages."""
    arrays = read_arrays(file, MAX_BYTES)
    promised = ("control_points", "knots_u", "knots_v", "settings", "report")
    missing = [name for name in promised if name not in arrays]
    if missing:
        raise ReconstructionError(
            f"{path}: not a face file ({', '.join(missing)} missing); "
            "give the .npz of a reconstruction."
        )
    try:
        about = from_json(arrays, "about", dict) if "about" in arrays else {}
        version = about.get("file_version", 1)
        if not isinstance(version, int) or version > FILE_VERSION:
            raise ReconstructionError(
                f"{path}: the file has version {version!s:.20}, and this bsface reads "
                f"up to {FILE_VERSION}; install a newer bsface."
            )
        return _face(arrays, about, template or load_template())
    except ValueError as error:
        raise ReconstructionError(
            f"{path}: the face file is damaged ({error}); write it again with bsface."
        ) from None


def _face(arrays: Arrays, about: dict[str, Any], base: Template) -> Reconstruction:
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
    return Reconstruction(
        surface=surface,
        template=template,
        photos=photos,
        landmarks=landmarks,
        cameras=cameras,
        photometric=_photometric(arrays, len(photos)),
        reports=_reports(arrays),
        deviation=_optional(arrays, deviation, *surface.shape),
        settings=_settings(arrays, surface.shape),
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
    if np.abs(points).max() > MAX_MM:
        raise ValueError(
            f"control_points lie up to {np.abs(points).max():.3g} mm from the origin, "
            f"more than {MAX_MM:g}"
        )
    spread = points.reshape(-1, 3) - points.mean(axis=(0, 1))
    if np.linalg.svd(spread, compute_uv=False)[1] < MIN_MM:
        raise ValueError("all control_points are at one place or on one line")
    return BSplineSurface(points)


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
    return replace(base, **parts)


def _cameras(arrays: Arrays) -> tuple[Camera, ...]:
    if "camera_R" not in arrays:
        return ()
    n = len(floats(arrays, "camera_R", None, 3, 3))
    columns = {k: floats(arrays, f"camera_{k}", n, *s) for k, s in _CAMERA.items()}
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


def _settings(arrays: Arrays, shape: tuple[int, int]) -> Settings:
    """Settings of the run; unknown ones, of another version, are passed over."""
    values = from_json(arrays, "settings", dict)
    known = Settings().to_dict()
    values = {name: value for name, value in values.items() if name in known}
    try:
        return Settings.from_dict(values)
    except ValueError:
        net = shape if max(shape) <= 120 and min(shape) >= 8 else (42, 44)
        return Settings(control_points=net)


def _reports(arrays: Arrays) -> tuple[PhotoReport, ...]:
    out = []
    for row in from_json(arrays, "report", list):
        if not isinstance(row, Mapping):
            raise ValueError("report is not a list of photos")
        number = {
            name: float("nan") if not isinstance(value, int | float) else float(value)
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
            values = [
                float(x) if isinstance(x, int | float) else float("nan")
                for x in numbers
            ]
            out.append(HistoryEntry(str(row.get("stage", "")), *values))
    return tuple(out)


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
