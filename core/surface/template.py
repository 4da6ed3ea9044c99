"""The template face ``b_t``, where its landmarks lie and how faces vary about it."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._types import Array
from ..kinds import coordinates, expect_paths
from ..npz_arrays import floats as npz_floats
from ..npz_arrays import open_file, read_arrays
from .bspline import BSplineSurface, net_shape

BUNDLED = Path(__file__).resolve().parents[1] / "data" / "template.npz"
COUNT = 468  # landmarks of the face mesh
MAX_BYTES = 500_000_000
#: How far from the origin anything of a template may lie, mm.
MAX_MM = 1e5
#: So much outside of the unit square is rounding.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Template:
    """Template face.

    Attributes
    ----------
    surface : BSplineSurface
        ``b_t``, millimetres, origin midway between the eye centres.
    landmark_uv : (468, 2) array
        Parameters of the surface point that each landmark means.
    landmark_xyz : (468, 3) array
        The free 3D point that explains the detections of the landmark best over all
        poses: in front of the surface at the nose, which the detector moves with yaw as
        if it stood out further.
    landmark_sigma : (468,) array
        Standard deviation of the detections about that point, mm.
    landmark_reliable : (468,) bool array
        False for outline points, which slide with the pose, and points inside the lips.
    landmark_mirror : (468,) int array
        Index of the mirrored landmark.
    schemes : dict of int arrays
        Landmark schemes "468", "68" (iBUG order) and "40" as indices into the 468.
    outline_uv : (k, 2) array
        Closed polygon of the face in (u, v).
    skin : (k, k) bool array
        Cells of the parameter square that are skin: not eyes, nostrils, lip gap.
    eye_centres : (2, 3) array
        Right eye (x < 0) first.
    identity_modes, expression_modes : (k, M, N, 3) arrays
        Displacements of the control points, one standard deviation each.
    """

    surface: BSplineSurface
    landmark_uv: Array
    landmark_xyz: Array
    landmark_sigma: Array
    landmark_reliable: NDArray[np.bool_]
    landmark_mirror: NDArray[np.int64]
    schemes: dict[str, NDArray[np.int64]]
    outline_uv: Array
    skin: NDArray[np.bool_]
    eye_centres: Array
    identity_modes: Array
    expression_modes: Array

    @property
    def eye_distance(self) -> float:
        """Distance between the eye centres, mm."""
        return float(np.linalg.norm(self.eye_centres[1] - self.eye_centres[0]))

    @property
    def landmark_weight(self) -> Array:
        """Weight of each landmark, ``1 / (sigma^2 + 0.7^2)`` scaled to 1 at best."""
        w = 1 / (self.landmark_sigma**2 + 0.7**2)
        return w / w.max()

    def inside(self, uv: ArrayLike) -> NDArray[np.bool_]:
        """Whether (u, v) lie within the outline of the face; ``(...,)`` bool.

        Not what is outside of the unit square, or not finite.

        Raises
        ------
        ValueError
            When ``uv`` is not ``(..., 2)``.
        """
        at, there = _in_square(uv)
        return there & inside_polygon(self.outline_uv, at)

    def is_skin(self, uv: ArrayLike) -> NDArray[np.bool_]:
        """Whether (u, v) lie on skin; ``(...,)`` bool. See `inside`."""
        at, there = _in_square(uv)
        k = len(self.skin)
        cell = np.clip((at * k).astype(int), 0, k - 1)
        return there & self.skin[cell[..., 0], cell[..., 1]]

    def digest(self) -> str:
        """Hash of what no result changes: landmarks' parameters and the regions."""
        parts = (self.landmark_uv, self.outline_uv, self.skin, self.landmark_sigma)
        total = hashlib.sha256()
        for part in parts:
            total.update(np.ascontiguousarray(part).tobytes())
        return total.hexdigest()[:16]

    def resampled(self, shape: tuple[int, int]) -> Template:
        """The same template with another number of control points.

        Raises
        ------
        ValueError
            When ``shape`` is not two whole numbers, each 4 or more.
        """
        shape = net_shape(shape)
        if shape == self.surface.shape:
            return self
        fields = dict(self.__dict__)
        fields["surface"] = self.surface.resampled(shape)
        for name in ("identity_modes", "expression_modes"):
            fields[name] = np.reshape(
                [
                    BSplineSurface(d).resampled(shape).control_points
                    for d in fields[name]
                ],
                (-1, *shape, 3),
            )
        return Template(**fields)


