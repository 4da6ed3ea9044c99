"""The project's own file: ``face.npz``.

Contract (version 1), readable by ``numpy.load(path, allow_pickle=False)``:

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
``about``           JSON text: file version, program version, history, warnings
``camera_*``        one row for every used photo: ``camera_photo`` (name),
                    ``camera_R`` (n, 3, 3), ``camera_s`` (n,), ``camera_t``
                    (n, 2), ``camera_kappa`` (n,), ``camera_principal`` (n, 2)
``landmark_*``      of the same photos, joined: ``landmark_count`` (n,),
                    ``landmark_scheme`` (n,), ``landmark_points`` (sum, 2),
                    ``landmark_weight`` (sum,)
``confidence``      float64 (M, N), mm; left out when unknown
``photometric_*``   ``uv`` (p, 2), ``normals`` (p, 3), ``albedo`` (p, 3),
                    ``lights`` (n, 9), ``singular_values`` (k,); left out when
                    the run had none
==================  ===========================================================

The first five are the promise; readers must tolerate the absence of the others.
Nothing in the file depends on the clock: equal runs give equal bytes.
"""

from __future__ import annotations

import dataclasses
import io
import json
import os
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..camera.camera import Camera
from ..errors import ReconstructionError
from ..files import replacing
from ..npz_arrays import floats, read_arrays
from ..surface.bspline import BSplineSurface

Array = npt.NDArray[np.float64]

FILE_VERSION = 1
# Face files have a few hundred kilobytes; a small file may claim to hold anything.
MAX_BYTES = 100_000_000
# Name -> shape.
_PHOTOMETRIC: dict[str, tuple[int | None, ...]] = {
    "uv": (None, 2),
    "normals": (None, 3),
    "albedo": (None, 3),
    "lights": (None, None),
    "singular_values": (None,),
}


@dataclass(frozen=True)
class SavedFace:
    """What a face file holds.

    Attributes
    ----------
    control_points : (M, N, 3) array
        Millimetres.
    knots_u, knots_v : (M + 4,), (N + 4,) arrays
    settings : dict
    report : list of dict
        One for every photo of the folder.
    about : dict
        File version, program version, history, warnings.
    outline_uv : (k, 2) array or None
    camera_photos : tuple of str
        Names of the used photos, in the order of ``cameras``.
    cameras : tuple of Camera
    landmark_schemes : tuple of str
    landmark_points, landmark_weights : tuples of (f, 2) and (f,) arrays
        For each used photo.
    confidence : (M, N) array or None
        Standard deviation, mm.
    photometric : dict of arrays
    """

    control_points: Array
    knots_u: Array
    knots_v: Array
    settings: dict[str, Any]
    report: list[dict[str, Any]]
    about: dict[str, Any] = field(default_factory=dict)
    outline_uv: Array | None = None
    camera_photos: tuple[str, ...] = ()
    cameras: tuple[Camera, ...] = ()
    landmark_schemes: tuple[str, ...] = ()
    landmark_points: tuple[Array, ...] = ()
    landmark_weights: tuple[Array, ...] = ()
    confidence: Array | None = None
    photometric: dict[str, Array] = field(default_factory=dict)

    @property
    def surface(self) -> BSplineSurface:
        """The surface that the control points span."""
        return BSplineSurface(self.control_points)


def write_npz(path: str | os.PathLike, reconstruction: Any) -> Path:
    """Write a reconstruction to a face file.

    Parameters
    ----------
    path : path-like
        ``.npz`` is added when the name has no ending.
    reconstruction : Reconstruction

    Returns
    -------
    Path
        The file that was written.

    Raises
    ------
    ReconstructionError
        When the file cannot be written.
    """
    path = Path(path)
    if not path.suffix:
        path = path.with_suffix(".npz")
    with replacing(path) as temporary:
        temporary.write_bytes(npz_bytes(contents(reconstruction)))
    return path


def contents(reconstruction: Any) -> dict[str, npt.NDArray]:
    """The arrays of a face file, by name."""
    surface = reconstruction.surface
    m, n = surface.shape
    arrays: dict[str, npt.NDArray] = {
        "control_points": np.asarray(surface.control_points, np.float64),
        "knots_u": np.arange(m + 4, dtype=np.float64),
        "knots_v": np.arange(n + 4, dtype=np.float64),
        "settings": np.array(to_json(reconstruction.settings.to_dict())),
        "report": np.array(to_json(list(reconstruction.reports))),
        "about": np.array(
            to_json(
                {
                    "file_version": FILE_VERSION,
                    "program": "bsface",
                    "units": "mm",
                    "history": list(reconstruction.history),
                    "warnings": list(reconstruction.warnings),
                }
            )
        ),
    }
    if reconstruction.template is not None:
        arrays["outline_uv"] = np.asarray(reconstruction.template.outline_uv, float)
    if reconstruction.cameras:
        arrays["camera_photo"] = np.array([p.name for p in reconstruction.photos])
        for name in ("R", "s", "t", "kappa", "principal"):
            arrays[f"camera_{name}"] = np.array(
                [getattr(camera, name) for camera in reconstruction.cameras], float
            )
    if reconstruction.landmarks:
        marks = reconstruction.landmarks
        arrays["landmark_count"] = np.array([len(m.points) for m in marks])
        arrays["landmark_scheme"] = np.array([m.scheme for m in marks])
        arrays["landmark_points"] = np.concatenate([m.points for m in marks])
        arrays["landmark_weight"] = np.concatenate([m.weight for m in marks])
    if reconstruction.confidence is not None:
        arrays["confidence"] = np.asarray(reconstruction.confidence, float)
    if reconstruction.photometric is not None:
        for name in _PHOTOMETRIC:
            value = getattr(reconstruction.photometric, name, None)
            if value is not None:
                arrays[f"photometric_{name}"] = np.asarray(value, float)
    return arrays


