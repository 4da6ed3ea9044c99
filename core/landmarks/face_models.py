"""Where the two network files lie, and loading them."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path

import cv2

from ..errors import ReconstructionError, out_of_memory

DETECTOR_FILE = "face_detection_short_range.tflite"
MESH_FILE = "face_landmark.tflite"


@dataclass(frozen=True)
class ModelFiles:
    """Where the two networks lie."""

    detector: Path
    mesh: Path


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
    if os.environ.get("XDG_CACHE_HOME"):
        base = Path(os.environ["XDG_CACHE_HOME"])
    elif sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = home / "Library" / "Caches"
    else:
        base = home / ".cache"
    return base / "bsface"


def find_models(folder: str | os.PathLike | None = None) -> ModelFiles:
    """The two networks' files.

    Parameters
    ----------
    folder : path, optional
        Look only here; by default in the folder that the environment variable
        ``BSFACE_MODELS`` names, in ``data/models`` of the package and in the
        user's cache.

    Raises
    ------
    ReconstructionError
        If no folder holds both files.
    """
    folders = model_folders(folder)
    for place in folders:
        files = ModelFiles(place / DETECTOR_FILE, place / MESH_FILE)
        if files.detector.is_file() and files.mesh.is_file():
            return files
    raise ReconstructionError(
        "The face detector's model files are in none of these folders: "
        + ", ".join(str(place) for place in folders)
        + "; fetch them by `python3 dev.py setup`, or lay landmark files "
        "beside the photos and switch the detector off."
    )


def load_network(path: Path, outputs: tuple[str, str]) -> cv2.dnn.Net:
    """The network in a file; it must have the named outputs.

    Raises
    ------
    ReconstructionError
        If the file cannot be read or is another network.
    """
    try:
        net = cv2.dnn.readNetFromTFLite(str(path))
        names = net.getUnconnectedOutLayersNames()
    except (cv2.error, OSError) as error:
        if out_of_memory(error):
            raise
        names = ()
    if set(names) != set(outputs):
        raise ReconstructionError(
            f"{path} is not the expected model file; remove it and fetch it again "
            "by `python3 dev.py setup`."
        )
    return net
