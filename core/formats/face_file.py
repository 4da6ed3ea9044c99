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
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ..errors import ReconstructionError
from ..files import replacing
from ..json_text import from_json, to_json
from ..kinds import expect, expect_paths
from ..npz_arrays import open_file, read_arrays
from ..result import Reconstruction
from ..surface.template import Template, load_template
from .face_reader import CAMERA_SHAPES, Arrays, face_from_arrays
from .options import check_date

FILE_VERSION = 2
#: Face files have a few megabytes; a small file may claim to hold anything.
MAX_BYTES = 500_000_000
_TEMPLATE = ("landmark_xyz", "eye_centres")
_ROUNDED = ("weights", "residual")  # stored as float16


# ------------------------------------------------------------------ writing
def save_face(
    path: str | os.PathLike, face: Reconstruction, *, date: str | None = None
) -> Path:
    """Write a face file; see `Reconstruction.save`.

    ``.npz`` is added when the name has no ending.
    """
    expect_paths(path=path)
    expect(str | None, "a text", date=date)
    path = Path(path)
    if not path.name:
        raise ReconstructionError(
            "The name of the face file is empty; give one that ends in .npz."
        )
    if not path.suffix:
        path = path.with_suffix(".npz")
    if path.suffix.lower() != ".npz":
        raise ReconstructionError(
            f"{path}: a face file ends in .npz; bsface.export writes the other formats."
        )
    if date is not None:
        check_date(path, date)
    arrays = face_arrays(face, date or _now())
    try:
        # What the reader refuses is not written; its judgement is the only one.
        face_from_arrays(arrays, {}, face.template)
    except ValueError as error:
        why = str(error).rstrip(".")
        raise ReconstructionError(
            f"{path}: a face file cannot hold this face ({why}); change the face or "
            "export it in another format."
        ) from None
    with replacing(path) as temporary:
        temporary.write_bytes(npz_bytes(arrays))
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
        for name in CAMERA_SHAPES:
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
        return face_from_arrays(arrays, about, template or load_template())
    except ValueError as error:
        why = str(error).rstrip(".")
        raise ReconstructionError(
            f"{path}: the face file is damaged ({why}); write it again with bsface."
        ) from None
