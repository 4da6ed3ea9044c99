"""The truth of a rendered set in the program's own terms: surface, cameras, landmarks.

All of it is brought into the template's frame by the similarity that aligns the two
surfaces, so that it can stand in for what the program estimates.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType

import numpy as np
from _sets import FaceSet
from bsface.camera.camera import Camera
from bsface.landmarks.landmarks import Landmarks
from bsface.problem import PhotoCollection
from bsface.surface.bspline import BSplineSurface, basis_matrix
from bsface.surface.prior import ShapePrior
from bsface.surface.template import Template
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

Array = NDArray[np.float64]

#: From OpenCV's axes (y down, z away) to those of `Camera`.
FLIP = np.diag([1.0, -1.0, -1.0])
#: Standard deviation of the fit's distances, mm: far below any error that is measured.
FIT_MM = 0.15
SAMPLES = 70
STEPS = 12


@dataclass(frozen=True)
class Truth:
    """A ground-truth face as the template's net.

    Attributes
    ----------
    surface : BSplineSurface
        Fitted to the mesh, in the template's frame.
    modes, smooth : (k,), (M*N, 3) arrays
        Its two parts by the prior.
    move : (scale, R, t)
        From the template's frame to that of the mesh.
    """

    surface: BSplineSurface
    modes: Array
    smooth: Array
    move: tuple[float, Array, Array]


def fit_truth(
    measure: ModuleType, of: FaceSet, template: Template, prior: ShapePrior
) -> Truth:
    """Fit the template's net to the mesh, closest points by their tangent planes.

    The prior decides what the mesh leaves open: how the parameters slide, and the net
    at eyes and nostrils.  The landmarks pull at first and then fade out, as those of
    another family of heads do not mean the same points of the skin.
    """
    points = np.asarray(of.truth["vertices"], float)
    uv = template.landmark_uv[template.schemes["68"][17:]]
    marks = points[np.asarray(of.truth["landmark_indices"], int)][17:]
    mesh = measure.Surface(points, of.truth["triangles"])
    move = measure.similarity(template.surface.evaluate(*uv.T), marks)
    found = _fit(mesh, marks, template, prior, move)
    # A prior of displacements charges for shift, turn and size as for shape: where the
    # cameras are held nothing else can take them up, so the whole face decides.
    uv = _skin(template)
    scale, R, t = move
    true = scale * found.surface.evaluate(*uv.T) @ R.T + t
    move = measure.similarity(template.surface.evaluate(*uv.T), true)
    return _fit(mesh, marks, template, prior, move)


def _skin(template: Template) -> Array:
    x = (np.arange(SAMPLES) + 0.5) / SAMPLES
    uv = np.stack(np.meshgrid(x, x, indexing="ij"), -1).reshape(-1, 2)
    return uv[template.is_skin(uv)]


def _fit(mesh, marks: Array, template: Template, prior: ShapePrior, move) -> Truth:
    """The fit in a given frame."""
    scale, R, t = move
    first = template.surface
    uv_marks = template.landmark_uv[template.schemes["68"][17:]]
    marks = (marks - t) @ R / scale
    uv = _skin(template)
    on_skin = sparse.kron(basis_matrix(first.shape, *uv.T), sparse.eye(3)).tocsr()
    on_marks = sparse.kron(basis_matrix(first.shape, *uv_marks.T), sparse.eye(3))
    smooth = sparse.kron(prior.smooth, sparse.eye(3))
    count = len(prior.modes)
    D = prior.modes.reshape(count, -1).T
    d, a = np.zeros(len(D)), np.zeros(count)
    surface = first
    for step in range(STEPS):
        at, normals = surface.evaluate(*uv.T), surface.normals(*uv.T)
        away, near, along = mesh.closest(scale * at @ R.T + t)
        near, along = (near - t) @ R / scale, along @ R
        used = (away < 12 * 0.7**step + 2.5) & ((along * normals).sum(1) > 0.5)
        # neighbouring samples say much the same: one in fifty counts
        w = np.where(used, 0.02 / FIT_MM**2, 0.0)
        pull = 0.3 * 0.6**step
        rows = sparse.csr_array(
            (along.ravel(), np.arange(along.size), 3 * np.arange(len(uv) + 1)),
            shape=(len(uv), along.size),
        )
        A = rows @ on_skin
        rest = (marks - surface.evaluate(*uv_marks.T)).ravel()
        H = A.T @ sparse.diags_array(w) @ A + pull * (on_marks.T @ on_marks)
        g = A.T @ (w * ((near - at) * along).sum(1)) + pull * (on_marks.T @ rest)
        HD = H @ D
        solve = splu(sparse.csc_array(H + smooth), permc_spec="MMD_AT_PLUS_A").solve
        Z = solve(np.column_stack([HD, g - smooth @ d]))
        da = np.linalg.solve(
            D.T @ HD + np.eye(count) - HD.T @ Z[:, :-1],
            D.T @ g - a - HD.T @ Z[:, -1],
        )
        d, a = d + Z[:, -1] - Z[:, :-1] @ da, a + da
        moved = first.control_points + (d + D @ a).reshape(first.control_points.shape)
        surface = BSplineSurface(moved)
    return Truth(surface, a, d.reshape(-1, 3), (scale, R, t))


def true_cameras(folder: Path, names: Sequence[str], truth: Truth) -> list[Camera]:
    """The cameras of ``cameras.json`` in the template's frame, for photos by name."""
    scale, R, t = truth.move
    listed = json.loads((folder / "cameras.json").read_text("utf-8"))["images"]
    found = {}
    for one in listed:
        K, turn, shift = (np.array(one[k], float) for k in ("K", "R", "t"))
        camera = Camera(
            FLIP @ turn,
            K[0, 0] / shift[2],
            K[0, 0] * shift[:2] / shift[2],
            1 / shift[2],
            K[:2, 2],
        )
        name = Path(one["file"]).name
        found[name] = camera.rescaled(1 / scale, R.T, -(R.T @ t) / scale)
    return [found[Path(name).name] for name in names]


def true_landmarks(
    collection: PhotoCollection,
    template: Template,
    truth: Truth,
    cameras: Sequence[Camera],
) -> tuple[PhotoCollection, Template]:
    """Perfect correspondences: the truth's own 468 surface points, projected.

    The template that belongs to them says so: its landmarks lie on the surface, all of
    them are reliable, and none scatters.
    """
    points = truth.surface.evaluate(*template.landmark_uv.T)
    marks = tuple(
        Landmarks(photo.name, "468", camera.project(points), np.ones(len(points)))
        for photo, camera in zip(collection.photos, cameras, strict=True)
    )
    exact = replace(
        template,
        landmark_xyz=template.surface.evaluate(*template.landmark_uv.T),
        landmark_sigma=np.full(len(points), 0.1),
        landmark_reliable=np.ones(len(points), bool),
    )
    return replace(collection, landmarks=marks), exact


def true_template(template: Template, truth: Truth) -> Template:
    """The template with the truth in the place of its surface."""
    uv = template.landmark_uv
    moved = truth.surface.evaluate(*uv.T) - template.surface.evaluate(*uv.T)
    return replace(
        template,
        surface=truth.surface,
        landmark_xyz=template.landmark_xyz + moved,
    )
