"""A known person in new photos: where the head is, and what the face does."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .camera.camera import Camera
from .errors import PhotoFailure, ReconstructionError
from .formats.face_file import SavedFace
from .images.photo import Photo
from .landmarks.landmarks import Landmarks
from .prepare import collect_photos
from .progress import Progress
from .reconstruct import motion_options
from .result import Reconstruction
from .settings import Settings
from .solve.known_face import KnownFace, estimate_pose_expression, personalise_landmarks
from .solve.known_face_shading import ShadingOptions, Skin, refine_pose_expression, skin
from .solve.motion import LandmarkObservations
from .surface.bspline import BSplineSurface
from .surface.template import Template, load_template
from .threads import one_blas_thread

Array = NDArray[np.float64]


@dataclass(frozen=True)
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
    photos: str | os.PathLike | np.ndarray | Sequence,
    face: Reconstruction | SavedFace,
    settings: Settings | None = None,
    *,
    template: Template | None = None,
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
    face : Reconstruction or SavedFace
        Of the same person; its shape stays as it is.
    settings : Settings, optional
        By default those of the face.
    template : Template, optional
        That the face was made of, if it was not the bundled one.
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
    settings = settings or _settings_of(face)
    if template is None:
        template = face.template if isinstance(face, Reconstruction) else None
    model = (template or load_template()).resampled(face.surface.shape)
    collection = collect_photos(
        _sources(photos),
        settings,
        progress,
        template=model,
        landmarks=landmarks,
        ignore=ignore,
    )
    options = motion_options(settings)
    if not settings.perspective:
        options = replace(options, distance_mm=float("inf"))
    known = personalise_landmarks(
        face.surface, model, face.cameras, _seen(face, model), options
    )
    index = known.index
    at = None if settings.method == "motion" else _skin(face, known)
    shading = ShadingOptions(
        noise=settings.intensity_noise, independence=settings.independence
    )
    found: list[TrackedPhoto] = []
    failures = list(collection.failures)
    pairs = zip(collection.photos, collection.landmarks, strict=True)
    for photo, marks in pairs:
        everything = _on_template([marks], model)
        pixels, weight = (x[0][index] for x in everything)
        centre = ((photo.size[0] - 1) / 2, (photo.size[1] - 1) / 2)
        pose = estimate_pose_expression(
            known, pixels, weight, centre, options, photo.name
        )
        if isinstance(pose, PhotoFailure):
            failures.append(pose)
            continue
        if at is not None:
            pose = refine_pose_expression(
                known, at, pose, photo, pixels, weight, options, shading
            )
        found.append(
            TrackedPhoto(
                photo.name,
                photo,
                marks,
                pose.camera,
                pose.expression,
                known.with_expression(pose.expression),
                pose.residual_mm,
            )
        )
    if not found:
        raise ReconstructionError(failures[0].reason)
    return Tracking(tuple(found), tuple(failures))


def _sources(
    photos: str | os.PathLike | np.ndarray | Sequence,
) -> str | os.PathLike | Sequence:
    """One photo is a sequence of one."""
    if isinstance(photos, np.ndarray):
        return [photos] if photos.ndim == 3 else list(photos)
    if isinstance(photos, str | os.PathLike) and Path(photos).is_file():
        return [photos]
    return photos


def _settings_of(face: Reconstruction | SavedFace) -> Settings:
    if isinstance(face.settings, Settings):
        return face.settings
    try:
        return Settings.from_dict(face.settings)
    except ValueError:  # a file of another version
        return Settings()


def _skin(face: Reconstruction | SavedFace, known: KnownFace) -> Skin | None:
    """Albedo of the face, where it is stored."""
    if isinstance(face, SavedFace):
        uv, albedo = (face.photometric.get(name) for name in ("uv", "albedo"))
    else:
        uv, albedo = (
            getattr(face.photometric, name, None) for name in ("uv", "albedo")
        )
    if uv is None or albedo is None:
        return None
    return skin(known, uv, albedo.mean(1))


def _seen(
    face: Reconstruction | SavedFace, template: Template
) -> LandmarkObservations | None:
    """Landmarks of the photos that the face was made of, where they are stored."""
    if isinstance(face, SavedFace):
        parts = zip(
            face.camera_photos,
            face.landmark_schemes,
            face.landmark_points,
            face.landmark_weights,
            strict=False,
        )
        marks = [Landmarks(*part) for part in parts]
    else:
        marks = list(face.landmarks)
    if not marks or len(marks) != len(face.cameras):
        return None
    index = np.flatnonzero(template.landmark_reliable)
    pixels, weight = _on_template(marks, template)
    return LandmarkObservations(pixels[:, index], weight[:, index], index)


def _on_template(marks: Sequence[Landmarks], template: Template) -> tuple[Array, Array]:
    """Landmarks on the numbering of the template; weight 0 where there is none."""
    count = len(template.landmark_uv)
    pixels, weight = np.zeros((len(marks), count, 2)), np.zeros((len(marks), count))
    for i, mark in enumerate(marks):
        which = template.schemes[mark.scheme]
        pixels[i, which], weight[i, which] = mark.points, mark.weight
    return pixels, weight
