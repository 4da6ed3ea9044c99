"""Faces and 468 landmarks in a picture, by two small networks.

The networks are MediaPipe's (Apache-2.0): BlazeFace short range, which wants a
128-pixel picture, and Face Mesh, which wants a 192-pixel upright crop of one
face. OpenCV's DNN module runs them. For landmarks that are accurate enough to measure
with, this module adds a pyramid of windows for small faces, rotations for lying
ones, a crop that is aligned again from its own landmarks, and the average over
several crops and their mirror images.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from .crops import CROP_MARGIN, Crop, pyramid, sample, windows_of
from .face_models import ModelFiles, find_models, intact, load_network
from .face_proposals import (
    DETECTOR_SIDE,
    Proposal,
    anchor_centres,
    decode,
    direction,
    unlike,
)

MESH_SIDE = 192
# Names of the outputs, and how many numbers each holds: 896 anchors with a box and six
# points, and their scores; 468 landmarks in three coordinates, and the logit of a face.
DETECTOR_OUTPUTS = {"regressors": 896 * 16, "classificators": 896}
MESH_OUTPUTS = {"conv2d_21": 468 * 3, "conv2d_31": 1}
# Corners of the eyes: the crop is turned until the line 33-263 is level.
RIGHT_EYE_OUTER, LEFT_EYE_OUTER = 33, 263

# Faces of photographs have 0.999 and more, upside down or wrong places mostly
# less than 0.5.
MIN_MESH_SCORE = 0.95
# On the detector's own crop, which may be askew, faces have 1 and more.
MIN_FIRST_LOGIT = -2.0
MAX_PROPOSALS = 12

# Where faces are looked for until one is found: parts of the picture's longer
# side (1 = the whole, below 1 = with a border, for faces that fill the picture),
# and turns of the window in degrees.
_STAGES: tuple[tuple[tuple[float, ...], tuple[float, ...]], ...] = (
    ((1, 2), (0,)),
    ((0.5, 0.75), (0,)),
    ((0.75, 1), (90, -90, 180)),
    ((4,), (0,)),
    ((0.75, 1), (45, -45, 135, -135)),
    ((8,), (0,)),
    ((2,), (90, -90, 180)),
    ((16,), (0,)),
)

# Crops of the average: shift right and down, and scale, in parts of the crop.
# The set is its own mirror image, which makes the average exactly equivariant.
AUGMENTATIONS = (
    (0.0, 0.0, 1.0),
    (-0.03, 0.0, 1.0),
    (0.03, 0.0, 1.0),
    (0.0, -0.025, 1.08),
    (0.0, 0.025, 0.93),
)


@dataclass(frozen=True, eq=False)
class Face:
    """A face that was found.

    Parameters
    ----------
    crop : Crop
        The square that the mesh wants, as upright as the eyes.
    score : float
        The mesh's probability that it shows a face, in [0, 1].
    """

    crop: Crop
    score: float

    @property
    def side(self) -> float:
        """Longer side of the landmarks' box in pixels."""
        return self.crop.side / CROP_MARGIN

    @property
    def box(self) -> np.ndarray:
        """(x0, y0, x1, y1), the square about the landmarks' centre, in pixels."""
        return self.crop.box()


@dataclass(frozen=True, eq=False)
class FaceLandmarks:
    """The 468 landmarks of one face.

    Parameters
    ----------
    points : (468, 2) array
        Pixels of the picture that was given.
    sigma : (468,) array
        Standard deviation of each point over the augmentations, pixels: how
        unsure the network is, not how wrong.
    score : float
        The network's probability that the crop shows a face, in [0, 1].
    """

    points: np.ndarray
    sigma: np.ndarray
    score: float


