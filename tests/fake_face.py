"""A small made-up reconstruction for the tests of the output modules.

The face is an ellipsoidal cap with a nose, seen by orthographic cameras of known
pose, and its photos are drawn from a known texture under known light: everything
that an output module derives from it can be checked.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
from bsface.surface.bspline import BSplineSurface


def face_surface(shape: tuple[int, int] = (16, 18), nose: float = 12.0):
    """Ellipsoidal cap, 140 x 180 mm, about 60 mm deep, with a bump for a nose."""
    m, n = shape
    # Greville abscissae of the uniform knots: control point i sits at (i - 1)/(m - 3).
    u = (np.arange(m) - 1) / (m - 3)
    v = (np.arange(n) - 1) / (n - 3)
    u, v = np.meshgrid(u, v, indexing="ij")
    x, y = 140 * (u - 0.5), 180 * (0.5 - v) - 20
    r2 = ((u - 0.5) / 0.72) ** 2 + ((v - 0.5) / 0.75) ** 2
    z = 75 * np.sqrt(np.maximum(1 - r2, 0.02)) - 50
    z = z + nose * np.exp(-(((u - 0.5) / 0.09) ** 2) - ((v - 0.52) / 0.11) ** 2)
    return BSplineSurface(np.stack([x, y, z], axis=-1))


def ellipse_outline(count: int = 60) -> np.ndarray:
    """Closed polygon (count, 2) in (u, v), counter-clockwise on the page."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return 0.5 + np.stack([0.44 * np.cos(angle), 0.46 * np.sin(angle)], axis=1)


def face_template(surface: BSplineSurface | None = None) -> SimpleNamespace:
    """What the outputs read of a template: its outline and its surface."""
    return SimpleNamespace(
        surface=surface or face_surface(nose=8.0),
        outline_uv=ellipse_outline(),
        landmark_uv=np.stack(
            np.meshgrid(np.linspace(0.2, 0.8, 6), np.linspace(0.2, 0.8, 5)), axis=-1
        ).reshape(-1, 2),
        schemes={"30": np.arange(30)},
    )


@dataclass(frozen=True)
class FakeSettings:
    eye_distance_mm: float = 62.0
    method: str = "joint"

    def to_dict(self) -> dict[str, Any]:
        return {"eye_distance_mm": self.eye_distance_mm, "method": self.method}


@dataclass(frozen=True)
class FakeReconstruction:
    """The fields of ``Reconstruction`` that outputs read."""

    surface: BSplineSurface
    template: Any
    photos: tuple = ()
    landmarks: tuple = ()
    cameras: tuple = ()
    photometric: Any = None
    reports: tuple = ()
    confidence: Any = None
    settings: Any = field(default_factory=FakeSettings)
    history: tuple = ()
    warnings: tuple = ()
    seconds: dict = field(default_factory=dict)


def bare_reconstruction() -> FakeReconstruction:
    """Only what every reconstruction has."""
    surface = face_surface()
    return FakeReconstruction(surface=surface, template=face_template(surface))
