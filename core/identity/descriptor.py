"""Descriptor of a face: 128 numbers that are close for pictures of one person.

The face is turned upright and scaled as in the pictures that the network was trained
on, by the similarity that brings the corners of the eyes and the base of the nose
closest to fixed places (least squares; Umeyama 1991). Descriptors are compared by
their Euclidean distance: below 0.6 they are of one person in most cases.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from .._types import Array
from ..images.photo import Photo
from ..landmarks.crops import Crop, pyramid, sample
from ..landmarks.landmarks import Landmarks
from ..surface.template import load_template
from .face_network import SIDE, FaceNetwork

# Outer and inner corner of the left eye, of the right eye, base of the nose: landmarks,
# and their places in a square about the face (dlib, `get_face_chip_details`).
ANCHORS = (263, 362, 33, 133, 2)
PLACES = np.array(
    [
        [0.8595674595992, 0.2134981538014],
        [0.6460604764104, 0.2289674387677],
        [0.1205750620789, 0.2137274526848],
        [0.3340850613712, 0.2290642403242],
        [0.4901123135679, 0.6277975316475],
    ]
)
MARGIN = 0.25  # about that square, in parts of its side


def describe_face(
    photo: Photo, landmarks: Landmarks, network: FaceNetwork
) -> Array | None:
    """Descriptor (128,) of a face; None if one of its anchors is not known."""
    points = anchor_points(landmarks)
    if points is None:
        return None
    crop = face_crop(photo.to_window(points))
    return network.describe(sample(pyramid(photo.bytes8(), SIDE), crop, SIDE))


def anchor_points(landmarks: Landmarks) -> Array | None:
    """The landmarks (5, 2) by which a face is brought upright; None if one is unknown.

    All schemes have them.
    """
    rows = list(_anchor_rows(landmarks.scheme))
    if not (landmarks.weight[rows] > 0).all():
        return None
    return landmarks.points[rows]


@cache
def _anchor_rows(scheme: str) -> tuple[int, ...]:
    """Where the anchors stand in a scheme, which is the same for all templates."""
    numbers = np.asarray(load_template().schemes[scheme]).tolist()
    return tuple(numbers.index(anchor) for anchor in ANCHORS)


def face_crop(points: Array) -> Crop:
    """The square of the picture that the network wants, from the anchors (5, 2)."""
    places = SIDE * (PLACES + MARGIN) / (1 + 2 * MARGIN)
    middle, centre = places.mean(axis=0), points.mean(axis=0)
    # As complex numbers a similarity without reflection is one factor.
    a = (places - middle) @ (1, 1j)
    b = (points - centre) @ (1, 1j)
    factor = np.vdot(a, b) / np.vdot(a, a).real
    moved = factor * ((SIDE / 2 - middle) @ (1, 1j))
    return Crop(
        centre + (moved.real, moved.imag),
        float(abs(factor)) * SIDE,
        float(np.angle(factor)),
    )