class FaceMesh:
    """The two networks, loaded.

    One object may be shared by threads; they then wait for each other.

    Parameters
    ----------
    models : ModelFiles, optional
        By default `find_models` is asked.
    mirror : (468,) int array
        The landmark on the other side of the face, for each landmark.

    Raises
    ------
    ReconstructionError
        If the files are missing or are not these networks.
    """

    def __init__(self, models: ModelFiles | None, mirror: np.ndarray) -> None:
        files = models
        if files is None:
            files = find_models()
            for path in (files.detector, files.mesh):
                intact(path)
        self._mirror = np.asarray(mirror, int)
        self._lock = threading.Lock()
        self._anchors = anchor_centres()
        self._detector = load_network(files.detector, DETECTOR_OUTPUTS, DETECTOR_SIDE)
        self._mesh = load_network(files.mesh, MESH_OUTPUTS, MESH_SIDE)

    def detect_faces(
        self, image: np.ndarray, check_cancelled: Callable[[], None] | None = None
    ) -> tuple[Face, ...]:
        """Faces in a picture, the surest first.

        The detector makes proposals. One of them counts if the mesh is sure of a
        face on the crop or on the crop turned by one, two or three quarters. So a
        face that lies or is upside down gets its true direction, also where the
        detector took it for upright.

        Parameters
        ----------
        image : (h, w, 3) uint8 array
            RGB.
        check_cancelled : callable, optional
            Called now and then; may raise `Cancelled`.
        """
        check_cancelled = check_cancelled or (lambda: None)
        levels = pyramid(image)
        h, w = image.shape[:2]
        for divisions, angles in _STAGES:
            if min(divisions) > 2 and max(w, h) / min(divisions) < DETECTOR_SIDE / 2:
                continue
            windows = windows_of(w, h, divisions)
            proposals: list[Proposal] = []
            for angle in angles:
                for window in windows:
                    check_cancelled()
                    turned = Crop(window.centre, window.side, np.deg2rad(angle))
                    proposals += self._propose(levels, turned)
            proposals.sort(key=lambda p: -p.score)
            faces: list[Face] = []
            for proposal in unlike(proposals)[:MAX_PROPOSALS]:
                check_cancelled()
                face = self._verify(levels, proposal)
                if face is not None:
                    faces.append(face)
            if faces:
                faces.sort(key=lambda f: -f.score)
                return tuple(unlike(faces))
        return ()

    def landmarks(self, image: np.ndarray, face: Face) -> FaceLandmarks:
        """The landmarks of one face, averaged over crops and mirror images.

        The network puts x a little off to one side (0.35 pixels of its crop,
        seen by giving it a picture and its mirror image). Averaging the crop
        and the mirrored crop, whose landmarks are mirrored back and renamed,
        takes out exactly this part, so no offset is subtracted here: it would
        be taken off twice.

        Parameters
        ----------
        image : (h, w, 3) uint8 array
            RGB.
        face : Face
            From `detect_faces` on the same picture.
        """
        levels = pyramid(image)
        crop = face.crop
        for _ in range(2):
            points, _ = self._mesh_on(levels, [crop])
            crop = _crop_of_landmarks(points.mean(axis=0))
        crops = [crop.moved(*augmentation) for augmentation in AUGMENTATIONS]
        points, logit = self._mesh_on(levels, crops)
        # The median is robust against a crop on which the mesh jumped, the mean
        # is quieter: the mean of those near the median.
        middle = np.median(points, axis=0)
        away = np.linalg.norm(points - middle, axis=2)
        near = away <= 3 * np.median(away, axis=0) + 1e-3 * crop.side
        weight = near / near.sum(axis=0)
        mean = np.einsum("kf,kfc->fc", weight, points)
        rest = points - mean
        # A shift of the whole face is the crop's, not the landmark's.
        rest -= rest.mean(axis=1, keepdims=True)
        spread = np.einsum("kf,kfc->f", weight, rest**2)
        score = float(_sigmoid(float(np.median(logit))))
        return FaceLandmarks(mean, np.sqrt(spread / 2), score)

    def _propose(self, levels: list[np.ndarray], window: Crop) -> list[Proposal]:
        """What the detector takes for faces in a square window."""
        picture = _planes(sample(levels, window, DETECTOR_SIDE)) / 127.5 - 1.0
        boxes, logit = self._forward(self._detector, picture, DETECTOR_OUTPUTS)
        boxes = boxes.reshape(-1, 16).astype(float)
        return decode(boxes, _sigmoid(logit.reshape(-1)), self._anchors, window)

    def _forward(
        self, net: cv2.dnn.Net, picture: np.ndarray, outputs: Iterable[str]
    ) -> tuple[np.ndarray, ...]:
        # One picture at a time: a batch is no faster, and OpenCV sets the network
        # up anew whenever the number of pictures changes.
        with self._lock:
            net.setInput(picture)
            return tuple(net.forward(tuple(outputs)))

    def _verify(self, levels: list[np.ndarray], proposal: Proposal) -> Face | None:
        """The proposal turned upright by the mesh; None if it is no face."""
        crop = proposal.crop
        crops = [
            Crop(crop.centre, crop.side, crop.turn + quarter * np.pi / 2)
            for quarter in range(4)
        ]
        points, logit = self._run_mesh(levels, crops)
        crops = [
            _crop_of_landmarks(p)
            for p, value in zip(points, logit, strict=True)
            if value > MIN_FIRST_LOGIT
        ]
        if not crops:
            return None
        points, logit = self._run_mesh(levels, crops)
        best = int(logit.argmax())
        score = float(_sigmoid(logit[best]))
        if score < MIN_MESH_SCORE:
            return None
        return Face(_crop_of_landmarks(points[best]), score)

    def _mesh_on(
        self, levels: list[np.ndarray], crops: Sequence[Crop]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Landmarks (2 k, 468, 2) and logits on k crops and their mirror images."""
        return self._run_mesh(levels, crops, both=True)

    def _run_mesh(
        self, levels: list[np.ndarray], crops: Sequence[Crop], both: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        pictures = [sample(levels, crop, MESH_SIDE) for crop in crops]
        if both:
            pictures += [picture[:, ::-1] for picture in pictures]
        found = [
            self._forward(self._mesh, _planes(picture) / 255, MESH_OUTPUTS)
            for picture in pictures
        ]
        points = np.stack([p.reshape(468, 3)[:, :2] for p, _ in found]).astype(float)
        logit = np.array([float(value.reshape(-1)[0]) for _, value in found])
        points = points.reshape(-1, len(crops), 468, 2)
        if both:
            points[1, ..., 0] = MESH_SIDE - 1 - points[1, ..., 0]
            points[1] = points[1][:, self._mirror]
        # The mesh counts pixel centres at integers: so read, its mean error is
        # smallest, and so the template's landmarks were measured.
        placed = [
            crop.to_image(points[half, k] + 0.5, MESH_SIDE)
            for half in range(len(points))
            for k, crop in enumerate(crops)
        ]
        return np.stack(placed), logit


def _sigmoid(logit: np.ndarray | float) -> np.ndarray:
    return 1 / (1 + np.exp(-np.clip(np.asarray(logit, float), -80, 80)))


def _planes(picture: np.ndarray) -> np.ndarray:
    """(h, w, 3) uint8 -> (1, 3, h, w) float32."""
    return np.ascontiguousarray(picture.transpose(2, 0, 1)[None], np.float32)


def _crop_of_landmarks(points: np.ndarray) -> Crop:
    """The square about the landmarks, as upright as the eyes."""
    turn = direction(points[LEFT_EYE_OUTER] - points[RIGHT_EYE_OUTER])
    axes = Crop(np.zeros(2), 1.0, turn).axes()
    upright = points @ axes
    low, high = upright.min(axis=0), upright.max(axis=0)
    side = float((high - low).max()) * CROP_MARGIN
    return Crop(axes @ ((low + high) / 2), max(side, 1.0), turn)
