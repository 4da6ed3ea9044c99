"""The core's work for the add-on; no Blender in here, so any thread may do it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core.camera.coverage import shortcomings
from ..core.camera.linear_pose import linear_pose
from ..core.errors import ReconstructionError
from ..core.landmarks.all_faces import faces_in
from ..core.landmarks.landmarks import Landmarks
from ..core.prepare import Inputs, collect_photos
from ..core.problem import PhotoCollection
from ..core.progress import Progress, Step
from ..core.reconstruct import reconstruct
from ..core.result import Reconstruction
from ..core.settings import Settings
from ..core.surface.template import load_template
from ..core.texture.bake import Texture, bake_texture
from .maps import Map, all_maps

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
    """

    result: Reconstruction
    maps: dict[str, Map] = field(default_factory=dict)
    texture: Texture | None = None


@dataclass(frozen=True)
class Detection:
    """What `Solver.detect` found.

    Attributes
    ----------
    collection : PhotoCollection
    hints : tuple of str
        Views that are missing, in sentences.
    """

    collection: PhotoCollection
    hints: tuple[str, ...] = ()


class Solver:
    """What the operators ask of the core; tests hand in another one."""

    def solve(self, request: Request, progress: Progress | None = None) -> Outcome:
        """Reconstruct the face and paint it.

        Raises
        ------
        ReconstructionError
            The job failed; the sentence says why and what to do.
        Cancelled
            By ``progress``.
        """
        result = _reconstruct(request, progress)
        texture = _texture(result, progress, request.texture_size)
        return Outcome(result, all_maps(result, texture), texture)

    def detect(self, request: Request, progress: Progress | None = None) -> Detection:
        """Find faces and landmarks only."""
        found = collect_photos(
            request.photos,
            request.settings,
            Inputs(landmarks=request.landmarks, ignore=request.ignore),
            progress,
        )
        return Detection(found, _hints(found))

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


def _reconstruct(request: Request, progress: Progress | None) -> Reconstruction:
    def tell(step):
        if progress is not None:
            progress(replace(step, overall=step.overall * SOLVE_SHARE))

    return reconstruct(
        request.photos,
        request.settings,
        template=request.start,
        progress=tell,
        ignore=request.ignore,
        landmarks=request.landmarks,
        constraint=request.constraint,
    )


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
