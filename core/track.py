"""A known person in new photos: where the head is, and what the face does."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ._types import Array, Indices
from .camera.camera import Camera
from .camera.prior import CameraPrior
from .errors import PhotoFailure, ReconstructionError
from .images.photo import Photo
from .images.sources import Photos
from .kinds import CALLBACK, expect
from .landmarks.landmarks import Landmarks
from .landmarks.observations import believable_focal, observe_landmarks, principal_point
from .prepare import Inputs, collect_photos
from .progress import Progress
from .result import Reconstruction
from .settings import Settings
from .solve.known_face import (
    KnownFace,
    PhotoLandmarks,
    SourcePhotos,
    estimate_pose_expression,
    known_face,
)
from .solve.known_face_shading import (
    CAMERA_DAMPING,
    ShadingOptions,
    refine_pose_expression,
    skin_samples,
)
from .solve.motion import MotionOptions
from .surface.bspline import BSplineSurface
from .threads import one_blas_thread


@dataclass(frozen=True, eq=False)
class TrackedPhoto:
    """The known face in one photo.

    Attributes
    ----------
    name : str
    photo : Photo
        Cut-out.
    landmarks : Landmarks
    camera : Camera
        In the axes of the face that was looked for.
    expression : (k,) array
        Coefficients of the template's expression modes relative to that face, in
        standard deviations.
    surface : BSplineSurface
        The face with this expression.
    residual_mm : float
        Median distance between landmarks and their projection, mm at the head.
    """

    name: str
    photo: Photo
    landmarks: Landmarks
    camera: Camera
    expression: Array
    surface: BSplineSurface
    residual_mm: float


@dataclass(frozen=True)
class Tracking:
    """Result of `track`.

    Attributes
    ----------
    photos : tuple of TrackedPhoto
        In folder order.
    failures : tuple of PhotoFailure
        Photos in which the face was not found, and why.
    """

    photos: tuple[TrackedPhoto, ...]
    failures: tuple[PhotoFailure, ...]


@one_blas_thread()
def track(
    photos: Photos | np.ndarray,
    face: Reconstruction,
    settings: Settings | None = None,
    *,
    progress: Progress | None = None,
    landmarks: Mapping[str, Landmarks] | None = None,
    ignore: Sequence[str] = (),
) -> Tracking:
    """Find a known face in new photos: camera and expression of each.

    Landmarks first; then, if the face was made with its albedo and the method is not
    "motion", the intensities of the photo.

    Parameters
    ----------
    photos : folder, path, (H, W, 3) RGB array, or sequence of paths or arrays
    face : Reconstruction
        Of the same person, from `reconstruct` or `load`; its shape stays as it is.
    settings : Settings, optional
        By default those of the face.
    progress : callable, optional
        Receives a `Step` after each photo; may raise `Cancelled`.
    landmarks : mapping of photo name to Landmarks, optional
        Win over files and over the detector.
    ignore : sequence of str
        Names of photos that are not to be used.

    Returns
    -------
    Tracking

    Raises
    ------
    ReconstructionError
        If the face is in none of the photos.
    Cancelled
        Raised by ``progress``, passed on.
    """
    if not isinstance(face, Reconstruction):
        raise TypeError(
            "face must be a Reconstruction, from reconstruct() or load(), not "
            f"{type(face).__name__}."
        )
    expect(CALLBACK, "a function", progress=progress)
    settings = Settings.of(face.settings if settings is None else settings)
    inputs = Inputs(face.template, {} if landmarks is None else landmarks, ignore)
    collection = collect_photos(_sources(photos), settings, inputs, progress)
    distance_mm = settings.distance_from(face.settings.eye_distance_mm)
    options = MotionOptions.from_settings(settings, distance_mm)
    known = known_face(face.surface, face.template, options, _source_photos(face))
    found: list[TrackedPhoto] = []
    failures = list(collection.failures)
    for photo, marks in zip(collection.photos, collection.landmarks, strict=True):
        tracked = _track_photo(known, face, settings, options.camera, photo, marks)
        if isinstance(tracked, PhotoFailure):
            failures.append(tracked)
        else:
            found.append(tracked)
    if not found:
        raise ReconstructionError(failures[0].reason, failures)
    return Tracking(tuple(found), tuple(failures))


def _track_photo(
    known: KnownFace,
    face: Reconstruction,
    settings: Settings,
    prior: CameraPrior,
    photo: Photo,
    marks: Landmarks,
) -> TrackedPhoto | PhotoFailure:
    """The known face in one photo."""
    template = face.template
    pixels, weight = _on_index(known, marks, template.schemes[marks.scheme])
    focal_px = believable_focal(photo, pixels, known.landmarks_xyz, weight)
    centre = np.array(principal_point(photo))
    seen = PhotoLandmarks(pixels, weight, centre, photo.name, focal_px)
    pose = estimate_pose_expression(known, seen, prior)
    if isinstance(pose, PhotoFailure):
        return pose
    if face.photometric is not None and settings.method != "motion":
        albedo = face.photometric.albedo.mean(1)
        skin = skin_samples(known, face.photometric.uv, albedo)
        usual = ShadingOptions()
        size = face.settings.eye_distance_mm / Settings.eye_distance_mm
        shading = ShadingOptions(
            blurs_mm=tuple(size * blur for blur in usual.blurs_mm),
            noise=settings.intensity_noise,
            independence=settings.independence,
            camera=replace(prior, damping=CAMERA_DAMPING),
        )
        pose = refine_pose_expression(known, skin, pose, photo, seen, shading)
    return TrackedPhoto(
        photo.name,
        photo,
        marks,
        pose.camera,
        pose.expression,
        known.with_expression(pose.expression),
        pose.residual_mm,
    )


def _on_index(
    known: KnownFace, marks: Landmarks, which: Indices
) -> tuple[Array, Array]:
    """Pixels and weights of the landmarks that the known face has, (f, 2) and (f,)."""
    pixels, weight = np.zeros((468, 2)), np.zeros(468)
    pixels[which], weight[which] = marks.points, marks.weight
    return pixels[known.index], weight[known.index]


def _source_photos(face: Reconstruction) -> SourcePhotos | None:
    """The photos that the face was made of, where they are stored."""
    if not face.landmarks or len(face.landmarks) != len(face.cameras):
        return None
    seen = observe_landmarks(face.photos, face.landmarks, face.template)
    return SourcePhotos(face.cameras, seen, face.expressions)


def _sources(photos: Photos | np.ndarray) -> Photos:
    """One photo is a sequence of one."""
    if isinstance(photos, np.ndarray) and photos.ndim != 4:
        # Other shapes are refused in the words of `photo_sources`.
        return [photos] if photos.ndim == 3 else photos
    if isinstance(photos, str | os.PathLike) and Path(photos).is_file():
        return [photos]
    return photos
