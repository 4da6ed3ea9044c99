"""The landmarks of all photos in one table: what the solvers read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._types import Array, Indices
from ..camera.camera import Camera
from ..camera.linear_pose import linear_pose
from ..images.photo import Photo
from ..surface.template import Template
from .landmarks import Landmarks

#: Photos of a face are hardly ever taken from nearer.
NEAREST_MM = 250.0


@dataclass(frozen=True)
class LandmarkObservations:
    """Landmarks of n photos, each the image of one surface point.

    Attributes
    ----------
    pixels : (n, f, 2) array
        Positions in the photos, pixels; anything where the weight is 0.
    weight : (n, f) array
        0 where a landmark is missing, 1 for the detector's usual accuracy, more for
        landmarks that were placed by hand.
    index : (f,) int array
        Which of the template's 468 landmarks.
    uv : (f, 2) array
        Their parameters on the surface, ``(u(i), v(i))`` of Eq. 4.
    principal : (n, 2) array
        Principal point of each photo, pixels.
    names : tuple of n str
        The photos, for messages.
    focal_px : tuple of n float or None
        Focal length of each photo, pixels; None where it is not known.
    """

    pixels: Array
    weight: Array
    index: Indices
    uv: Array
    principal: Array
    names: tuple[str, ...] = ()
    focal_px: tuple[float | None, ...] = ()

    def __post_init__(self) -> None:
        n, f = self.pixels.shape[:2]
        found = (self.weight.shape, self.index.shape, self.uv.shape)
        if self.pixels.shape != (n, f, 2) or found != ((n, f), (f,), (f, 2)):
            raise ValueError(
                "landmarks need pixels (n, f, 2), weight (n, f), index (f,) and uv "
                f"(f, 2); got {self.pixels.shape} and {found}"
            )
        if self.principal.shape != (n, 2):
            raise ValueError(f"principal must be ({n}, 2), not {self.principal.shape}")
        known = np.isfinite(self.pixels).all(2) & (self.weight > 0)
        object.__setattr__(self, "weight", np.where(known, self.weight, 0.0))
        object.__setattr__(self, "pixels", np.where(known[..., None], self.pixels, 0.0))
        for name, usual in (
            ("names", tuple(f"photo {i + 1}" for i in range(n))),
            ("focal_px", (None,) * n),
        ):
            given = len(getattr(self, name))
            if given not in (0, n):
                raise ValueError(f"{name} must be of {n} photos, not of {given}")
            if given != n:
                object.__setattr__(self, name, usual)


def observe_landmarks(
    photos: Sequence[Photo], landmarks: Sequence[Landmarks], template: Template
) -> LandmarkObservations:
    """The reliable landmarks of all photos, on the template's numbering.

    Landmarks that no photo has are left out.
    """
    n, count = len(photos), len(template.landmark_uv)
    pixels, weight = np.zeros((n, count, 2)), np.zeros((n, count))
    for i, marks in enumerate(landmarks):
        which = template.schemes[marks.scheme]
        pixels[i, which], weight[i, which] = marks.points, marks.weight
    index = np.flatnonzero(template.landmark_reliable & (weight > 0).any(0))
    return LandmarkObservations(
        pixels[:, index],
        weight[:, index],
        index,
        template.landmark_uv[index],
        np.array([principal_point(photo) for photo in photos]).reshape(-1, 2),
        tuple(photo.name for photo in photos),
        tuple(
            believable_focal(photo, pixels[i], template.landmark_xyz, weight[i])
            for i, photo in enumerate(photos)
        ),
    )


def believable_focal(
    photo: Photo, pixels: Array, Q: Array, weight: Array
) -> float | None:
    """The focal length of a photo, pixels, unless it cannot be that of its face.

    If it puts the camera nearer to the face than `NEAREST_MM`, the picture must be a
    crop, whose focal length is another one.

    Parameters
    ----------
    photo : Photo
    pixels, weight : (f, 2), (f,) arrays
        Landmarks in the photo, weight 0 where one is missing.
    Q : (f, 3) array
        The same on a face, mm.
    """
    if photo.focal_px is None:
        return None
    pose = linear_pose(pixels, Q, weight, principal_point(photo), photo.name)
    near = isinstance(pose, Camera) and photo.focal_px < NEAREST_MM * pose.s
    return None if near else photo.focal_px


def principal_point(photo: Photo) -> tuple[float, float]:
    """The centre of the whole original picture, pixels."""
    return (photo.size[0] - 1) / 2, (photo.size[1] - 1) / 2
