"""The mean MediaPipe mesh of several photos: what landmarks alone give anybody.

The face mesh network puts a third coordinate beside each landmark.  The mean of these
meshes over a person's photos, aligned by similarities, is the simplest face that one
can have from many photos, and the one to be better than.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from bsface.landmarks.crops import CROP_MARGIN, Crop, pyramid, sample
from bsface.landmarks.face_mesh import (
    LEFT_EYE_OUTER,
    MESH_OUTPUTS,
    MESH_SIDE,
    RIGHT_EYE_OUTER,
)
from bsface.landmarks.face_models import find_models, load_network
from bsface.problem import PhotoCollection
from bsface.surface.alignment import EYE_CORNERS, fit_similarity
from bsface.surface.template import Template
from numpy.typing import NDArray

Array = NDArray[np.float64]


def photo_meshes(collection: PhotoCollection) -> Array:
    """The network's own mesh in each photo.

    Parameters
    ----------
    collection : PhotoCollection
        With landmarks of the scheme "468", from which the crops are made.

    Returns
    -------
    (n, 468, 3) array
        Pixels of the network's crop; x right, y up, z to the camera.
    """
    network = load_network(find_models().mesh, MESH_OUTPUTS, MESH_SIDE)
    meshes = []
    for photo, marks in zip(collection.photos, collection.landmarks, strict=True):
        crop = upright_crop(photo.to_window(marks.points))
        picture = sample(pyramid(photo.bytes8()), crop, MESH_SIDE)
        planes = picture.transpose(2, 0, 1)[None].astype(np.float32) / 255
        network.setInput(np.ascontiguousarray(planes))
        points, _ = network.forward(tuple(MESH_OUTPUTS))
        meshes.append(points.reshape(468, 3).astype(float) * (1, -1, -1))
    return np.stack(meshes)


def upright_crop(points: Array) -> Crop:
    """The square about the landmarks (468, 2), as upright as the eyes."""
    across = points[LEFT_EYE_OUTER] - points[RIGHT_EYE_OUTER]
    turn = float(np.arctan2(across[1], across[0]))
    axes = Crop(np.zeros(2), 1.0, turn).axes()
    upright = points @ axes
    low, high = upright.min(axis=0), upright.max(axis=0)
    side = float((high - low).max()) * CROP_MARGIN
    return Crop(axes @ ((low + high) / 2), side, turn)


def procrustes_mean(meshes: Sequence[Array], rounds: int = 10) -> Array:
    """Mean of corresponding points (k, 3) up to similarities.

    Parameters
    ----------
    meshes : sequence of (k, 3) arrays
    rounds : int
        Alternations of alignment to the mean and averaging.
    """
    mean = np.asarray(meshes[0], float)
    for _ in range(rounds):
        aligned = [fit_similarity(mesh, mean)(mesh) for mesh in meshes]
        mean = np.mean(aligned, axis=0)
    return mean


def scaled_to_eyes(mesh: Array, template: Template, eye_distance_mm: float) -> Array:
    """The mesh (468, 3) in the size that gives it a certain eye distance.

    It has no eye centres: the distance between the middles of the corners of each eye
    is taken, as a part of the eye distance that the template tells.
    """
    own = _across(mesh)
    usual = _across(template.landmark_xyz) / template.eye_distance
    return mesh * (eye_distance_mm * usual / own)


def _across(points: Array) -> float:
    right, left = (points[list(pair)].mean(axis=0) for pair in EYE_CORNERS)
    return float(np.linalg.norm(left - right))
