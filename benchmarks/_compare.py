"""Comparing faces without ground truth: with each other, and with photos not used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from bsface.camera.camera import PARAMETERS, Camera
from bsface.camera.linear_pose import linear_pose
from bsface.landmarks.landmarks import Landmarks
from bsface.surface.alignment import fit_similarity
from bsface.surface.bspline import BSplineSurface, basis_matrix
from bsface.surface.template import Template
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Rotation, scale and shift among the camera's parameters.  The distance stays: fitted
#: to one photo it takes up expressions rather than perspective.
POSE = 6


# ------------------------------------------------------------ faces with each other
def face_parameters(template: Template, count: int = 80) -> Array:
    """Parameters (p, 2) of a regular grid within the outline: the common region."""
    x = (np.arange(count) + 0.5) / count
    uv = np.stack(np.meshgrid(x, x, indexing="ij"), -1).reshape(-1, 2)
    return uv[template.inside(uv)]


def area_weights(surface: BSplineSurface, uv: Array) -> Array:
    """Area of the surface that each of regular parameters stands for, sum 1, (p,)."""
    cross = np.cross(
        surface.evaluate(*uv.T, du=1), surface.evaluate(*uv.T, dv=1), axis=1
    )
    area = np.linalg.norm(cross, axis=1)
    return area / area.sum()


def point_distance(
    a: Array, b: Array, eye_distance: float, weights: Array | None = None
) -> float:
    """Mean distance of corresponding points after a similarity, % of the eye distance.

    Parameters
    ----------
    a, b : (p, 3) arrays
        ``b`` has the eye distance ``eye_distance``.
    weights : (p,) array, optional
    """
    moved = fit_similarity(a, b, weights)(a)
    away = np.linalg.norm(moved - b, axis=1)
    return float(100 * np.average(away, weights=weights) / eye_distance)


def surface_distance(
    a: BSplineSurface, b: BSplineSurface, uv: Array, eye_distance: float
) -> float:
    """Mean distance from ``a`` to ``b`` after a similarity, % of the eye distance.

    Parameters
    ----------
    a, b : BSplineSurface
        Aligned by their points at the same parameters; the distance is that to the
        closest point of ``b``, so sliding along the surface costs nothing.
    uv : (p, 2) array
        The region.
    eye_distance : float
        Of ``b``, mm.
    """
    weights = area_weights(b, uv)
    points = a.evaluate(*uv.T)
    move = fit_similarity(points, b.evaluate(*uv.T), weights)
    _, away = b.closest_point(move(points))
    return float(100 * np.average(away, weights=weights) / eye_distance)


def within_between(first: Sequence, second: Sequence, distance) -> dict[str, float]:
    """Distances between the halves of people's photos.

    Parameters
    ----------
    first, second : sequences of k faces
        From the first and from the second half of each person's photos.
    distance : callable
        (face, face) -> number; both ways are averaged.

    Returns
    -------
    dict
        ``within`` and ``between`` (means), ``within_max``, ``between_min``, ``ratio``
        of the means, ``matched``: people whose halves are nearest to each other from
        both sides, ``people``.
    """
    table = np.array(
        [[(distance(a, b) + distance(b, a)) / 2 for b in second] for a in first]
    )
    k = len(table)
    own = np.eye(k, dtype=bool)
    matched = (table.argmin(1) == np.arange(k)) & (table.argmin(0) == np.arange(k))
    within, between = table[own], table[~own]
    return {
        "within": float(within.mean()),
        "within_max": float(within.max()),
        "between": float(between.mean()) if k > 1 else float("nan"),
        "between_min": float(between.min()) if k > 1 else float("nan"),
        "ratio": float(between.mean() / within.mean()) if k > 1 else float("nan"),
        "matched": float(matched.sum()),
        "people": float(k),
    }


# ---------------------------------------------------------- faces with other photos
def landmark_points(surface: BSplineSurface, template: Template) -> Array:
    """Where the detector sees the landmarks of a face, (468, 3).

    The surface's points, with the offsets that the detections have from the template's
    own surface, turned and scaled with the face.
    """
    T = basis_matrix(template.surface.shape, *template.landmark_uv.T)
    there = T @ template.surface.control_points.reshape(-1, 3)
    here = surface.evaluate(*template.landmark_uv.T)
    move = fit_similarity(there, here)
    offset = template.landmark_xyz - there
    return here + move.scale * offset @ move.R.T


def pose_only(
    Q: Array,
    marks: Landmarks,
    size: tuple[int, int],
    weight: Array,
    distance_mm: float,
    rounds: int = 15,
) -> Camera:
    """Camera of a photo for a fixed face.

    Parameters
    ----------
    Q : (468, 3) array
        Landmarks of the face, mm.
    marks : Landmarks
        Of the scheme "468".
    size : (width, height)
        Of the photo.
    weight : (468,) array
        0 leaves a landmark out.
    distance_mm : float
        Distance of the camera, the same for all photos.
    """
    middle = ((size[0] - 1) / 2, (size[1] - 1) / 2)
    start = linear_pose(marks.points, Q, weight, middle, marks.photo)
    if not isinstance(start, Camera):
        raise ValueError(start.reason)
    camera = replace(start, kappa=1 / distance_mm)
    used = weight > 0
    for _ in range(rounds):
        p, _, C = camera.jacobians(Q[used])
        r = (marks.points[used] - p) / camera.s
        C = C[..., :POSE] / camera.s
        A = np.einsum("lxa,l,lxb->ab", C, weight[used], C)
        b = np.einsum("lxa,l,lx->a", C, weight[used], r)
        step = np.zeros(PARAMETERS)
        step[:POSE] = np.linalg.solve(A, b)
        camera = camera.moved(step)
        if np.abs(step).max() < 1e-7:
            break
    return camera


def held_out_residual(
    Q: Array,
    marks: Landmarks,
    size: tuple[int, int],
    weight: Array,
    eye_px: float,
    distance_mm: float,
) -> float:
    """Landmarks of a photo against a face that did not see it, % of the eye distance.

    Parameters
    ----------
    Q, marks, size, weight, distance_mm
        As in `pose_only`.
    eye_px : float
        Eye distance in the photo, the same for all faces that are compared.

    Returns
    -------
    float
        Weighted mean of the distances.
    """
    camera = pose_only(Q, marks, size, weight, distance_mm)
    away = np.linalg.norm(camera.project(Q) - marks.points, axis=1)
    return float(100 * np.average(away, weights=weight) / eye_px)
