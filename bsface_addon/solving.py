"""The core's work for the add-on; no Blender in here, so any thread may do it."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core.camera.coverage import shortcomings
from ..core.camera.linear_pose import linear_pose
from ..core.errors import ReconstructionError, memory_reported
from ..core.formats.face_file import face_bytes
from ..core.images.mask_file import decode_mask
from ..core.landmarks.all_faces import faces_in
from ..core.landmarks.candidates import files_beside
from ..core.landmarks.landmarks import Landmarks
from ..core.prepare import Inputs, as_template, collect_photos, make_problem
from ..core.problem import PhotoCollection
from ..core.progress import Clock, Progress, Step
from ..core.reconstruct import solve
from ..core.result import Reconstruction
from ..core.settings import Settings
from ..core.surface.template import Template, load_template
from ..core.texture.bake import Texture, bake_texture
from ..core.threads import one_blas_thread
from .maps import Map, all_maps
from .orientation import Turn, orientation
from .skin_pictures import measured
from .stored_facts import facts, landmark_text

if TYPE_CHECKING:
    from .request import Request

# Part of the whole time that the core's reconstruction takes; the rest paints.
SOLVE_SHARE = 0.85


@dataclass(frozen=True)
class Outcome:
    """What `Solver.solve` found.

    Attributes
    ----------
    result : Reconstruction
    maps : dict of Map
        Pictures for the surface by kind.
    texture : Texture or None
    file : bytes
        The face file of the result.
    turns : dict of str to (float, bool)
        How each photo's picture is turned, see `orientation`.
    skin : dict of str to bytes
        What is skin in each photo, see `skin_pictures.measured`.
    facts : dict of str to str
        What the face object keeps, see `stored_facts.facts`.
    landmarks : dict of str to str
        Of each photo as text, see `stored_facts.landmark_text`.
    """

    result: Reconstruction
    maps: dict[str, Map] = field(default_factory=dict)
    texture: Texture | None = None
    file: bytes = b""
    turns: dict[str, Turn] = field(default_factory=dict)
    skin: dict[str, bytes] = field(default_factory=dict)
    facts: dict[str, str] = field(default_factory=dict)
    landmarks: dict[str, str] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        result: Reconstruction,
        maps: dict[str, Map] | None = None,
        texture: Texture | None = None,
    ) -> Outcome:
        """With all that takes too long for Blender's main thread."""
        turns = {p.name: orientation(p.path) for p in result.photos if p.path}
        masks = () if texture is None else texture.skin
        skin = {
            photo.name: measured(mask, photo)
            for photo, mask in zip(result.photos, masks, strict=False)
        }
        return cls(
            result,
            maps or {},
            texture,
            face_bytes(result),
            turns,
            skin,
            facts(result),
            {found.photo: landmark_text(found) for found in result.landmarks},
        )


@dataclass(frozen=True)
class Detection:
    """What `Solver.detect` found.

    Attributes
    ----------
    collection : PhotoCollection
    hints : tuple of str
        Views that are missing, in sentences.
    texts : dict of str to str
        Landmarks of each photo as text, see `stored_facts.landmark_text`.
    """

    collection: PhotoCollection
    hints: tuple[str, ...] = ()
    texts: dict[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, collection: PhotoCollection, hints: tuple[str, ...]) -> Detection:
        """With all that takes too long for Blender's main thread."""
        texts = {found.photo: landmark_text(found) for found in collection.landmarks}
        return cls(collection, hints, texts)


