"""What is known of a camera before its photo is looked at: about how far it stood."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .._types import Array
from .camera import DISTANCE, PARAMETERS, SCALE, Camera

#: Standard deviation of the logarithm of the distance, in all stages.
SPREAD = 0.35
#: The same of a focal length that the file of a photo names: lenses are rounded to
#: whole millimetres of 35 mm film, and not every crop shows.
FOCAL_SPREAD = 0.1


@dataclass(frozen=True)
class CameraPrior:
    """Gaussian prior of the parameters of `Camera.moved`.

    Only the distance has one, or the focal length in its place where it is known; the
    others get a little damping, which changes nothing where the photo determines them.

    Attributes
    ----------
    distance_mm : float
        Typical distance between camera and head; infinite for orthography.
    spread : float
        Standard deviation of the logarithm of the distance.
    damping : float
        Precision of a step of the other parameters.
    focal_px : float or None
        Focal length of the photo, pixels. With the size of the face in the picture it
        gives the distance, so the typical one is not asked any more.
    """

    distance_mm: float = 1200.0
    spread: float = SPREAD
    damping: float = 1e-9
    focal_px: float | None = None

    def of_photo(self, focal_px: float | None) -> CameraPrior:
        """The prior of a photo with this focal length; None = it is not known."""
        return replace(self, focal_px=focal_px)

    def kappa(self, s: float) -> float:
        """The most likely inverse distance of a camera of scale ``s``, 1/mm."""
        if self.focal_px is None or np.isinf(self.distance_mm):
            return 1 / self.distance_mm
        return s / self.focal_px

    def precision(self) -> Array:
        """Prior precision of the parameters, ``(7, 7)``."""
        row = self._derivative()
        return self.damping * np.eye(PARAMETERS) + np.outer(row, row)

    def pull(self, camera: Camera) -> Array:
        """Right side of a Gauss-Newton step: precision times the way to the mean."""
        if camera.kappa == 0:
            return np.zeros(PARAMETERS)
        away = float(np.log(camera.kappa / self.kappa(camera.s)))
        return -self._derivative() * away / self._deviation

    @property
    def _deviation(self) -> float:
        return self.spread if self.focal_px is None else FOCAL_SPREAD

    def _derivative(self) -> Array:
        """Of ``log(kappa / kappa(s))`` in standard deviations, by the parameters."""
        row = np.zeros(PARAMETERS)
        row[DISTANCE] = 1 / self._deviation
        if self.focal_px is not None:
            row[SCALE] = -1 / self._deviation
        return row
