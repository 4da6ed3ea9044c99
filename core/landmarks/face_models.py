"""Where the files of the face networks lie, and loading the TFLite ones."""

from __future__ import annotations

import hashlib
import os
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ..errors import ReconstructionError, out_of_memory

DETECTOR_FILE = "face_detection_short_range.tflite"
MESH_FILE = "face_landmark.tflite"
RECOGNITION_FILE = "dlib_face_recognition_resnet_model_v1.dat"
OLDEST_OPENCV = (4, 11)
SHA256 = {
    DETECTOR_FILE: "bbff11cebd1eb27a1e004cae0b0e63ec8c551cbf34a4451148b4908b8db3eca8",
    MESH_FILE: "1055cb9d4a9ca8b8c688902a3a5194311138ba256bcc94e336d8373a5f30c814",
    RECOGNITION_FILE: (
        "55533b28a95800a551ba546ba62fe69625c7e95a7061c338adffead08719da30"
    ),
}


@dataclass(frozen=True)
class ModelFiles:
    """Where the networks lie: face detector, face mesh, face recognition."""

    detector: Path
    mesh: Path
    recognition: Path


def model_folders(folder: str | os.PathLike | None = None) -> tuple[Path, ...]:
    """Folders in which the networks are looked for, in this order."""
    if folder is not None:
        return (Path(folder),)
    folders = []
    if os.environ.get("BSFACE_MODELS"):
        folders.append(Path(os.environ["BSFACE_MODELS"]))
    folders.append(Path(__file__).resolve().parent.parent / "data" / "models")
    folders.append(user_cache() / "models")
    return tuple(folders)


def user_cache() -> Path:
    """The folder ``bsface`` in the user's cache, by the platform's custom."""
    home = Path(os.path.expanduser("~"))
    given = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(given):  # others are to be ignored, by the XDG specification
        base = Path(given)
    elif sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = home / "Library" / "Caches"
    else:
        base = home / ".cache"
    return base / "bsface"


def find_models(folder: str | os.PathLike | None = None) -> ModelFiles:
    """The networks' files.

    Parameters
    ----------
    folder : path, optional
        Look only here; by default in the folder that the environment variable
        ``BSFACE_MODELS`` names, in ``data/models`` of the package and in the
        user's cache.

    Raises
    ------
    ReconstructionError
        If no folder holds all files.
    """
    folders = model_folders(folder)
    for place in folders:
        paths = [place / name for name in (DETECTOR_FILE, MESH_FILE, RECOGNITION_FILE)]
        if all(path.is_file() for path in paths):
            return ModelFiles(*paths)
    raise ReconstructionError(
        "The face models are not together in any of these folders: "
        + ", ".join(str(place) for place in folders)
        + "; fetch them by `bsface models fetch` (the extension's zip brings them), or "
        "lay landmark files beside the photos and switch the detector off."
    )


def intact(path: Path) -> Path:
    """The file that `find_models` found, if it is the expected one.

    A network with a few wrong bytes loads and answers, only wrongly.

    Raises
    ------
    ReconstructionError
        The file cannot be read, or its hash is not the pinned one.
    """
    try:
        with path.open("rb") as file:
            found = hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        found = ""
    if found != SHA256[path.name]:
        raise ReconstructionError(damaged(path))
    return path


def load_network(path: Path, outputs: Mapping[str, int], side: int) -> cv2.dnn.Net:
    """The network in a file.

    Parameters
    ----------
    path : Path
    outputs : mapping of str to int
        Names of the outputs that the network must have, and how many numbers each
        gives for one picture.
    side : int
        The network reads pictures of ``side`` x ``side`` pixels.

    Raises
    ------
    ReconstructionError
        If the file cannot be read or is another network.
    """
    # OpenCV 5 has a second engine, which runs a network once for each output that is
    # asked for. The classic one gives all of them in one run, as OpenCV 4 does.
    classic = getattr(cv2.dnn, "ENGINE_CLASSIC", None)
    engine = {} if classic is None else {"engine": classic}
    try:
        net = cv2.dnn.readNetFromTFLite(str(path), **engine)
        net.setInput(np.zeros((1, 3, side, side), np.float32))
        sizes = [np.size(output) for output in net.forward(tuple(outputs))]
    except (AttributeError, cv2.error, OSError) as error:
        if out_of_memory(error):
            raise
        raise ReconstructionError(
            why_not_loaded(path, error, cv2.__version__)
        ) from None
    if sizes != list(outputs.values()):
        raise ReconstructionError(damaged(path))
    return net


def why_not_loaded(path: Path, error: Exception, version: str) -> str:
    """Why OpenCV could not load a model file, and the remedy, in one sentence.

    Parameters
    ----------
    path : Path
    error : Exception
        What OpenCV raised.
    version : str
        Of OpenCV, such as ``"4.11.0"``.
    """
    if tuple(map(int, re.findall(r"\d+", version)[:2])) < OLDEST_OPENCV:
        oldest = ".".join(map(str, OLDEST_OPENCV))
        return (
            f"OpenCV {version} is too old for the face detector, which needs {oldest} "
            f"or newer; install it by `pip install 'opencv-python-headless>={oldest}'`."
        )
    if isinstance(error, AttributeError) or "flatbuffers" in str(error).lower():
        return (
            f"This build of OpenCV {version} cannot read TFLite models, because it was "
            "compiled without FlatBuffers; install the package opencv-python-headless "
            "in its place."
        )
    return damaged(path)


def damaged(path: Path) -> str:
    """What to do with a model file that is not what it should be, in one sentence."""
    return (
        f"{path} is damaged or is not the expected model file; remove it and fetch it "
        "again by `bsface models fetch` (the extension's zip brings it)."
    )
