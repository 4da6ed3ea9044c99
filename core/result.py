"""The result of a reconstruction: the surface, and all that is known about it."""

from __future__ import annotations

import base64
import contextlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ._types import Array
from .camera.camera import Camera
from .images.photo import Photo
from .kinds import expect
from .landmarks.landmarks import Landmarks
from .photometry.lighting import PhotometricEvidence
from .photometry.skin import SkinMask
from .problem import Constraint, Iteration
from .settings import Settings
from .surface.bspline import BSplineSurface
from .surface.template import Template
from .versions import VERSION, library_versions


@dataclass(frozen=True)
class PhotoReport:
    """One line of the per-photo report.

    Attributes
    ----------
    name : str
    status : str
        "used" or the code of a failure (`errors.FailureCode`).
    reason : str
        Why it was left out, or a remark on a used photo.
    reprojection_pct : float
        Median distance between landmarks and the projected surface, % of the eye
        distance; NaN if not used.
    yaw, pitch, roll : float
        Degrees; head turned to the picture's right, up, clockwise.
    residual : float
        Root mean square intensity residual, relative to the photo's median.
    weight : float
        Mean robust weight of its samples, 0 to 1.
    """

    name: str
    status: str
    reason: str = ""
    reprojection_pct: float = float("nan")
    yaw: float = float("nan")
    pitch: float = float("nan")
    roll: float = float("nan")
    residual: float = float("nan")
    weight: float = float("nan")


class HistoryEntry(NamedTuple):
    """What is kept of an iteration; see `problem.Iteration`."""

    stage: str
    residual: float
    step_mm: float

    @classmethod
    def of(cls, iteration: Iteration) -> HistoryEntry:
        """The entry of an iteration."""
        return cls(iteration.stage, iteration.residual, iteration.step_mm)


@dataclass(frozen=True)
class Provenance:
    """Where a result comes from.

    Attributes
    ----------
    program : str
        Version of bsface.
    libraries : mapping of name to version
    hashes : mapping of photo name to str
        SHA-256 of each photo that was read: of its file, or of its pixels.
    date : str
        When the file was written, ISO 8601 in UTC; empty before that.
    """

    program: str = ""
    libraries: Mapping[str, str] = field(default_factory=dict)
    hashes: Mapping[str, str] = field(default_factory=dict)
    date: str = ""

    @classmethod
    def of_this_program(cls, hashes: Mapping[str, str]) -> Provenance:
        """The provenance of a result that this process made."""
        return cls(VERSION, library_versions(), dict(hashes))


@dataclass(frozen=True, eq=False, repr=False)
class Reconstruction:
    """Result of `bsface.reconstruct`, or of `bsface.load`, which has no pixels.

    Attributes
    ----------
    surface : BSplineSurface
        The face, millimetres, origin midway between the eye centres.
    template : Template
        The template that it started from, with the same size of net.
    photos, landmarks, cameras : tuples of n
        Used photos (cut-outs) in folder order, with landmarks and cameras.
    photometric : PhotometricEvidence or None
        Albedo, lights and normals; None for ``method="motion"``.
    reports : tuple of PhotoReport
        Every photo of the folder, in folder order.
    deviation : (M, N) array or None
        Standard deviation of the control points along their normals, mm.
    settings : Settings
    expressions : (n, k) array
        Coefficients of the template's expression modes in each photo.
    skin : tuple of n SkinMask
        What of each used photo counted as skin; empty for a method that does not ask,
        and without pixels.
    constraint : Constraint or None
        Control points that were held.
    history : tuple of HistoryEntry
        One per iteration: stage, residual, step in mm.
    warnings : tuple of str
        What the photos cannot tell, in sentences.
    seconds : mapping
        Time of each stage.
    provenance : Provenance
        Versions, and a hash of each photo.
    """

    surface: BSplineSurface
    template: Template
    photos: tuple[Photo, ...]
    landmarks: tuple[Landmarks, ...]
    cameras: tuple[Camera, ...]
    photometric: PhotometricEvidence | None
    reports: tuple[PhotoReport, ...]
    deviation: Array | None
    settings: Settings
    expressions: Array
    skin: tuple[SkinMask, ...] = ()
    constraint: Constraint | None = None
    history: tuple[HistoryEntry, ...] = ()
    warnings: tuple[str, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)
    provenance: Provenance = field(default_factory=Provenance)

    @property
    def confidence(self) -> Array | None:
        """The same as `deviation`: its name before version 0.2."""
        return self.deviation

    @property
    def has_pixels(self) -> bool:
        """Whether the photos are there, and not only their names and cameras."""
        return bool(self.photos) and all(p.pixels.size for p in self.photos)

    @property
    def used(self) -> int:
        """Number of photos that the face was made of."""
        return sum(report.status == "used" for report in self.reports)

    def with_surface(self, surface: BSplineSurface) -> Reconstruction:
        """The same result with another surface, such as an edited one.

        With another net the deviation and the constraint go, and the setting
        ``control_points`` becomes that of the net where it can.
        """
        expect(BSplineSurface, "a BSplineSurface", surface=surface)
        if surface.shape != self.surface.shape:
            settings = self.settings
            with contextlib.suppress(ValueError):
                settings = replace(settings, control_points=surface.shape)
            return replace(
                self,
                surface=surface,
                template=self.template.resampled(surface.shape),
                settings=settings,
                deviation=None,
                constraint=None,
            )
        return replace(self, surface=surface)

    def save(self, path: str | os.PathLike, *, date: str | None = None) -> Path:
        """Write a face file (``.npz``), which `bsface.load` reads.

        Parameters
        ----------
        path : path-like
        date : str, optional
            Written in place of the present time, for files that are to be equal;
            by default the environment's ``SOURCE_DATE_EPOCH`` or now.

        Raises
        ------
        ReconstructionError
            When the file cannot be written or cannot hold the face, its ending is
            another one, or the date is none.
        """
        from .formats.face_file import save_face

        return save_face(path, self, date=date)

    def __repr__(self) -> str:
        m, n = self.surface.shape
        return (
            f"<Reconstruction: {m} x {n} control points, method "
            f"{self.settings.method!r}, {self.used} of {len(self.reports)} photos>"
        )

    def _repr_html_(self) -> str:
        """Three views of the face, for notebooks."""
        from .drawing.pictures import encode_png
        from .drawing.render import render_views

        picture = encode_png(render_views(self.surface, self.template, height=300))
        data = base64.b64encode(picture).decode("ascii")
        text = repr(self)[1:-1]
        return f'<p>{text}</p><img alt="{text}" src="data:image/png;base64,{data}">'


def no_photo(name: str, size: tuple[int, int]) -> Photo:
    """A photo of which only name and size are known."""
    return Photo(name, None, size, np.zeros((0, 0, 3), np.uint8))