class Solver:
    """What the operators ask of the core; tests hand in another one.

    The photos of the newest job are kept: a job that reads the same photos in the same
    way, such as one with another method, does not read them again.
    """

    def __init__(self) -> None:
        # One value, so that a job that was cancelled can do no harm to the next one.
        self._newest: tuple[str, PhotoCollection] | None = None

    def solve(self, request: Request, progress: Progress | None = None) -> Outcome:
        """Reconstruct the face and paint it.

        Raises
        ------
        ReconstructionError
            The job failed; the sentence says why and what to do.
        Cancelled
            By ``progress``.
        """
        clock = Clock(_scaled(progress))
        with one_blas_thread(), memory_reported():
            template = as_template(request.start, request.settings)
            shape = template.surface.shape
            settings = replace(request.settings, control_points=shape)
            photos = self._collect(request, template, clock.nested("landmarks"))
            clock.lap("landmarks")
            constraint, start = request.constraint, request.start
            problem = make_problem(photos, template, settings, constraint, start)
            result = solve(problem, clock)
            texture = _texture(result, progress, request.texture_size)
            return Outcome.of(result, all_maps(result, texture), texture)

    def detect(self, request: Request, progress: Progress | None = None) -> Detection:
        """Find faces and landmarks only."""
        with memory_reported():
            template = as_template(request.start, request.settings)
            found = self._collect(request, template, progress)
            return Detection.of(found, _hints(found))

    def forget(self) -> None:
        """Let the kept photos go."""
        self._newest = None

    def _collect(
        self, request: Request, template: Template, progress: Progress | None
    ) -> PhotoCollection:
        """The request's photos with their landmarks, from memory if they are there."""
        key = _reading_key(request, template)
        newest = self._newest
        if newest is not None and newest[0] == key:
            return newest[1]
        inputs = Inputs(
            template,
            request.landmarks,
            request.ignore,
            masks={name: decode_mask(data) for name, data in request.masks.items()},
        )
        found = collect_photos(request.photos, request.settings, inputs, progress)
        self._newest = key, found
        return found

    def faces_in(self, path: Path, name: str, scheme: str) -> tuple[Landmarks, ...]:
        """All faces in one photo, from left to right.

        Raises
        ------
        ReconstructionError
            No face was found.
        """
        found = faces_in(path, name, Settings(landmarks=scheme))
        if not found:
            raise ReconstructionError(found.reason)
        return found


def next_face(faces: tuple[Landmarks, ...], current: Landmarks | None) -> Landmarks:
    """The face to the right of the current one, after the last the first."""
    if current is None:
        return faces[0]
    middle = current.points.mean(0)
    away = [abs(face.points.mean(0) - middle).sum() for face in faces]
    return faces[(away.index(min(away)) + 1) % len(faces)]


def _reading_key(request: Request, template: Template) -> str:
    """Hash of all that `collect_photos` reads: equal keys, equal results."""
    settings = request.settings
    parts: list[object] = [
        settings.landmarks,
        settings.detector,
        settings.one_person,
        hashlib.sha256(template.landmark_xyz.tobytes()).hexdigest(),
        sorted(request.ignore),
        os.environ.get("BSFACE_MODELS"),
    ]
    for path in request.photos:
        parts += [[str(file), _stamp(file)] for file in (path, *files_beside(path))]
    for name, data in sorted(request.masks.items()):
        parts.append([name, hashlib.sha256(data).hexdigest()])
    for name, found in sorted(request.landmarks.items()):
        # Those that were detected are what detection finds again.
        if found.source != "detected":
            points, weight = found.points.tolist(), found.weight.tolist()
            parts.append([name, found.scheme, points, weight])
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()


def _stamp(path: Path) -> tuple[int, int] | None:
    """Time and size of a file; None where there is none."""
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size


def _scaled(progress: Progress | None) -> Progress | None:
    """The progress of the part before the painting."""
    if progress is None:
        return None
    return lambda step: progress(replace(step, overall=step.overall * SOLVE_SHARE))


def _texture(
    result: Reconstruction, progress: Progress | None, size: int | None
) -> Texture | None:
    """The texture of the used photos; None without photos."""

    def tell(fraction: float) -> None:
        if progress is not None:
            overall = SOLVE_SHARE + (1 - SOLVE_SHARE) * fraction
            done = round(100 * fraction)
            progress(Step("output", done, 100, overall, "painting the texture"))

    return bake_texture(result, size, tell) if result.photos else None


def _hints(collection: PhotoCollection) -> tuple[str, ...]:
    """Sentences on the views that are missing, before anything is solved."""

    template = load_template()
    poses = []
    for found in collection.landmarks:
        index = template.schemes[found.scheme]
        weight = found.weight * template.landmark_reliable[index]
        pose = linear_pose(found.points, template.landmark_xyz[index], weight)
        if pose:
            poses.append(pose.yaw_pitch_roll)
    return shortcomings(np.reshape(poses, (-1, 3)))
