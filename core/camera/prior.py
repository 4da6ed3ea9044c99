"""What is known of a camera before its photo is looked at: about how far it stood."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._types import Array
from .camera import DISTANCE, PARAMETERS, Camera

#: Standard deviation of the logarithm of the distance, in all stages.
SPREAD = 0.35


@dataclass(frozen=True)
class CameraPrior:
    """Gaussian prior of the parameters of `Camera.moved`.

    Only the distance has one; the others get a little damping, which changes nothing
    where the photo determines them.

    Attributes
    ----------
    distance_mm : float
        Typical distance between camera and head; infinite for orthography.
    spread : float
        Standard deviation of the logarithm of the distance.
    damping : float
        Precision of a step of the other parameters.
    """

    distance_mm: float = 1200.0
    spread: float = SPREAD
    damping: float = 1e-9

    def precision(self) -> Array:
        """Prior precision of each parameter, ``(7,)``."""
        p = np.full(PARAMETERS, self.damping)
        p[DISTANCE] = 1 / self.spread**2
        return p

    def pull(self, camera: Camera) -> Array:
        """Right side of a Gauss-Newton step: precision times the way to the mean."""
        g = np.zeros(PARAMETERS)
        if camera.kappa > 0:
            away = np.log(camera.kappa * self.distance_mm)
            g[DISTANCE] = -away / self.spread**2
        return g
