"""Where a finished face stands: size, origin and direction of the result.

Photos of an unknown camera fix a face up to a similarity.  The result has its eye
centres on the x axis, the origin midway between them, the wanted eye distance, and the
pitch of the template.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .._types import Array
from .bspline import BSplineSurface
from .template import Template

# Outer and inner corner of the right and of the left eye among the 468 landmarks.
EYE_CORNERS = ((33, 133), (263, 362))


@dataclass(frozen=True, eq=False)
class Similarity:
    """``x -> scale R x + t``."""

    scale: float
    R: Array
    t: Array

    def __call__(self, x: ArrayLike) -> Array:
        """Apply to points ``(..., 3)``."""
        return self.scale * np.asarray(x, float) @ self.R.T + self.t


def fit_similarity(
    source: Array, target: Array, weights: Array | None = None
) -> Similarity:
    """Least-squares similarity of corresponding points (Umeyama, PAMI 1991)."""
    w = np.ones(len(source)) if weights is None else weights
    w = w / w.sum()
    a, b = w @ source, w @ target
    x, y = source - a, target - b
    u, d, vt = np.linalg.svd((y * w[:, None]).T @ x)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    R = (u * sign) @ vt
    scale = float((d * sign).sum() / (w @ (x**2).sum(1)))
    return Similarity(scale, R, b - scale * R @ a)


def eye_centres(surface: BSplineSurface, template: Template) -> Array:
    """Eye centres of a face, ``(2, 3)``, right eye first.

    The surface has lids, not eyeballs: the template's centre is carried over by its
    place relative to the corners of the eye.
    """
    corners = np.array(EYE_CORNERS)
    uv = template.landmark_uv[corners.ravel()]
    here = surface.evaluate(*uv.T).reshape(2, 2, 3)
    there = template.surface.evaluate(*uv.T).reshape(2, 2, 3)
    across = lambda x: np.linalg.norm(x[1].mean(0) - x[0].mean(0))  # noqa: E731
    face = template.surface.evaluate(*template.landmark_uv.T)
    R = fit_similarity(face, surface.evaluate(*template.landmark_uv.T)).R
    offset = template.eye_centres - there.mean(1)
    return here.mean(1) + across(here) / across(there) * offset @ R.T


def eye_distance(surface: BSplineSurface, template: Template) -> float:
    """Distance between the eye centres of a face, mm."""
    return float(np.linalg.norm(np.diff(eye_centres(surface, template), axis=0)))


def relative_size(surface: BSplineSurface, template: Template) -> float:
    """How much larger a face is than the template."""
    return eye_distance(surface, template) / template.eye_distance


def head_frame(
    surface: BSplineSurface, template: Template, eye_distance_mm: float
) -> Similarity:
    """The similarity that brings a face into the frame of results."""
    marks = template.landmark_uv[template.landmark_reliable]
    R = fit_similarity(
        surface.evaluate(*marks.T), template.surface.evaluate(*marks.T)
    ).R
    right, left = eye_centres(surface, template)
    x = R @ (left - right)
    # then turn about y and z until the eyes lie on the x axis
    x /= np.linalg.norm(x)
    up = np.array([0.0, 1.0, 0.0])
    z = np.cross(x, up)
    z /= np.linalg.norm(z)
    y = np.cross(z, x)
    R = np.stack([x, y, z]) @ R
    scale = eye_distance_mm / float(np.linalg.norm(left - right))
    return Similarity(scale, R, -scale * R @ ((left + right) / 2))
