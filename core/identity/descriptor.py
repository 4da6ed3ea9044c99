"""What a face looks like apart from pose and light, and how alike two photos are.

Each photo is read at a grid of places of the face, through triangles between its
landmarks, so that pose and much of the expression drop out.  Of the logarithm of the
intensity only the contrast with the close surroundings is kept, measured by its own
spread: light, exposure and skin tone drop out, and lines, folds and edges stay (brows,
lids, wings of the nose).  Any two faces share most of such a pattern, so the pattern of
faces in general is subtracted before patterns are correlated; what is left is what
makes the person.  Places count the less, the more one person's pattern varies there
with light, pose and expression; the lower half counts less once more, because smiling
draws folds there.

The general pattern and its variance are averages over pictures of several people and
their mirror images (``tools/build_patterns.py``).  All of them are rendered: no photo
of anybody is in what is stored.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from ..camera.camera import Camera
from ..camera.linear_pose import linear_pose
from ..images.photo import Photo
from ..images.remap import read_between
from ..landmarks.landmarks import Landmarks
from ..photometry.sampling import LUMINANCE
from ..surface.template import Template, load_template

Array = NDArray[np.float64]
Maps = NDArray[np.float32]

PATTERNS = Path(__file__).resolve().parents[1] / "data" / "patterns.npz"
SIDE = 96  # cells of the grid; 58 of them between the outer corners of the eyes
OUTER_CORNERS = (33, 263)
SURROUNDINGS = 2.0  # Gaussian over which contrast is measured, cells
FACING = 0.25  # cosine below which a cell counts as turned away
BELOW_NOSE = 56  # row of the grid from which a cell counts `LOWER`
LOWER = 0.5
GENERAL = 0.9  # part of the general pattern that is subtracted
# Likeness to the pattern without a person over that to the others: 0.74 to 0.86 for
# photos of that person, 0.91 and more for people who are in none.
KNOWN = 0.88
STEADY = 0.02  # variance within a person below which places count alike
VARIANCE_SMOOTH = 1.5  # of the variance, few people tell it; cells


@dataclass(frozen=True, eq=False)
class Appearance:
    """What some photos show of the face.

    Attributes
    ----------
    pattern : (n, SIDE, SIDE) float32 array
        Contrast with the surroundings, -1 to 1; 0 where nothing is seen.
    weight : (n, SIDE, SIDE) float32 array
        0 = not seen, else the cosine of the viewing angle.
    """

    pattern: Maps
    weight: Maps


@dataclass(frozen=True, eq=False)
class MeanAppearance:
    """What faces in general show.

    Attributes
    ----------
    mean : (m, SIDE, SIDE) float32 array
        Patterns, each an average over some people: if m > 1, over all but one.
    variance : (SIDE, SIDE) float32 array
        Of one person's pattern over photos.
    """

    mean: Maps
    variance: Maps


def describe_appearance(
    photos: Sequence[Photo], landmarks: Sequence[Landmarks]
) -> Appearance:
    """The patterns of photos; landmarks must be those of the scheme 468."""
    shape = (len(photos), SIDE, SIDE)
    pattern, weight = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    for i, (photo, marks) in enumerate(zip(photos, landmarks, strict=True)):
        grey, seen = _read(photo, marks)
        pattern[i], weight[i] = _contrast(grey, seen), seen
    return Appearance(pattern, weight)


def similarity(
    seen: Appearance, general: MeanAppearance | None = None
) -> tuple[Array, Array]:
    """How alike the faces of any two photos are.

    Parameters
    ----------
    seen : Appearance
    general : General, optional
        Faces in general; by default those stored.

    Returns
    -------
    correlation : (n, n) array
        Of what is left without the general pattern, where both photos see the face.
    overlap : (n, n) array
        How much both see, 0 to 1; 0 on the diagonal.
    """
    general = stored_mean_appearance() if general is None else general
    n = len(seen.pattern)
    w = seen.weight / (general.variance + STEADY).astype(float)
    w[:, BELOW_NOSE:] *= LOWER
    x = seen.pattern - GENERAL * _unlike(seen.pattern, w, general.mean)
    x, w = x.reshape(n, -1), w.reshape(n, -1)
    weighted = w * x
    energy = (weighted * x) @ w.T
    correlation = weighted @ weighted.T / np.sqrt(energy * energy.T + 1e-9)
    overlap = w @ w.T
    own = np.sqrt(np.maximum(np.diag(overlap), 1e-9))
    overlap = overlap / np.outer(own, own)
    np.fill_diagonal(overlap, 0.0)
    return correlation, overlap


@lru_cache(maxsize=1)
def stored_mean_appearance() -> MeanAppearance:
    """The stored patterns of faces in general."""
    with np.load(PATTERNS, allow_pickle=False) as stored:
        mean = stored["mean"].astype(np.float32) / 100
        variance = stored["variance"].astype(np.float32) / 200
    return MeanAppearance(_whole(mean), _whole(variance))


def _whole(half: Maps) -> Maps:
    return np.concatenate([half, half[..., ::-1]], -1)


def mean_pattern(sets: Sequence[Appearance]) -> Maps:
    """Pattern of one person: mean over sets of photos and mirror images."""
    mean = np.mean([_mean(s) for s in sets], 0, dtype=np.float32)
    return np.asarray((mean + mean[:, ::-1]) / 2, np.float32)


def pattern_variance(sets: Sequence[Appearance]) -> Maps:
    """Variance within the sets of one person, mean over them and mirror images."""
    each = [_mean(Appearance((s.pattern - _mean(s)) ** 2, s.weight)) for s in sets]
    mean = np.mean(each, 0, dtype=np.float32)
    return np.asarray((mean + mean[:, ::-1]) / 2, np.float32)


def _mean(seen: Appearance) -> Maps:
    total = (seen.weight * seen.pattern).sum(0)
    return np.asarray(total / (seen.weight.sum(0) + 1e-3), np.float32)


def general_of(
    people: Sequence[tuple[Maps, Maps]], members: bool = False
) -> MeanAppearance:
    """Faces in general from the mean patterns and variances of people.

    Parameters
    ----------
    people : sequence of (mean, variance)
        See `mean_pattern`, `pattern_variance`.  Every person counts the same.
    members : bool
        As many patterns as people, each without one of them, instead of one pattern.
    """
    means = np.stack([mean for mean, _ in people])
    variance = np.mean([v for _, v in people], 0, dtype=np.float32)
    mean = means.mean(0, keepdims=True)
    if members:
        mean = (means.sum(0) - means) / (len(means) - 1)
    smooth = cv2.GaussianBlur(variance, (0, 0), VARIANCE_SMOOTH)
    return MeanAppearance(
        np.asarray(mean, np.float32),
        np.asarray((smooth + smooth[:, ::-1]) / 2, np.float32),
    )


def _unlike(pattern: Maps, weight: Array, members: Maps) -> Maps:
    """The mean of the members, or that without the person of the photos.

    If the photos are much less like one member than like the others, the person is one
    of those that the patterns are made of, and that member is without the person.
    """
    mean = ((weight * pattern).sum(0) / (weight.sum(0) + 0.5)).ravel()
    w = weight.mean(0).ravel()
    flat = members.reshape(len(members), -1)
    along = (flat * w) @ mean / np.sqrt((flat**2 * w).sum(1) + 1e-9)
    least, *others = np.argsort(along)
    if others and along[least] < KNOWN * along[others[0]]:
        return np.asarray(members[least], np.float32)
    return np.asarray(members.mean(0), np.float32)


@dataclass(frozen=True, eq=False)
class _Grid:
    """Where the cells lie among the landmarks of the bundled template."""

    template: Template
    corner: NDArray[np.int64]  # (SIDE * SIDE, 3) landmarks about each cell
    share: Array  # (SIDE * SIDE, 3) barycentric
    inside: NDArray[np.bool_]  # (SIDE * SIDE,)
    normals: Array  # (SIDE * SIDE, 3)
    eye_cells: float


@lru_cache(maxsize=1)
def _grid() -> _Grid:
    # A template of the user's may have other parameters; the patterns have these.
    template = load_template()
    uv = template.landmark_uv
    known = uv[template.landmark_reliable]
    low, high = known.min(0), known.max(0)
    steps = np.linspace(0, 1, SIDE)
    u, v = np.meshgrid(*(low + (high - low) * steps[:, None]).T)
    cells = np.stack([u.ravel(), v.ravel()], 1)
    corner, share, inside = _locate(cells, uv, Delaunay(uv).simplices)
    right, left = OUTER_CORNERS
    return _Grid(
        template,
        corner,
        share,
        inside,
        template.surface.normals(*cells.T),
        float(abs(uv[left, 0] - uv[right, 0]) / (high - low)[0] * SIDE),
    )


def _locate(cells: Array, uv: Array, triangles: NDArray[np.int32]):
    """The triangle about each cell and the cell's barycentric coordinates there.

    By hand: `Delaunay.find_simplex` factors each triangle by LAPACK, which takes many
    seconds where the algebra library starts its threads anew each time.
    """
    corner = np.zeros((len(cells), 3), np.int64)
    share, inside = np.zeros((len(cells), 3)), np.zeros(len(cells), bool)
    for triangle in triangles:
        a, b, c = uv[triangle]
        (e, f), (g, h) = a - c, b - c
        area = e * h - f * g
        x, y = (cells - c).T
        one, two = (h * x - g * y) / area, (e * y - f * x) / area
        part = np.stack([one, two, 1 - one - two], 1)
        within = (part >= -1e-9).all(1)
        corner[within], share[within] = triangle, part[within]
        inside |= within
    return corner, share, inside


def _read(photo: Photo, marks: Landmarks) -> tuple[Maps, Maps]:
    """Linear intensity at the cells, and how well they are seen."""
    grid = _grid()
    template = grid.template
    points = photo.to_window(marks.points)
    image = photo.linear() @ LUMINANCE
    right, left = OUTER_CORNERS
    shrink = float(np.linalg.norm(points[left] - points[right])) / grid.eye_cells
    if shrink > 1:
        image = cv2.GaussianBlur(image, (0, 0), 0.5 * shrink)
    xy = np.einsum("pk,pkx->px", grid.share, points[grid.corner]).astype(np.float32)
    xy = xy.reshape(SIDE, SIDE, 2)
    grey = read_between(image, xy, cv2.BORDER_CONSTANT)
    h, w = image.shape
    seen = ((xy > 0) & (xy < (w - 1, h - 1))).all(2) & grid.inside.reshape(SIDE, SIDE)
    weight = np.where(template.landmark_reliable, marks.weight, 0.0)
    pose = linear_pose(marks.points, template.landmark_xyz, weight)
    if not isinstance(pose, Camera):
        return np.asarray(grey, np.float32), np.zeros((SIDE, SIDE), np.float32)
    cosine = (grid.normals @ pose.R[2]).reshape(SIDE, SIDE)
    shown = (seen & (cosine > FACING)).astype(np.float32)
    shown = cv2.erode(shown, np.ones((3, 3), np.uint8))
    return np.asarray(grey, np.float32), (shown * cosine).astype(np.float32)


def _contrast(grey: Maps, weight: Maps) -> Maps:
    """Difference from the surroundings in units of its spread there, -1 to 1."""
    seen = (weight > 0).astype(np.float32)

    def smooth(image: Maps) -> Maps:
        return np.asarray(cv2.GaussianBlur(image, (0, 0), SURROUNDINGS), np.float32)

    area = smooth(seen) + 1e-3
    log = np.where(seen > 0, np.log(grey + 0.02), 0).astype(np.float32)
    detail = (log - smooth(log * seen) / area) * seen
    spread = np.sqrt(smooth(detail**2) / area + 1e-4)
    return np.asarray(np.tanh(detail / spread) * seen, np.float32)
