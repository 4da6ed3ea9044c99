"""Camera of a photo: scaled orthography ``q = sRQ + t`` and its perspective refinement.

The paper's camera (section 2.3.1) is the case ``kappa = 0``.  A portrait taken from
1.2 m has nose and ears at visibly different scales, so the default has ``kappa > 0``:

    X = R Q,   pixel = c + (t + s (X_x, -X_y)) / (1 - kappa X_z)

which is a pinhole with principal point ``c`` at the distance ``1 / kappa`` from the
head's origin, written so that ``kappa -> 0`` gives the paper's camera.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from .._types import Array
from ..kinds import coordinates, real_numbers

#: Parameters of `Camera.moved`: rotation vector (3, radians, applied after R), relative
#: scale, shift in millimetres at the head (2), relative change of kappa.
PARAMETERS = 7
#: Indices of the relative change of scale and of kappa, the inverse distance.
SCALE, DISTANCE = 3, 6


@dataclass(frozen=True, eq=False)
class Camera:
    """Pose of the head in one photo.

    Attributes
    ----------
    R : (3, 3) array
        Rotation from head to camera axes; the camera's x is right, y up, z toward it,
        so a frontal face has the identity.
    s : float
        Pixels per millimetre at the head's origin.
    t : (2,) array
        Pixels from the principal point to the projection of the head's origin.
    kappa : float
        1 / distance from the head's origin to the camera, 1/mm; 0 = orthography.
    principal : (2,) array
        Principal point in pixels of the photo, usually the centre of the picture.

    Raises
    ------
    ValueError
        For other shapes, numbers that are not finite, and a scale that is not positive.
    """

    R: Array
    s: float
    t: Array
    kappa: float = 0.0
    principal: Array = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        c = np.zeros(2) if self.principal is None else self.principal
        total = 0.0  # one that is not finite makes the sum so
        for name, value, shape in (
            ("R", self.R, (3, 3)),
            ("s", self.s, ()),
            ("t", self.t, (2,)),
            ("kappa", self.kappa, ()),
            ("principal", c, (2,)),
        ):
            given = np.array(real_numbers(value, name))
            if given.shape != shape:
                wanted = str(shape) if shape else "one number"
                raise ValueError(f"{name} must be {wanted}, not {given.shape}.")
            given.setflags(write=False)
            total += float(given.sum())
            object.__setattr__(self, name, given if shape else float(given))
        if not self.s > 0 or not np.isfinite(total):
            raise ValueError("A camera has finite numbers and a positive scale s.")

    def __setstate__(self, state: dict[str, object]) -> None:
        # Copies and pickles bring arrays that can be written.
        self.__dict__.update(state)
        self.__post_init__()

    def project(self, Q: ArrayLike) -> Array:
        """Pixels ``(..., 2)`` of head points ``Q`` ``(..., 3)`` in mm."""
        Q = coordinates(Q, "Q", 3)
        x, y, _ = self.rows(Q.reshape(-1, 3))
        return np.stack([x, y], axis=1).reshape(*Q.shape[:-1], 2)

    def rows(self, Q: Array) -> Array:
        """Pixels x and y of ``Q`` (n, 3), and how far it is toward the camera in mm.

        Returns
        -------
        (3, n) array
            In rows, because loops over an axis of two are slow.
        """
        X = self.R @ Q.T
        depth = 1 - self.kappa * X[2]
        for k, sign in enumerate((1, -1)):
            X[k] *= sign * self.s
            X[k] += self.t[k]
            X[k] /= depth
            X[k] += self.principal[k]
        return X

    def jacobians(self, Q: ArrayLike) -> tuple[Array, Array, Array]:
        """Projection and its derivatives.

        Parameters
        ----------
        Q : (p, 3) array

        Returns
        -------
        pixels : (p, 2) array
        by_point : (p, 2, 3) array
            Derivative by the head point.
        by_camera : (p, 2, 7) array
            Derivative by the parameters of `moved`.
        """
        Q = coordinates(Q, "Q", 3)
        if Q.ndim != 2:
            raise ValueError(f"Q must be (p, 3), not {Q.shape}.")
        X = Q @ self.R.T
        x, y, z = X.T
        depth = 1 - self.kappa * z
        pixels = np.empty((len(X), 2))
        J = np.zeros((len(X), 2, 3))
        C = np.zeros((len(X), 2, PARAMETERS))
        for k, sign in enumerate((1, -1)):
            scaled = sign * self.s * X[:, k]
            flat = self.t[k] + scaled
            pixels[:, k] = self.principal[k] + flat / depth
            across = sign * self.s / depth
            inward = self.kappa * flat / depth**2
            J[:, k, k] = across
            J[:, k, 2] = inward
            # X moves by omega x X
            by_x, by_y = (across, 0.0) if k == 0 else (0.0, across)
            C[:, k, 0] = inward * y - by_y * z
            C[:, k, 1] = by_x * z - inward * x
            C[:, k, 2] = by_y * x - by_x * y
            C[:, k, 3] = scaled / depth
            C[:, k, 4 + k] = across
            C[:, k, 6] = flat * self.kappa * z / depth**2
        return pixels, J @ self.R, C

    def moved(self, step: ArrayLike) -> Camera:
        """The camera after a step of its 7 parameters (see `PARAMETERS`)."""
        d = np.asarray(step, float)
        return replace(
            self,
            R=Rotation.from_rotvec(d[:3]).as_matrix() @ self.R,
            s=self.s * float(np.exp(d[3])),
            t=self.t + self.s * d[4:6] * (1, -1),
            kappa=self.kappa * float(np.exp(d[6])),
        )

    def toward(self, Q: ArrayLike) -> Array:
        """Unit vectors from head points to the camera, in head axes, ``(..., 3)``."""
        Q = coordinates(Q, "Q", 3)
        if self.kappa == 0:
            return np.broadcast_to(self.R[2], Q.shape)
        # t is the offset of the optical axis from the head, so the camera stands beside
        shift = self.t * (1, -1) / self.s
        centre = self.R.T @ np.array([-shift[0], -shift[1], 1 / self.kappa])
        ray = centre - Q
        return ray / np.linalg.norm(ray, axis=-1, keepdims=True)

    def rescaled(self, factor: float, R: ArrayLike, t: ArrayLike) -> Camera:
        """The same photo after the head moved by ``Q -> factor R Q + t``.

        Projects the moved points to the pixels of the unmoved ones.

        Raises
        ------
        ValueError
            A factor that is not positive, other shapes, or a head behind the camera.
        """
        R, t = real_numbers(R, "R"), real_numbers(t, "t")
        if R.shape != (3, 3) or t.shape != (3,):
            raise ValueError(
                f"R must be (3, 3) and t (3,), not {R.shape} and {t.shape}."
            )
        if not 0 < factor < np.inf:
            raise ValueError(f"factor must be a positive number, not {factor!r}.")
        R_new = self.R @ R.T
        origin = R_new @ t / factor
        depth = 1 + self.kappa * origin[2]
        return replace(
            self,
            R=R_new,
            s=self.s / factor / depth,
            t=(self.t - self.s * origin[:2] * (1, -1)) / depth,
            kappa=self.kappa / factor / depth,
        )

    @property
    def distance_mm(self) -> float:
        """Distance from the head's origin to the camera, infinite for orthography."""
        return 1 / self.kappa if self.kappa > 0 else np.inf

    @property
    def focal_px(self) -> float:
        """Focal length in pixels, infinite for orthography."""
        return self.s * self.distance_mm

    @property
    def yaw_pitch_roll(self) -> Array:
        """Head turned to the picture's right, up, clockwise as seen; degrees, (3,).

        Right and up are those of the picture turned so that the head is upright.
        """
        x, y, z = self.R[:, 2]
        up = self.R[:, 1]
        roll = np.arctan2(up[0], up[1])
        c, s = np.cos(roll), np.sin(roll)
        x, y = c * x - s * y, s * x + c * y
        pitch = np.arcsin(np.clip(y, -1, 1))
        return np.rad2deg([np.arctan2(x, z), pitch, roll])
