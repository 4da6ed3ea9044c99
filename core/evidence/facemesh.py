"""Faces and 468 landmarks in a picture, by two small networks.

The networks are MediaPipe's (Apache-2.0): BlazeFace short range, which wants a
128-pixel picture, and Face Mesh, which wants a 192-pixel upright crop of one
face. OpenCV's DNN module runs them. Round them stands what makes them good
enough to measure with: a pyramid of windows for small faces, rotations for
lying ones, a crop that is aligned again from its own landmarks, and the average
over several crops and their mirror images.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ..errors import ReconstructionError

DETECTOR_FILE = "face_detection_short_range.tflite"
MESH_FILE = "face_landmark.tflite"

DETECTOR_SIDE = 128
MESH_SIDE = 192
# Corners of the eyes: the crop is turned until the line 33-263 is level.
RIGHT_EYE_OUTER, LEFT_EYE_OUTER = 33, 263

SCORE_WHOLE = 0.5
# In tiles there is more to mistake for a face, so they must be surer.
SCORE_TILE = 0.7
OVERLAP = 0.3
CROP_MARGIN = 1.5

# Crops of the average: shift right and down, and scale, in parts of the crop.
# The set is its own mirror image, which makes the average exactly equivariant.
AUGMENTATIONS = (
    (0.0, 0.0, 1.0),
    (-0.03, 0.0, 1.0),
    (0.03, 0.0, 1.0),
    (0.0, -0.025, 1.08),
    (0.0, 0.025, 0.93),
)


@dataclass(frozen=True)
class ModelFiles:
    """Where the two networks lie."""

    detector: Path
    mesh: Path


@dataclass(frozen=True, eq=False)
class Face:
    """A detected face.

    Parameters
    ----------
    box : (4,) array
        x0, y0, x1, y1 in pixels.
    keypoints : (6, 2) array
        Right eye, left eye, nose tip, mouth, right ear, left ear (the
        subject's right and left), pixels.
    score : float
        In [0, 1].
    """

    box: np.ndarray
    keypoints: np.ndarray
    score: float

    @property
    def side(self) -> float:
        """Longer side of the box in pixels."""
        return float(max(self.box[2] - self.box[0], self.box[3] - self.box[1]))


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
        files = models or find_models()
        self._mirror = np.asarray(mirror, int)
        self._lock = threading.Lock()
        self._anchors = _anchors()
        self._detector = _load(files.detector, ("regressors", "classificators"))
        self._mesh = _load(files.mesh, ("conv2d_21", "conv2d_31"))

    def detect_faces(self, image: np.ndarray) -> tuple[Face, ...]:
        """Faces in a picture, the surest first.

        Parameters
        ----------
        image : (h, w, 3) uint8 array
            RGB.
        """
        levels = _pyramid(image)
        h, w = image.shape[:2]
        # The whole picture and its quarters always; what is finer, wider or
        # turned only while nothing has been found.
        faces = self._search(levels, _windows(w, h, (1, 2)), 0.0)
        if not faces:
            faces = self._search(levels, _windows(w, h, (0.5, 0.75)), 0.0)
        if not faces:
            for angle in (90, -90, 180, 45, -45, 135, -135):
                faces += self._search(levels, _windows(w, h, (0.75, 1)), angle)
            faces = _suppress(faces)
        level = 4
        while not faces and max(w, h) / level >= DETECTOR_SIDE and level <= 16:
            faces = self._search(levels, _windows(w, h, (level,)), 0.0)
            level *= 2
        if not faces:
            for angle in (90, -90, 180):
                faces += self._search(levels, _windows(w, h, (2,)), angle)
            faces = _suppress(faces)
        return tuple(sorted(faces, key=lambda face: -face.score))

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
        levels = _pyramid(image)
        crop = _crop_of_face(face)
        for _ in range(2):
            points, _ = self._mesh_on(levels, [crop])
            crop = _crop_of_landmarks(points.mean(axis=0))
        crops = [crop.moved(*augmentation) for augmentation in AUGMENTATIONS]
        points, scores = self._mesh_on(levels, crops)
        # The median is robust against a crop on which the mesh jumped, the mean
        # is quieter: the mean of those near the median.
        middle = np.median(points, axis=0)
        away = np.linalg.norm(points - middle, axis=2)
        near = away <= 3 * np.median(away, axis=0) + 1e-3 * crop.side
        weight = near / near.sum(axis=0)
        mean = np.einsum("kf,kfc->fc", weight, points)
        spread = np.einsum("kf,kfc->f", weight, (points - mean) ** 2)
        return FaceLandmarks(mean, np.sqrt(spread / 2), float(np.median(scores)))

    def _search(
        self, levels: list[np.ndarray], windows: Sequence[_Crop], angle: float
    ) -> list[Face]:
        faces: list[Face] = []
        turn = np.deg2rad(angle)
        for start in range(0, len(windows), 16):
            part = [
                _Crop(window.centre, window.side, turn)
                for window in windows[start : start + 16]
            ]
            batch = [_sample(levels, window, DETECTOR_SIDE) for window in part]
            blob = np.stack(batch).astype(np.float32) / 127.5 - 1.0
            with self._lock:
                self._detector.setInput(
                    np.ascontiguousarray(blob.transpose(0, 3, 1, 2))
                )
                boxes, scores = self._detector.forward(("regressors", "classificators"))
            boxes = _unbatched(boxes.reshape(-1, 16), len(part))
            scores = _unbatched(scores.reshape(-1, 1), len(part))[..., 0]
            whole = windows[0].side
            for window, raw, logit in zip(part, boxes, scores, strict=True):
                least = SCORE_WHOLE if window.side > 0.9 * whole else SCORE_TILE
                faces += self._decode(raw, logit, window, least)
        return _suppress(faces)

    def _decode(
        self, raw: np.ndarray, logit: np.ndarray, window: _Crop, least: float
    ) -> list[Face]:
        score = 1 / (1 + np.exp(-np.clip(logit, -80, 80).astype(float)))
        keep = np.flatnonzero(score >= least)
        if not keep.size:
            return []
        raw, score = raw[keep].astype(float), score[keep]
        shift = self._anchors[keep] * DETECTOR_SIDE
        centre = raw[:, :2] + shift
        half = raw[:, 2:4] / 2
        boxes = np.concatenate([centre - half, centre + half], axis=1)
        points = raw[:, 4:].reshape(-1, 6, 2) + shift[:, None]
        faces = []
        for group in _groups(boxes, score):
            # Weighted suppression: overlapping answers are averaged.
            weight = score[group] / score[group].sum()
            box = weight @ boxes[group]
            corners = box[[[0, 1], [2, 1], [2, 3], [0, 3]]]
            corners = window.to_image(corners, DETECTOR_SIDE)
            keypoints = np.einsum("k,kpc->pc", weight, points[group])
            faces.append(
                Face(
                    np.concatenate([corners.min(axis=0), corners.max(axis=0)]),
                    window.to_image(keypoints, DETECTOR_SIDE),
                    float(score[group].max()),
                )
            )
        return faces

    def _mesh_on(
        self, levels: list[np.ndarray], crops: Sequence[_Crop]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Landmarks (2 k, 468, 2) and scores on k crops and their mirror images."""
        upright = np.stack([_sample(levels, crop, MESH_SIDE) for crop in crops])
        blob = np.concatenate([upright, upright[:, :, ::-1]]).astype(np.float32) / 255
        with self._lock:
            self._mesh.setInput(np.ascontiguousarray(blob.transpose(0, 3, 1, 2)))
            points, logit = self._mesh.forward(("conv2d_21", "conv2d_31"))
        points = points.reshape(2, len(crops), 468, 3)[..., :2].astype(float)
        points[1, ..., 0] = MESH_SIDE - 1 - points[1, ..., 0]
        points[1] = points[1][:, self._mirror]
        # The mesh counts pixel centres at integers: so read, its mean error is
        # smallest, and so the template's landmarks were measured.
        placed = [
            crop.to_image(points[half, k] + 0.5, MESH_SIDE)
            for half in range(2)
            for k, crop in enumerate(crops)
        ]
        score = 1 / (1 + np.exp(-np.clip(logit.reshape(-1), -80, 80).astype(float)))
        return np.stack(placed), score


@dataclass(frozen=True, eq=False)
class _Crop:
    """A square of the picture: centre (2,) and side in pixels, turn in radians."""

    centre: np.ndarray
    side: float
    turn: float

    def axes(self) -> np.ndarray:
        """(2, 2): columns are the crop's x and y axis in the picture."""
        c, s = np.cos(self.turn), np.sin(self.turn)
        return np.array([[c, -s], [s, c]])

    def moved(self, right: float, down: float, scale: float) -> _Crop:
        shift = self.axes() @ (right * self.side, down * self.side)
        return _Crop(self.centre + shift, self.side * scale, self.turn)

    def to_image(self, xy: np.ndarray, size: int) -> np.ndarray:
        """Network coordinates, [0, size] from edge to edge -> picture pixels."""
        return self.centre + (xy / size - 0.5) * self.side @ self.axes().T


def _load(path: Path, outputs: tuple[str, str]) -> cv2.dnn.Net:
    try:
        net = cv2.dnn.readNetFromTFLite(str(path))
        names = net.getUnconnectedOutLayersNames()
    except (cv2.error, OSError):
        names = ()
    if set(names) != set(outputs):
        raise ReconstructionError(
            f"{path} is not the expected model file; remove it and fetch it again "
            "by `python3 dev.py setup`."
        )
    return net


def _unbatched(rows: np.ndarray, count: int) -> np.ndarray:
    """(count, 896, c) from (count * 896, c).

    The network joins its two grids after flattening them for one picture; with
    several pictures the first grids of all come before the second grids of all.
    """
    first = len(rows) * 512 // 896
    parts = (rows[:first], rows[first:])
    return np.concatenate([p.reshape(count, -1, rows.shape[1]) for p in parts], axis=1)


def _anchors() -> np.ndarray:
    """(896, 2) anchor centres of BlazeFace short range, in [0, 1]."""
    parts = []
    for cells, repeat in ((16, 2), (8, 6)):
        at = (np.arange(cells) + 0.5) / cells
        grid = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
        parts.append(np.repeat(grid, repeat, axis=0))
    return np.concatenate(parts)


def _pyramid(image: np.ndarray) -> list[np.ndarray]:
    """The picture and its halvings, each the mean of 2 x 2 of the last."""
    levels = [np.ascontiguousarray(image)]
    while max(levels[-1].shape[:2]) > DETECTOR_SIDE:
        last = levels[-1]
        h, w = last.shape[:2]
        if h % 2 or w % 2:
            # An odd edge is repeated so that each level is exactly half.
            last = cv2.copyMakeBorder(last, 0, h % 2, 0, w % 2, cv2.BORDER_REPLICATE)
        size = (last.shape[1] // 2, last.shape[0] // 2)
        levels.append(cv2.resize(last, size, interpolation=cv2.INTER_AREA))
    return levels


def _sample(levels: list[np.ndarray], crop: _Crop, size: int) -> np.ndarray:
    """The crop as (size, size, 3) uint8; black outside the picture."""
    step = crop.side / size
    level = int(np.clip(np.floor(np.log2(max(step, 1e-9))), 0, len(levels) - 1))
    axes = crop.axes() * step
    # Crop pixel i lies at i + 0.5 from the crop's edge; the same half pixel
    # stands between a level's pixels and the original's.
    corner = crop.centre + axes @ np.full(2, 0.5 - size / 2)
    corner = (corner + 0.5) / 2**level - 0.5
    matrix = np.column_stack([axes / 2**level, corner])
    return cv2.warpAffine(
        levels[level],
        matrix,
        (size, size),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_CONSTANT,
    )


def _windows(w: int, h: int, levels: Sequence[float]) -> list[_Crop]:
    """Square windows: level 1 is the whole picture, 2 its overlapping halves..."""
    windows = []
    for level in levels:
        side = max(w, h) / level
        for y in _centres(h, side):
            for x in _centres(w, side):
                windows.append(_Crop(np.array([x, y]), side, 0.0))
    return windows


def _centres(length: int, side: float) -> Iterator[float]:
    """Centres along one edge, so that neighbours overlap by half or more."""
    if side >= length:
        yield (length - 1) / 2
        return
    count = int(np.ceil((length - side) / (side / 2))) + 1
    for k in range(count):
        yield side / 2 - 0.5 + k * (length - side) / (count - 1)


def _overlap(box: np.ndarray, boxes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Intersection over union, and over the smaller box."""
    low = np.maximum(box[:2], boxes[:, :2])
    high = np.minimum(box[2:], boxes[:, 2:])
    common = np.prod(np.clip(high - low, 0, None), axis=1)
    area = np.prod(box[2:] - box[:2])
    areas = np.prod(boxes[:, 2:] - boxes[:, :2], axis=1)
    tiny = 1e-12
    return (
        common / np.maximum(area + areas - common, tiny),
        common / np.maximum(np.minimum(area, areas), tiny),
    )


def _groups(boxes: np.ndarray, score: np.ndarray) -> Iterator[np.ndarray]:
    left = np.argsort(-score, kind="stable")
    while left.size:
        union, _ = _overlap(boxes[left[0]], boxes[left])
        same = union > OVERLAP
        same[0] = True
        yield left[same]
        left = left[~same]


def _suppress(faces: list[Face]) -> list[Face]:
    """Of answers from several windows to the same face, the surest.

    A tile that cuts a face shows a smaller box inside the true one, hence the
    second test; the larger of two sure answers is then the whole face.
    """
    faces = sorted(faces, key=lambda f: -(round(f.score, 1) + 1e-6 * f.side))
    kept: list[Face] = []
    for face in faces:
        if kept:
            boxes = np.stack([other.box for other in kept])
            union, smaller = _overlap(face.box, boxes)
            if (union > OVERLAP).any() or (smaller > 0.6).any():
                continue
        kept.append(face)
    return kept


def _crop_of_face(face: Face) -> _Crop:
    line = face.keypoints[1] - face.keypoints[0]
    turn = float(np.arctan2(line[1], line[0]))
    return _Crop((face.box[:2] + face.box[2:]) / 2, face.side * CROP_MARGIN, turn)


def _crop_of_landmarks(points: np.ndarray) -> _Crop:
    """The square about the landmarks, as upright as the eyes."""
    line = points[LEFT_EYE_OUTER] - points[RIGHT_EYE_OUTER]
    turn = float(np.arctan2(line[1], line[0]))
    c, s = np.cos(turn), np.sin(turn)
    axes = np.array([[c, -s], [s, c]])
    upright = points @ axes
    low, high = upright.min(axis=0), upright.max(axis=0)
    side = float((high - low).max()) * CROP_MARGIN
    return _Crop(axes @ ((low + high) / 2), max(side, 1.0), turn)
