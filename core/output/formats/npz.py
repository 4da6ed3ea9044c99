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

from ...errors import ReconstructionError
from ...evidence.camera import Camera
from ...surface.bspline import BSplineSurface
from ..files import replacing

Array = npt.NDArray[np.float64]

FILE_VERSION = 1
_PHOTOMETRIC = ("uv", "normals", "albedo", "lights", "singular_values")


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
        # Opened here: numpy leaves the file open when it is damaged.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except FileNotFoundError:
        raise ReconstructionError(
            f"{path}: there is no such file; give the .npz of a reconstruction."
        ) from None
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, AttributeError):
        raise ReconstructionError(
            f"{path}: not a readable .npz file; write it again with bsface."
        ) from None
    promised = ("control_points", "knots_u", "knots_v", "settings", "report")
    missing = [name for name in promised if name not in arrays]
    if missing:
        raise ReconstructionError(
            f"{path}: not a face file ({', '.join(missing)} missing); "
            "give the .npz of a reconstruction."
        )
    points = np.asarray(arrays["control_points"], float)
    knots_u, knots_v = arrays["knots_u"], arrays["knots_v"]
    if (
        points.ndim != 3
        or points.shape[2] != 3
        or min(points.shape[:2]) < 4
        or not np.isfinite(points).all()
        or not _are_uniform(knots_u, points.shape[0])
        or not _are_uniform(knots_v, points.shape[1])
    ):
        raise ReconstructionError(
            f"{path}: the control points or knots are not those of a uniform bicubic "
            "surface; write the file again with bsface."
        )
    try:
        settings = json.loads(str(arrays["settings"]))
        report = json.loads(str(arrays["report"]))
        about = json.loads(str(arrays.get("about", "{}")))
    except json.JSONDecodeError:
        raise ReconstructionError(
            f"{path}: its settings or report are damaged; write the file again."
        ) from None
    return SavedFace(
        control_points=points,
        knots_u=knots_u,
        knots_v=knots_v,
        settings=settings,
        report=report,
        about=about,
        outline_uv=arrays.get("outline_uv"),
        confidence=arrays.get("confidence"),
        photometric={
            name: arrays[f"photometric_{name}"]
            for name in _PHOTOMETRIC
            if f"photometric_{name}" in arrays
        },
        **_cameras(arrays),
        **_landmarks(arrays),
    )


def _are_uniform(knots: npt.NDArray, count: int) -> bool:
    return knots.shape == (count + 4,) and np.array_equal(knots, np.arange(count + 4))


def _cameras(arrays: dict[str, npt.NDArray]) -> dict[str, Any]:
    if "camera_R" not in arrays:
        return {}
    cameras = tuple(
        Camera(R=R, s=float(s), t=t, kappa=float(kappa), principal=principal)
        for R, s, t, kappa, principal in zip(
            arrays["camera_R"],
            arrays["camera_s"],
            arrays["camera_t"],
            arrays["camera_kappa"],
            arrays["camera_principal"],
            strict=True,
        )
    )
    return {
        "camera_photos": tuple(str(name) for name in arrays["camera_photo"]),
        "cameras": cameras,
    }


def _landmarks(arrays: dict[str, npt.NDArray]) -> dict[str, Any]:
    if "landmark_count" not in arrays:
        return {}
    ends = np.cumsum(arrays["landmark_count"])[:-1]
    return {
        "landmark_schemes": tuple(str(name) for name in arrays["landmark_scheme"]),
        "landmark_points": tuple(np.split(arrays["landmark_points"], ends)),
        "landmark_weights": tuple(np.split(arrays["landmark_weight"], ends)),
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
