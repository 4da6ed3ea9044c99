"""One photo to its faces: read, found, measured, judged and cut out.

Landmarks that are given win over a landmark file beside the photo, which wins over the
detector.  A photo of no use becomes a `PhotoFailure` with a sentence.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from .._types import Array32, Picture8
from ..camera.linear_pose import linear_pose
from ..errors import PhotoFailure, ReconstructionError
from ..images.frames import ALIKE, thumbnail
from ..images.mask_file import judge_mask, mask_file_beside, with_mask
from ..images.photo import Photo, cut
from ..images.read import read_photo
from ..progress import CheckCancelled, never_cancelled
from ..settings import Settings
from ..surface.template import Template
from .drawn import looks_drawn
from .face_mesh import FaceMesh
from .face_models import ModelFiles
from .face_selection import Candidate
from .landmarks import (
    MAX_WEIGHT,
    LandmarkFileError,
    Landmarks,
    NotLandmarksError,
    landmark_file_beside,
    read_landmarks,
)
from .plausibility import fit_landmarks, judge_fit, outside
from .quality import judge_quality

# The cut-out is the box of all the face's landmarks, so much larger.
BOX_FACTOR = 1.45
MAX_SIDE = 1024
MAX_FACES = 6
# A face with more of its landmarks outside the picture gets a note.
CUT_OFF = 0.02
# Landmarks whose augmentations scatter by this part of the eye distance weigh half.
HALF_WEIGHT_SIGMA = 0.02
# Half of a file's landmarks lie farther than this from those of every face that is
# seen, in parts of the eye distance. Of pairs of example photos, 50 of 56 lie so far
# from each other.
ELSEWHERE = 0.12


class CandidateReader:
    """Reads photos one after another, and remembers which it has seen.

    Parameters
    ----------
    template : Template
    settings : Settings
        Used are ``landmarks`` (the scheme) and ``detector`` (whether to detect).
    given : mapping of photo name to Landmarks
        Win over files and over the detector.
    models : ModelFiles, optional
        Files of the networks; by default those that are found.
    masks : mapping of photo name to (h, w) float32 array, optional
        Win over mask files; see `mask_file.read_mask`.

    Attributes
    ----------
    hashes : dict of str to str
        SHA-256 of each photo that was read: of its file, or of its pixels.
    originals : dict of str to str
        Of each photo that looks like one that was read before: the name of that one.
    """

    def __init__(
        self,
        template: Template,
        settings: Settings,
        given: Mapping[str, Landmarks],
        models: ModelFiles | None = None,
        masks: Mapping[str, Array32] | None = None,
    ) -> None:
        self.template = template
        self.scheme = settings.landmarks
        self.detect = settings.detector
        self.given = given
        self.models = models
        self.masks = masks or {}
        self.mesh: FaceMesh | None = None
        self.names: dict[str, str] = {}  # digest of the pixels -> first photo
        self.looks: list[tuple[str, Picture8]] = []  # of each photo, very small
        self.hashes: dict[str, str] = {}
        self.originals: dict[str, str] = {}

    def read(
        self,
        source: str | os.PathLike | np.ndarray | Photo,
        name: str,
        check_cancelled: CheckCancelled,
    ) -> tuple[Candidate, ...] | PhotoFailure:
        """The faces of one photo, the largest first."""
        photo = source if isinstance(source, Photo) else read_photo(source, name)
        if isinstance(photo, PhotoFailure):
            return photo
        digest = _digest(photo.pixels)
        if digest in self.names:
            return PhotoFailure(
                name,
                "duplicate",
                f"{name} is the same picture as {self.names[digest]}.",
            )
        self.hashes[name] = _file_hash(photo.path) or digest
        photo = with_mask(photo, self.masks.get(name))
        if isinstance(photo, PhotoFailure):
            return photo
        try:
            found = self._find(photo, check_cancelled)
        except LandmarkFileError as error:
            return PhotoFailure(name, "implausible", str(error))
        if isinstance(found, PhotoFailure):
            self.names[digest] = name
            return found
        misplaced = self._misplaced(photo, found[0])
        # Frames of videos, which come as photos, were chosen to differ.
        notes = [] if isinstance(source, Photo) else self._copied(photo)
        if misplaced:
            notes.append(
                "its landmark file marks another place than the face that is seen"
            )
        judged = (self._judge(photo, landmarks, notes) for landmarks in found)
        faces = tuple(replace(face, misplaced=misplaced) for face in judged)
        # A copy with files of its own, or with none, may be of use where this photo is
        # left out for its mask or its landmark file.
        helped = photo.mask is not None or found[0].source == "file"
        if not helped or faces[0].failure is None:
            self.names[digest] = name
        return faces

    def _copied(self, photo: Photo) -> list[str]:
        """A note if the photo looks like one that was read before."""
        look = thumbnail(photo.bytes8())
        same = (
            name
            for name, other in self.looks
            if np.abs(look.astype(int) - other).mean() < ALIKE
        )
        first = next(same, None)
        self.looks.append((photo.name, look))
        if first is None:
            return []
        self.originals[photo.name] = first
        return [f"looks like a copy of {first}"]

    def _misplaced(self, photo: Photo, given: Landmarks) -> bool:
        """Whether landmarks of a file lie on no face that the detector sees."""
        if given.source != "file" or not self.detect:
            return False
        try:
            seen = self._detect(photo, never_cancelled)
        except ReconstructionError:  # no models: nothing can be said
            return False
        indices = self.template.schemes[given.scheme]
        known = self.template.landmark_reliable[indices] & (given.weight > 0)
        size = fit_landmarks(
            self.template, given.points, given.scheme, given.weight
        ).eye_distance
        away = [
            np.median(
                np.linalg.norm(face.points[indices] - given.points, axis=1)[known]
            )
            for face in seen
            if known.any()
        ]
        return bool(away) and min(away) > ELSEWHERE * size

    def _find(
        self, photo: Photo, check_cancelled: CheckCancelled
    ) -> list[Landmarks] | PhotoFailure:
        """Landmarks of all faces of a photo, from wherever they come."""
        name = photo.name
        if name in self.given:
            given = self.given[name]
            weighed = (given.weight >= 0) & (given.weight <= MAX_WEIGHT)
            if not np.isfinite(given.points).all() or not weighed.all():
                return PhotoFailure(
                    name,
                    "implausible",
                    f"The landmarks given for {name} are not all finite numbers "
                    f"with weights from 0 to {MAX_WEIGHT:g}; correct or remove them.",
                )
            return [replace(given, photo=name)]
        beside = landmark_file_beside(photo.path) if photo.path else None
        if beside is not None:
            with contextlib.suppress(NotLandmarksError):
                return [read_landmarks(beside, name, photo.size)]
        if not self.detect:
            return PhotoFailure(
                name,
                "no_face",
                f"{name} has no landmark file beside it, and the detector is "
                "switched off; add a file or switch it on.",
            )
        found = self._detect(photo, check_cancelled)
        if not found:
            return PhotoFailure(
                name,
                "no_face",
                f"No face was found in {name}; use a photo that shows the face from "
                "the front or half from the side.",
            )
        return [replace(item, faces=len(found)) for item in found]

    def _detect(self, photo: Photo, check_cancelled: CheckCancelled) -> list[Landmarks]:
        if self.mesh is None:
            self.mesh = FaceMesh(self.models, self.template.landmark_mirror)
        image = photo.bytes8()
        faces = self.mesh.detect_faces(image, check_cancelled)
        found = []
        for face in sorted(faces, key=lambda f: -f.side)[:MAX_FACES]:
            mesh = self.mesh.landmarks(image, face)
            points = photo.to_original(mesh.points)
            sigma = mesh.sigma / photo.window[2]
            size = fit_landmarks(
                self.template, points, "468", np.ones(468)
            ).eye_distance
            weight = 1 / (1 + (sigma / (HALF_WEIGHT_SIGMA * size)) ** 2)
            found.append(Landmarks(photo.name, "468", points, weight, score=mesh.score))
        return found

    def _reduced(self, landmarks: Landmarks) -> Landmarks:
        """The landmarks of the scheme that is asked for."""
        if self.scheme == landmarks.scheme or landmarks.scheme != "468":
            return landmarks
        return landmarks.subset(self.scheme, self.template.schemes[self.scheme])

    def _no_pose(self, landmarks: Landmarks) -> PhotoFailure | None:
        """A failure if the usable landmarks leave the pose open, or None."""
        indices = self.template.schemes[landmarks.scheme]
        reliable = self.template.landmark_reliable[indices]
        weight = np.where(reliable, landmarks.weight, 0.0)
        xyz = self.template.landmark_xyz[indices]
        pose = linear_pose(landmarks.points, xyz, weight, name=landmarks.photo)
        return pose if isinstance(pose, PhotoFailure) else None

    def _judge(self, photo: Photo, found: Landmarks, notes: Sequence[str]) -> Candidate:
        """The cut-out of one face, and whether it is of use."""
        landmarks = self._reduced(found)
        fit = fit_landmarks(
            self.template, landmarks.points, landmarks.scheme, landmarks.weight
        )
        failure = judge_fit(fit, landmarks, photo.size)
        if failure is None:
            failure = self._no_pose(landmarks)
        if failure is None:
            failure = judge_mask(photo, found.points)
        xy = landmarks.points
        if failure is None:
            # A scheme without forehead still gets a cut-out with one: the
            # template's landmarks by the fit.
            xy = np.concatenate([xy, fit.project(self.template.landmark_xyz)])
        low, high = xy.min(axis=0), xy.max(axis=0)
        centre, half = (low + high) / 2, BOX_FACTOR * (high - low).max() / 2
        part = cut(photo, np.concatenate([centre - half, centre + half]), MAX_SIDE)
        if failure is None:
            failure = judge_quality(part, landmarks, fit)
        drawn = failure is None and looks_drawn(part, landmarks, fit)
        notes = [*(["looks drawn or painted"] if drawn else []), *notes]
        cut_off = outside(found, photo.size)
        if cut_off > CUT_OFF:
            part_of_it = f"{100 * cut_off:.0f} % of it is outside"
            notes.append(f"cut by the picture's edge: {part_of_it}")
        if notes:
            landmarks = replace(landmarks, note="; ".join(notes))
        return Candidate(part, landmarks, fit, failure, found, drawn)


def files_beside(photo: str | os.PathLike) -> tuple[Path, ...]:
    """Landmark file and mask file of a photo, as far as they are there."""
    found = (landmark_file_beside(photo), mask_file_beside(photo))
    return tuple(path for path in found if path is not None)


def _digest(pixels: np.ndarray) -> str:
    digest = hashlib.sha256(repr((pixels.shape, pixels.dtype.str)).encode())
    digest.update(np.ascontiguousarray(pixels).data)
    return digest.hexdigest()


def _file_hash(path: Path | None) -> str | None:
    """SHA-256 of a file; None without one that can be read."""
    if path is None:
        return None
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return None