def _in_square(uv: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
    """Parameters ``(..., 2)`` with 0 for what is not in the square, and what is."""
    at = coordinates(uv, "uv", 2)
    there = ((at >= -ROUNDING) & (at <= 1 + ROUNDING)).all(axis=-1)
    return np.where(there[..., None], at, 0.0), there


def inside_polygon(polygon: Array, points: Array) -> NDArray[np.bool_]:
    """Whether points ``(..., 2)`` lie in a closed polygon ``(k, 2)``; even-odd rule."""
    x, y = points[..., 0], points[..., 1]
    inside = np.zeros(x.shape, bool)
    # Side by side of the polygon: all points times all sides would not fit in memory.
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if a[1] != b[1]:
            at = a[0] + (y - a[1]) * (b[0] - a[0]) / (b[1] - a[1])
            inside ^= ((a[1] > y) != (b[1] > y)) & (x < at)
    return inside


def load_template(path: str | os.PathLike | None = None) -> Template:
    """Read a template file.

    Parameters
    ----------
    path : path, optional
        A file written by ``tools/build_template.py``; default the bundled average head.

    Raises
    ------
    ValueError
        If the file is no template; the sentence names the file and what is wrong.
    """
    if path is not None:
        expect_paths(path=path)
    path = BUNDLED if path is None else Path(path)
    try:
        # Opened here: numpy leaves the file open when it is damaged.
        with open_file(path) as file:
            a = read_arrays(file, MAX_BYTES)
        return _template(a)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise ValueError(
            f"{path} is not a template file ({' '.join(why.split())}); build one with "
            "tools/build_template.py or leave the template empty."
        ) from error


def _template(a: dict[str, NDArray]) -> Template:
    def floats(name: str, *shape: int | None) -> Array:
        return npz_floats(a, name, *shape)

    def indices(name: str, size: int) -> NDArray[np.int64]:
        value = floats(name, size)
        if value.min() < 0 or value.max() >= COUNT or (value % 1).any():
            raise ValueError(f"{name} must hold numbers of landmarks, 0 to {COUNT - 1}")
        return value.astype(np.int64)

    def millimetres(name: str, *shape: int | None) -> Array:
        value = floats(name, *shape)
        if np.abs(value).max(initial=0) > MAX_MM:
            raise ValueError(f"{name} holds lengths of more than {MAX_MM:g} mm")
        return value

    surface = BSplineSurface(millimetres("control_points", None, None, 3))
    modes = {
        name: millimetres(name, None, *surface.shape, 3)
        for name in ("identity_modes", "expression_modes")
    }
    sigma = millimetres("landmark_free_sigma", COUNT)
    eyes, outline = millimetres("eye_centres", 2, 3), floats("outline_uv", None, 2)
    skin = floats("skin", None, None)
    uv = floats("landmark_uv", COUNT, 2)
    if uv.min() < 0 or uv.max() > 1:
        raise ValueError("landmark_uv must lie in [0, 1]")
    if sigma.min() <= 0:
        raise ValueError("landmark_free_sigma must be positive")
    if np.linalg.norm(eyes[1] - eyes[0]) < 1:
        raise ValueError("eye_centres are at one place")
    if len(outline) < 3:
        raise ValueError("outline_uv has fewer than 3 corners")
    if skin.shape[0] != skin.shape[1] or not skin.any():
        raise ValueError("skin must be square and hold some skin")
    return Template(
        surface=surface,
        landmark_uv=uv,
        landmark_xyz=millimetres("landmark_xyz", COUNT, 3),
        landmark_sigma=sigma,
        landmark_reliable=floats("landmark_reliable", COUNT).astype(bool),
        landmark_mirror=indices("landmark_mirror", COUNT),
        schemes={
            "468": np.arange(COUNT),
            "68": indices("scheme_68", 68),
            "40": indices("scheme_40", 40),
        },
        outline_uv=outline,
        skin=skin.astype(bool),
        eye_centres=eyes,
        identity_modes=modes["identity_modes"],
        expression_modes=modes["expression_modes"],
    )
