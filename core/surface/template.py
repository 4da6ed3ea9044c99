"""The template face ``b_t``, where its landmarks lie and how faces vary about it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .bspline import BSplineSurface

Array = NDArray[np.float64]
BUNDLED = Path(__file__).resolve().parents[1] / "data" / "template.npz"


@dataclass(frozen=True)
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
        """Whether (u, v) lie within the outline of the face; ``(...,)`` bool."""
        uv = np.asarray(uv, float)
        x, y = uv[..., 0, None], uv[..., 1, None]
        a, b = self.outline_uv, np.roll(self.outline_uv, -1, axis=0)
        crosses = (a[:, 1] > y) != (b[:, 1] > y)
        rise = np.where(a[:, 1] == b[:, 1], 1.0, b[:, 1] - a[:, 1])
        at = a[:, 0] + (y - a[:, 1]) * (b[:, 0] - a[:, 0]) / rise
        return ((crosses & (x < at)).sum(-1) % 2).astype(bool)

    def is_skin(self, uv: ArrayLike) -> NDArray[np.bool_]:
        """Whether (u, v) lie on skin; ``(...,)`` bool."""
        k = len(self.skin)
        at = np.clip((np.asarray(uv, float) * k).astype(int), 0, k - 1)
        return self.skin[at[..., 0], at[..., 1]]

    def resampled(self, shape: tuple[int, int]) -> Template:
        """The same template with another number of control points."""
        if shape == self.surface.shape:
            return self
        fields = dict(self.__dict__)
        fields["surface"] = self.surface.resampled(shape)
        for name in ("identity_modes", "expression_modes"):
            fields[name] = np.stack(
                [
                    BSplineSurface(d).resampled(shape).control_points
                    for d in fields[name]
                ]
            )
        return Template(**fields)


def load_template(path: str | Path | None = None) -> Template:
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
    path = BUNDLED if path is None else Path(path)
    try:
        with np.load(path, allow_pickle=False) as z:
            a = {k: z[k] for k in z.files}
        f = {k: a[k].astype(float) for k in a if a[k].dtype.kind == "f"}
        count = len(a["landmark_uv"])
        return Template(
            surface=BSplineSurface(f["control_points"]),
            landmark_uv=f["landmark_uv"],
            landmark_xyz=f["landmark_xyz"],
            landmark_sigma=f["landmark_free_sigma"],
            landmark_reliable=a["landmark_reliable"].astype(bool),
            landmark_mirror=a["landmark_mirror"],
            schemes={
                "468": np.arange(count),
                "68": a["scheme_68"],
                "40": a["scheme_40"],
            },
            outline_uv=f["outline_uv"],
            skin=a["skin"].astype(bool),
            eye_centres=f["eye_centres"],
            identity_modes=f["identity_modes"],
            expression_modes=f["expression_modes"],
        )
    except (KeyError, ValueError, OSError, EOFError) as error:
        raise ValueError(
            f"{path} is not a template file ({error}); build one with "
            "tools/build_template.py or leave the template empty."
        ) from error
