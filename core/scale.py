"""True size: photos have no scale, one known length gives it.

Three ways, each with its uncertainty: a measured distance of eyes or pupils, two points
of known distance on the face that are clicked in one photo, and the iris, whose visible
width is nearly the same in all adults.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ._types import Array
from .camera.camera import Camera
from .errors import ReconstructionError
from .kinds import expect, expect_number, real_numbers
from .result import Reconstruction
from .settings import LIMITS
from .surface.alignment import eye_centres, eye_distance
from .surface.bspline import BSplineSurface, grid_parameters

#: Horizontal visible iris diameter of adults, mean and standard deviation, mm.
IRIS_MM, IRIS_SIGMA_MM = 11.7, 0.5
#: Standard deviation of a clicked point, pixels.
CLICK_PX = 1.0


@dataclass(frozen=True)
class TrueSize:
    """By what a face is to be multiplied.

    Attributes
    ----------
    factor : float
        True length over the length on the face.
    uncertainty : float
        One standard deviation of the factor.
    """

    factor: float
    uncertainty: float

    def __post_init__(self) -> None:
        expect_number(factor=self.factor, uncertainty=self.uncertainty)
        if not 0 < self.factor < np.inf or not 0 <= self.uncertainty < np.inf:
            raise ValueError(
                "factor must be positive and uncertainty 0 or more, not "
                f"{self.factor:g} and {self.uncertainty:g}."
            )

    @property
    def percent(self) -> float:
        """The uncertainty in percent of the size."""
        return 100 * self.uncertainty / self.factor

    def apply(self, face: Reconstruction) -> Reconstruction:
        """The face in its true size; its cameras see the same pictures.

        Lights, albedo and normals do not depend on the size.
        """
        f = self.factor
        cameras = tuple(c.rescaled(f, np.eye(3), np.zeros(3)) for c in face.cameras)
        deviation = None if face.deviation is None else f * face.deviation
        distance = eye_distance(face.surface, face.template) * f
        return replace(
            face,
            surface=face.surface.transformed(f),
            cameras=cameras,
            deviation=deviation,
            settings=replace(face.settings, eye_distance_mm=distance),
        )


def size_from_eye_distance(
    face: Reconstruction, measured_mm: float, sigma_mm: float = 0.5
) -> TrueSize:
    """From the distance of the eyes, or of the pupils of a gaze into the distance.

    Parameters
    ----------
    face : Reconstruction
    measured_mm, sigma_mm : float
        The measurement and its standard deviation; an optician's pupil distance is
        good to half a millimetre.
    """
    _check_face(face)
    _check_length("eye distance", measured_mm, sigma_mm)
    low, high = LIMITS["eye_distance_mm"]
    if not low <= measured_mm <= high:
        raise ReconstructionError(
            f"The eye distance must lie between {low:g} and {high:g} mm, not "
            f"{measured_mm:g}."
        )
    own = eye_distance(face.surface, face.template)
    return TrueSize(measured_mm / own, sigma_mm / own)


def size_from_points(
    face: Reconstruction,
    photo: str,
    pixels: npt.ArrayLike,
    length_mm: float,
    *,
    sigma_mm: float = 0.2,
    click_px: float = CLICK_PX,
) -> TrueSize:
    """From two points of the face whose straight distance is known.

    Parameters
    ----------
    face : Reconstruction
    photo : str
        Name of a used photo.
    pixels : (2, 2) array
        The points in the photo, x right and y down, first pixel (0, 0).
    length_mm, sigma_mm : float
        Their distance in space and its standard deviation.
    click_px : float
        Standard deviation of a click.

    Raises
    ------
    ReconstructionError
        When the photo is not used, or a point does not lie on the face.
    """
    _check_face(face)
    _check_length("distance of the points", length_mm, sigma_mm)
    clicked = _clicks(pixels, "pixels", click_px)
    camera = _camera(face, photo)

    hits = [_hit(face.surface, camera, p, photo) for p in clicked]
    apart = hits[1][0] - hits[0][0]
    own = float(np.linalg.norm(apart))
    if own < 1e-6:
        raise ReconstructionError(f"{photo}: the two points are one; click two places.")
    # A click moves its point along the surface, and the distance by what is along it.
    slopes = [apart / own @ along for _, along in hits]
    click = click_px * float(np.linalg.norm(slopes)) / own
    relative = float(np.hypot(click, sigma_mm / length_mm))
    return TrueSize(length_mm / own, relative * length_mm / own)


def size_from_iris(
    face: Reconstruction,
    photo: str,
    edges: npt.ArrayLike,
    *,
    click_px: float = CLICK_PX,
) -> TrueSize:
    """From the left and the right edge of an iris in a photo that looks at the camera.

    The width of the iris is taken as 11.7 +- 0.5 mm, at the depth of the eye that is
    nearer to the clicks and square to the line of sight.

    Parameters
    ----------
    face : Reconstruction
    photo : str
        Name of a used photo.
    edges : (2, 2) array
        Pixels.
    click_px : float
        Standard deviation of a click.

    Raises
    ------
    ReconstructionError
        When the photo is not used or the clicks are no iris.
    """
    _check_face(face)
    clicked = _clicks(edges, "edges", click_px)
    camera = _camera(face, photo)
    centres = eye_centres(face.surface, face.template)
    seen = camera.project(centres)
    eye = int(np.linalg.norm(seen - clicked.mean(axis=0), axis=1).argmin())
    depth = 1 - camera.kappa * float((centres[eye] @ camera.R.T)[2])
    width_px = float(np.linalg.norm(clicked[1] - clicked[0]))
    own = width_px * depth / camera.s
    apart = float(np.linalg.norm(centres[1] - centres[0]))
    if not 0.08 < own / apart < 0.4:
        raise ReconstructionError(
            f"{photo}: the two points are no edges of an iris (they are "
            f"{width_px:.1f} pixels apart); click its left and its right edge."
        )
    click = np.sqrt(2) * click_px / width_px
    relative = float(np.hypot(click, IRIS_SIGMA_MM / IRIS_MM))
    return TrueSize(IRIS_MM / own, relative * IRIS_MM / own)


def _check_face(face: Reconstruction) -> None:
    expect(Reconstruction, "a Reconstruction", face=face)


def _clicks(given: npt.ArrayLike, name: str, click_px: float) -> Array:
    """Two points in a photo, checked with their standard deviation."""
    expect_number(click_px=click_px)
    if not 0 <= click_px < np.inf:
        raise ValueError(f"click_px must be 0 or more pixels, not {click_px:g}.")
    found = real_numbers(given, name)
    if found.shape != (2, 2) or not np.isfinite(found).all():
        raise ValueError(f"{name} must be two finite points (2, 2), not {found.shape}.")
    return found


def _check_length(what: str, value: float, sigma: float) -> None:
    expect_number(length=value, sigma_mm=sigma)
    if not 0 < value < 1000 or not 0 <= sigma < value:
        raise ReconstructionError(
            f"The {what} must be a length in millimetres with a smaller uncertainty, "
            f"not {value:g} +- {sigma:g}."
        )


def _camera(face: Reconstruction, photo: str) -> Camera:
    for candidate, camera in zip(face.photos, face.cameras, strict=True):
        if candidate.name == photo:
            return camera
    raise ReconstructionError(
        f"{photo}: the photo is not used by this face; choose one of the used photos."
    )


def _hit(
    surface: BSplineSurface, camera: Camera, pixel: Array, photo: str
) -> tuple[Array, Array]:
    """The point of the face that a pixel shows, and how it moves with the pixel.

    Returns
    -------
    point : (3,) array
        mm; of several the one nearest to the camera.
    along : (3, 2) array
        Its derivative by the pixel.
    """
    n = 60
    u, v = grid_parameters(n, n)
    points = surface.evaluate(u, v)
    off = np.linalg.norm(camera.project(points) - pixel, axis=1)
    # The ray may pierce the face more than once: start at all near points of the grid.
    near = np.argsort(off, kind="stable")[:24]
    uv = np.stack([u[near], v[near]], axis=1)
    for _ in range(12):
        at = surface.evaluate(*uv.T)
        pixels, by_point, _ = camera.jacobians(at)
        tangent = np.stack(
            [surface.evaluate(*uv.T, du=1), surface.evaluate(*uv.T, dv=1)], axis=2
        )
        J = by_point @ tangent
        # Edge-on the pixel says little about (u, v): damped, and never far at once.
        H = J.transpose(0, 2, 1) @ J + 1e-9 * np.eye(2)
        gap = J.transpose(0, 2, 1) @ (pixel - pixels)[..., None]
        uv = np.clip(uv + np.clip(np.linalg.solve(H, gap)[..., 0], -0.1, 0.1), 0, 1)
    at = surface.evaluate(*uv.T)
    good = np.linalg.norm(camera.project(at) - pixel, axis=1) < 1e-3
    good &= np.abs(np.linalg.det(J)) > 1e-9
    if not good.any():
        raise ReconstructionError(
            f"{photo}: the point at {pixel[0]:.0f}, {pixel[1]:.0f} is not on the face; "
            "click a place of the face."
        )
    best = int(np.where(good, at @ camera.R[2], -np.inf).argmax())
    return at[best], tangent[best] @ np.linalg.inv(J[best])
