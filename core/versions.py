"""Versions of the program and of the libraries that a result depends on."""

from __future__ import annotations

import platform

import cv2
import numpy as np
import scipy

#: Also in `blender_manifest.toml` and `pyproject.toml`; a test compares them.
VERSION = "0.2.0"


def library_versions() -> dict[str, str]:
    """Name -> version of what a rerun needs."""
    return {
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "opencv": cv2.__version__,
        "system": f"{platform.system()} {platform.machine()}",
    }
