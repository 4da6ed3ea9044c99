"""From a folder of photos to cut-outs with landmarks: all the evidence there is.

Each photo is read once; the faces in it are found, measured and judged, and the
photo is cut down to them before the next one is read. Which of several faces is
the folder's person is decided at the end, when all photos have been seen, and so
is which photos show somebody else. A photo that is of no use becomes a
`PhotoFailure` with a sentence.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .camera.linear_pose import linear_pose
from .errors import PhotoFailure, ReconstructionError
from .identity.same_person import separate_identities
from .images.folder import list_photos
from .images.photo import Photo, cut
from .images.read import read_photo
from .landmarks.face_mesh import FaceMesh
from .landmarks.face_models import ModelFiles
from .landmarks.face_selection import Candidate, choose_faces
from .landmarks.landmarks import (
    LandmarkFileError,
    Landmarks,
    NotLandmarksError,
    landmark_file_beside,
    read_landmarks,
)
from .landmarks.plausibility import FaceFit, fit_face, judge_fit
from .landmarks.quality import judge_quality
from .progress import Progress, Step
from .settings import Settings
from .surface.template import Template, load_template

# The cut-out is the box of all the face's landmarks, so much larger.
BOX_FACTOR = 1.45
MAX_SIDE = 1024
MAX_FACES = 6
# Landmarks whose augmentations scatter by this part of the eye distance weigh half.
HALF_WEIGHT_SIGMA = 0.02


@dataclass(frozen=True, eq=False)
class PhotoCollection:
    """The photos that can be used, and why the others cannot.

    Parameters
    ----------
    photos : tuple of Photo
        Cut-outs.
    landmarks : tuple of Landmarks
        In the order of `photos`.
    failures : tuple of PhotoFailure
        The photos that are left out, in folder order.
    doubts : tuple of str
        Whether all photos show one person, in sentences; empty if they seem to.
    """

    photos: tuple[Photo, ...]
    landmarks: tuple[Landmarks, ...]
    failures: tuple[PhotoFailure, ...]
    identity_warnings: tuple[str, ...] = ()


def collect_photos(
    photos: str | os.PathLike | Sequence,
    settings: Settings | None = None,
    progress: Progress | None = None,
    *,
    template: Template | None = None,
    landmarks: Mapping[str, Landmarks] | None = None,
    ignore: Sequence[str] = (),
    models: ModelFiles | None = None,
) -> PhotoCollection:
    """Read photos, find the person's face in each and its landmarks.

    Landmarks given here win over a landmark file beside the photo, which wins
    over the detector.

    Parameters
    ----------
    photos : folder, or sequence of paths or (H, W, 3) arrays
    settings : Settings, optional
        Used are ``landmarks`` (the scheme), ``detector`` (whether to detect) and
        ``one_person`` (whether to leave strangers out).
    progress : callable, optional
        Called with a `Step` before and after each photo; its ``overall`` is the
        fraction of this function. May raise `Cancelled`.
    template : Template, optional
        By default the bundled one.
    landmarks : mapping of photo name to Landmarks, optional
    ignore : sequence of str
        Names of photos to leave out.
    models : ModelFiles, optional

    Raises
    ------
    ReconstructionError
        If there are no photos, no model files, no photo can be used, or no photo has
        a name of ``ignore``.
    """
    settings = settings or Settings()
    template = template or load_template()
    sources = _sources(photos)
    _check_names(ignore, [name for name, _ in sources])
    reader = _Reader(
        template,
        settings.landmarks,
        settings.detector,
        dict(landmarks or {}),
        models,
    )
    total = len(sources)
    outcome: list[tuple[Candidate, ...] | PhotoFailure] = []
    for done, (name, source) in enumerate(sources):

        def check_cancelled(done: int = done, name: str = name) -> None:
            _tell(progress, done, total, f"looking at {name}")

        check_cancelled()
        if name in ignore:
            outcome.append(PhotoFailure(name, "ignored", f"{name} is set aside."))
        else:
            outcome.append(reader.read(source, name, check_cancelled))
    chosen = choose_faces(outcome)
    identity_warnings: tuple[str, ...] = ()
    if settings.one_person:
        _tell(progress, total, total, "comparing the faces")
        chosen, identity_warnings = separate_identities(chosen)
    used = [item for item in chosen if isinstance(item, Candidate)]
    failures = tuple(item for item in chosen if isinstance(item, PhotoFailure))
    _tell(progress, total, total, f"{len(used)} of {total} photos can be used")
    if not used:
        raise ReconstructionError(_nothing(total, failures))
    return PhotoCollection(
        tuple(item.photo for item in used),
        tuple(item.landmarks for item in used),
        failures,
        identity_warnings,
    )


class _Reader:
    """What stays the same from photo to photo, and the photos seen so far."""

    def __init__(
        self,
        template: Template,
        scheme: str,
        detect: bool,
        given: dict[str, Landmarks],
        models: ModelFiles | None,
    ) -> None:
        self.template = template
        self.scheme = scheme
        self.detect = detect
        self.given = given
        self.models = models
        self.mesh: FaceMesh | None = None
        self.seen: dict[bytes, str] = {}

    def read(
        self,
        source: str | os.PathLike | np.ndarray,
        name: str,
        check_cancelled: Callable[[], None],
    ) -> tuple[Candidate, ...] | PhotoFailure:
        photo = read_photo(source, name)
        if isinstance(photo, PhotoFailure):
            return photo
        digest = _digest(photo.pixels)
        if digest in self.seen:
            return PhotoFailure(
                name, "duplicate", f"{name} is the same picture as {self.seen[digest]}."
            )
        self.seen[digest] = name
        try:
            found = self._find(photo, check_cancelled)
        except LandmarkFileError as error:
            return PhotoFailure(name, "implausible", str(error))
        if isinstance(found, PhotoFailure):
            return found
        return tuple(self._judge(photo, landmarks) for landmarks in found)

    def _find(
        self, photo: Photo, check_cancelled: Callable[[], None]
    ) -> list[Landmarks] | PhotoFailure:
        name = photo.name
        if name in self.given:
            given = self.given[name]
            if not np.isfinite(given.points).all() or not (given.weight >= 0).all():
                return PhotoFailure(
                    name,
                    "implausible",
                    f"The landmarks given for {name} are not all finite numbers; "
                    "correct or remove them.",
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
        if self.mesh is None:
            self.mesh = FaceMesh(self.models, self.template.landmark_mirror)
        image = photo.bytes8()
        faces = self.mesh.detect_faces(image, check_cancelled)
        found = []
        for face in sorted(faces, key=lambda f: -f.side)[:MAX_FACES]:
            mesh = self.mesh.landmarks(image, face)
            points = photo.to_original(mesh.points)
            sigma = mesh.sigma / photo.window[2]
            size = self._fit(points, "468", np.ones(468)).eye_distance
            weight = 1 / (1 + (sigma / (HALF_WEIGHT_SIGMA * size)) ** 2)
            found.append(Landmarks(name, "468", points, weight, score=mesh.score))
        if not found:
            return PhotoFailure(
                name,
                "no_face",
                f"No face was found in {name}; use a photo that shows the face from "
                "the front or half from the side.",
            )
        return [replace(item, faces=len(found)) for item in found]

    def _reduced(self, landmarks: Landmarks) -> Landmarks:
        if self.scheme == landmarks.scheme or landmarks.scheme != "468":
            return landmarks
        return landmarks.subset(self.scheme, self.template.schemes[self.scheme])

    def _fit(self, points: np.ndarray, scheme: str, weight: np.ndarray) -> FaceFit:
        indices = self.template.schemes[scheme]
        reliable = self.template.landmark_reliable[indices] * weight
        return fit_face(
            self.template.landmark_xyz[indices],
            points,
            reliable,
            self.template.eye_distance,
        )

    def _no_pose(self, landmarks: Landmarks) -> PhotoFailure | None:
        """A failure if the usable landmarks leave the pose open, or None."""
        indices = self.template.schemes[landmarks.scheme]
        reliable = self.template.landmark_reliable[indices]
        weight = np.where(reliable, landmarks.weight, 0.0)
        xyz = self.template.landmark_xyz[indices]
        pose = linear_pose(landmarks.points, xyz, weight, name=landmarks.photo)
        return pose if isinstance(pose, PhotoFailure) else None

    def _judge(self, photo: Photo, found: Landmarks) -> Candidate:
        landmarks = self._reduced(found)
        fit = self._fit(landmarks.points, landmarks.scheme, landmarks.weight)
        failure = judge_fit(fit, landmarks, photo.size)
        if failure is None:
            failure = self._no_pose(landmarks)
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
        return Candidate(part, landmarks, fit, failure, found)


def _sources(
    photos: str | os.PathLike | Sequence,
) -> list[tuple[str, Path | np.ndarray]]:
    """Names, unlike each other, and paths or arrays."""
    if isinstance(photos, str | os.PathLike):
        return [(_shown(path.name), path) for path in list_photos(photos)]
    if isinstance(photos, np.ndarray) and _one_picture(photos):
        raise ReconstructionError(
            f"One picture of shape {photos.shape} was given in place of several; "
            "give a list of them, such as [picture, picture, picture]."
        )
    items = [p if isinstance(p, np.ndarray) else Path(p) for p in photos]
    if not items:
        raise ReconstructionError("No photos were given; give at least three.")
    names = [
        _shown(item.name) if isinstance(item, Path) else f"picture {i + 1}"
        for i, item in enumerate(items)
    ]
    count = Counter(names)
    taken: Counter[str] = Counter()
    for i, name in enumerate(names):
        if count[name] > 1:
            taken[name] += 1
            names[i] = f"{name} ({taken[name]})"
    return list(zip(names, items, strict=True))


def _one_picture(array: np.ndarray) -> bool:
    """Whether an array is a picture itself and not a stack of them."""
    return array.ndim == 2 or (array.ndim == 3 and array.shape[2] in (1, 3, 4))


def _check_names(ignore: Sequence[str], names: Sequence[str]) -> None:
    # A name with a slip would let the photo in, and the slip show after the work.
    for name in ignore:
        if name not in names:
            listed = ", ".join(names[:5])
            if len(names) > 5:
                listed += f" ... ({len(names)} photos)"
            raise ReconstructionError(
                f"There is no photo {name!r} to leave out; the names are {listed}."
            )


def _shown(name: str) -> str:
    """The name without bytes that are no text, so that it can be printed."""
    return name.encode("utf-8", "replace").decode("utf-8")


def _digest(pixels: np.ndarray) -> bytes:
    digest = hashlib.blake2b(repr((pixels.shape, pixels.dtype.str)).encode())
    digest.update(np.ascontiguousarray(pixels).data)
    return digest.digest()


def _tell(progress: Progress | None, done: int, total: int, message: str) -> None:
    if progress is not None:
        progress(Step("landmarks", done, total, done / total, message))


_REASONS = {
    "unreadable": "cannot be read",
    "too_large": "are too large",
    "no_face": "show no face that was found",
    "small_face": "show a face that is too small",
    "blurred": "are blurred",
    "dark": "are too dark",
    "bright": "are too bright",
    "implausible": "have landmarks that form no face",
    "other_person": "show somebody else",
    "ignored": "are set aside",
    "duplicate": "are duplicates",
}


def _nothing(total: int, failures: tuple[PhotoFailure, ...]) -> str:
    count = Counter(failure.code for failure in failures)
    reasons = ", ".join(f"{n} {_REASONS[code]}" for code, n in count.most_common())
    return (
        f"None of the {total} photos can be used: {reasons} "
        f"(first: {failures[0].reason}) Give sharp photos of one face."
    )
