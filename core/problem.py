"""What travels through a reconstruction: problem, estimates, iterations.

`prepare` makes a `Problem` out of photos; motion and then a method turn it into better
and better `FaceEstimate`s, one per `Iteration`; `finish` makes the result of the last.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ._types import Array, Mask
from .camera.camera import Camera
from .errors import PhotoFailure
from .images.photo import Photo
from .landmarks.landmarks import Landmarks
from .landmarks.observations import LandmarkObservations
from .photometry.lighting import PhotometricEvidence
from .photometry.skin import SkinMask
from .progress import CheckCancelled
from .settings import NUMBER, Settings
from .surface.bspline import BSplineSurface
from .surface.prior import ShapePrior
from .surface.template import Template

#: Standard deviation of a control point that is held hard, mm.
HARD_MM = 1e-3


@dataclass(frozen=True, eq=False)
class Constraint:
    """Control points of the template that stay where the template has them.

    Attributes
    ----------
    points : (M, N) bool array
        Which of the template's control points.
    softness_mm : float
        Standard deviation of their places; 0 holds them hard.

    Raises
    ------
    TypeError, ValueError
        For what is no such array, and a softness that is no length.
    """

    points: Mask
    softness_mm: float = 0.0

    def __post_init__(self) -> None:
        points = np.asarray(self.points)
        # 0 and 1 are as good; indices and measurements would hold other points.
        fits = points.ndim == 2 and points.dtype.kind in "biuf"
        if not fits or not ((points == 0) | (points == 1)).all():
            raise ValueError(
                "points must be an (M, N) array of true and false, one for each "
                f"control point, not {points.dtype} of shape {points.shape}."
            )
        object.__setattr__(self, "points", points.astype(bool))
        soft = self.softness_mm
        number = isinstance(soft, NUMBER) and not isinstance(soft, bool)
        if not number or not 0 <= soft < np.inf:
            raise ValueError(
                "The softness of a constraint must be a length in millimetres, 0 or "
                f"more, not {soft!r:.40}."
            )

    @property
    def precision(self) -> Array:
        """Inverse variance of each control point, 1/mm^2, ``(M*N,)``; 0 = free."""
        return np.asarray(self.points, bool).ravel() / (
            max(self.softness_mm, HARD_MM) ** 2
        )


@dataclass(frozen=True, eq=False)
class PhotoCollection:
    """The photos that can be used, and why the others cannot.

    Attributes
    ----------
    photos : tuple of n Photo
        Cut-outs.
    landmarks : tuple of n Landmarks
    failures : tuple of PhotoFailure
        The photos that are left out, in folder order.
    identity_warnings : tuple of str
        Whether all photos show one person, in sentences; empty if they seem to.
    hints : tuple of str
        What in the folder was not read, in sentences.
    hashes : mapping of photo name to str
        SHA-256 of each photo that was read: of its file, or of its pixels.
    originals : mapping of photo name to str
        Of each photo that looks like a copy of another: the name of that one.
    """

    photos: tuple[Photo, ...]
    landmarks: tuple[Landmarks, ...]
    failures: tuple[PhotoFailure, ...] = ()
    identity_warnings: tuple[str, ...] = ()
    hints: tuple[str, ...] = ()
    hashes: Mapping[str, str] = field(default_factory=dict)
    originals: Mapping[str, str] = field(default_factory=dict)

    @property
    def copies(self) -> int:
        """How many of the photos look like another one of them."""
        names = [photo.name for photo in self.photos]
        return len(names) - len({self.originals.get(name, name) for name in names})


@dataclass(frozen=True, eq=False)
class Problem:
    """Everything that the methods read; it does not change during a run.

    Attributes
    ----------
    collection : PhotoCollection
        The photos, with what was found in them.
    template : Template
        With the net of the result.
    prior : ShapePrior
        Of the displacement from the template.
    landmarks : LandmarkObservations
        Of all photos, on the template's numbering.
    settings : Settings
    constraint : Constraint or None
        Control points that stay.
    target : BSplineSurface or None
        Where they belong in the result, in the frame of results.
    """

    collection: PhotoCollection
    template: Template
    prior: ShapePrior
    landmarks: LandmarkObservations
    settings: Settings
    constraint: Constraint | None = None
    target: BSplineSurface | None = None

    @property
    def photos(self) -> tuple[Photo, ...]:
        """The used photos."""
        return self.collection.photos

    @property
    def distance_mm(self) -> float:
        """Typical distance of the cameras in the template's frame, mm."""
        return self.settings.distance_from(self.template.eye_distance)


@dataclass(frozen=True, eq=False)
class FaceEstimate:
    """The face, the cameras and the light as far as they are known.

    Attributes
    ----------
    surface : BSplineSurface
        In the template's frame until `finish` moves it into the head frame.
    cameras : tuple of n Camera
    landmarks_xyz : (f, 3) array
        Where the landmarks sit on this face, mm.
    expressions : (n, k) array
        Coefficients of the template's expression modes in each photo, relative to the
        surface; standard deviations.
    modes : (k,) array
        Coefficients of the prior's modes in the surface.
    smooth : (M*N, 3) array
        The rest of the displacement from the template, mm.
    photo_weights : (n,) array
        How much each photo counts, 0 to 1: less where its expression is strong.
    photometric : PhotometricEvidence or None
        Lights, albedo and weights; None before any shading was used.
    deviation : (M, N) array or None
        Standard deviation of the control points along their normals, mm; with the last
        estimate of a method that knows it.
    skin : tuple of n SkinMask
        What of each photo counts as skin; empty for a method that does not ask.
    """

    surface: BSplineSurface
    cameras: tuple[Camera, ...]
    landmarks_xyz: Array
    expressions: Array
    modes: Array
    smooth: Array
    photo_weights: Array
    photometric: PhotometricEvidence | None = None
    deviation: Array | None = None
    skin: tuple[SkinMask, ...] = ()


class Iteration(NamedTuple):
    """One step of motion or of a method.

    Attributes
    ----------
    stage : str
        What the step did: "motion", "refine", "shading", "outer".
    estimate : FaceEstimate
        After the step.
    residual : float
        Root mean square residual of the step, in the unit of its stage: mm at the head
        for landmarks, parts of the photo's median for intensities, degrees for normals.
    step_mm : float
        How far the surface moved.
    done, total : int
        Steps so far, and at most.
    """

    stage: str
    estimate: FaceEstimate
    residual: float
    step_mm: float
    done: int
    total: int


#: A way from the motion estimate to the face; yields one iteration per step.
#: The last argument is called between the parts of a step; it may raise `Cancelled`.
Method = Callable[[Problem, FaceEstimate, CheckCancelled], Iterator[Iteration]]