def npz_bytes(arrays: dict[str, npt.NDArray]) -> bytes:
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


def read_npz(path: str | os.PathLike) -> SavedFace:
    """Read a face file.

    Raises
    ------
    ReconstructionError
        When the file is absent, damaged, or not a face file.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            arrays = read_arrays(file, MAX_BYTES)
    except FileNotFoundError:
        raise ReconstructionError(
            f"{path}: there is no such file; give the .npz of a reconstruction."
        ) from None
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise ReconstructionError(
            f"{path}: not a readable .npz file ({why}); write it again with bsface."
        ) from None
    promised = ("control_points", "knots_u", "knots_v", "settings", "report")
    missing = [name for name in promised if name not in arrays]
    if missing:
        raise ReconstructionError(
            f"{path}: not a face file ({', '.join(missing)} missing); "
            "give the .npz of a reconstruction."
        )
    try:
        return SavedFace(
            **_surface(arrays),
            settings=_json(arrays, "settings", dict),
            report=_json(arrays, "report", list),
            about=_json(arrays, "about", dict) if "about" in arrays else {},
            outline_uv=_optional(arrays, "outline_uv", None, 2),
            confidence=_optional(arrays, "confidence", None, None, finite=False),
            photometric=_photometric(arrays),
            **_cameras(arrays),
            **_landmarks(arrays),
        )
    except ValueError as error:
        raise ReconstructionError(
            f"{path}: the face file is damaged ({error}); write it again with bsface."
        ) from None


def _surface(arrays: dict[str, npt.NDArray]) -> dict[str, Array]:
    points = floats(arrays, "control_points", None, None, 3)
    if min(points.shape[:2]) < 4:
        raise ValueError("control_points are fewer than 4 x 4")
    knots = {"control_points": points}
    for name, count in zip(("knots_u", "knots_v"), points.shape[:2], strict=True):
        knots[name] = floats(arrays, name, count + 4)
        if not np.array_equal(knots[name], np.arange(count + 4)):
            raise ValueError(f"{name} are not those of a uniform bicubic surface")
    return knots


def _json(arrays: dict[str, npt.NDArray], name: str, kind: type) -> Any:
    text = arrays[name]
    if text.shape != () or text.dtype.kind != "U":
        raise ValueError(f"{name} is not a text")
    try:
        value = json.loads(str(text))
    except (ValueError, RecursionError):
        raise ValueError(f"{name} is not valid JSON") from None
    if not isinstance(value, kind):
        raise ValueError(f"{name} is not a {kind.__name__}")
    return value


def _optional(
    arrays: dict[str, npt.NDArray], name: str, *shape: int | None, finite: bool = True
) -> Array | None:
    return floats(arrays, name, *shape, finite=finite) if name in arrays else None


def _photometric(arrays: dict[str, npt.NDArray]) -> dict[str, Array]:
    found = {}
    for name, shape in _PHOTOMETRIC.items():
        value = _optional(arrays, f"photometric_{name}", *shape, finite=False)
        if value is not None:
            found[name] = value
    return found


def _names(arrays: dict[str, npt.NDArray], name: str, count: int) -> tuple[str, ...]:
    found = arrays.get(name, np.zeros(0))
    if found.shape != (count,) or found.dtype.kind != "U":
        raise ValueError(f"{name} must hold {count} names")
    return tuple(str(item) for item in found)


def _cameras(arrays: dict[str, npt.NDArray]) -> dict[str, Any]:
    if "camera_R" not in arrays:
        return {}
    R = floats(arrays, "camera_R", None, 3, 3)
    n = len(R)
    rest = zip(
        R,
        floats(arrays, "camera_s", n),
        floats(arrays, "camera_t", n, 2),
        floats(arrays, "camera_kappa", n),
        floats(arrays, "camera_principal", n, 2),
        strict=True,
    )
    cameras = tuple(
        Camera(R=R, s=float(s), t=t, kappa=float(kappa), principal=principal)
        for R, s, t, kappa, principal in rest
    )
    return {"camera_photos": _names(arrays, "camera_photo", n), "cameras": cameras}


def _landmarks(arrays: dict[str, npt.NDArray]) -> dict[str, Any]:
    if "landmark_count" not in arrays:
        return {}
    count = floats(arrays, "landmark_count", None)
    points = floats(arrays, "landmark_points", None, 2)
    weights = floats(arrays, "landmark_weight", len(points))
    if (count < 0).any() or (count % 1).any() or count.sum() != len(points):
        raise ValueError("landmark_count does not fit landmark_points")
    ends = np.cumsum(count.astype(int))[:-1]
    return {
        "landmark_schemes": _names(arrays, "landmark_scheme", len(count)),
        "landmark_points": tuple(np.split(points, ends)),
        "landmark_weights": tuple(np.split(weights, ends)),
    }


def to_json(value: Any, indent: int | None = None) -> str:
    """JSON text of dataclasses, arrays and plain values; NaN becomes null."""
    return json.dumps(_plain(value), indent=indent, ensure_ascii=False, sort_keys=False)


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    return value
