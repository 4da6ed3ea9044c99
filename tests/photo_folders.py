"""Photos in folders and landmarks for them, for the tests of their reading."""

from pathlib import Path

import cv2
import numpy as np
from bsface.landmarks.landmarks import Landmarks
from bsface.settings import Settings
from bsface.surface.template import load_template

PHOTOS = Path(__file__).resolve().parents[1] / "examples" / "photos"
TEMPLATE = load_template()
NO_DETECTOR = Settings(landmarks="468", detector=False)


def save(path: Path, image: np.ndarray) -> None:
    done, data = cv2.imencode(path.suffix, np.ascontiguousarray(image[..., ::-1]))
    assert done
    path.write_bytes(data.tobytes())


def front_landmarks(scheme="68", centre=(200.0, 200.0), scale=1.2, name="a.png"):
    """The template seen from the front, without any detector."""
    xyz = TEMPLATE.landmark_xyz[TEMPLATE.schemes[scheme]]
    points = xyz[:, :2] * (scale, -scale) + centre
    return Landmarks(name, scheme, points, np.ones(len(points)), source="hand")


def codes(collection) -> dict[str, str]:
    return {failure.name: failure.code for failure in collection.failures}
