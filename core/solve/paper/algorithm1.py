"""Iterative multi-least-square: Algorithm 1 of the paper, as a generator of states.

::

    while b not converged:                              outer pass
        b_0 = b_t
        while b_0 not converged:                        "shading"
            h   = photometric stereo with b_0
            b_0 = Eq. 6, then Eq. 7
        while b_t not converged:                        "motion"
            f, P = poses from b_t
            b    = Eq. 8 around b_0 ;  b_t = b

The four things that a pass does are functions (`Steps`), so one loop runs the paper's
text (`paper_steps`) and any better ingredient in its place.  Whoever consumes the
generator prints, draws, counts or stops; stopping is ceasing to iterate.

Readings of the text
--------------------
* "Converged" is not defined: a loop ends when its surface moves less than a tolerance
  (root mean square over the points that have normals) or after a number of turns.
* ``b`` has no value at the first test of the outer loop; it is the template.
* The poses of the first photometric stereo come from the template.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from ..._types import Array
from ...camera.camera import Camera
from ...errors import PhotoFailure, ReconstructionError
from ...landmarks.observations import LandmarkObservations
from ...surface.bspline import BSplineSurface
from .motion import estimate_poses, warp
from .photometric import RANK, photometric_svd
from .shading import NormalField, NormalRows, ShadingParameters, shading_step

#: Weight of the normal of ``b_t`` where photos do not tell another.
KEPT = 0.1

Cameras = tuple[Camera | PhotoFailure, ...]
Figures = Mapping[str, float]


@dataclass(frozen=True)
class Steps:
    """The four steps of a pass.

    Parameters
    ----------
    poses : (b) -> cameras
        Pose of each photo from a surface; failed photos as `PhotoFailure`.
    photometric : (surface, template, cameras) -> NormalField
        ``b_0``, at which the photos are read, and ``b_t``.
    shading : (b_0, normal field, b_t) -> (b, figures)
    warp : (b_0, cameras) -> (b, figures)

    Control points are flattened, ``(M*N, 3)``.
    """

    poses: Callable[[Array], Cameras]
    photometric: Callable[[BSplineSurface, BSplineSurface, Cameras], NormalField]
    shading: Callable[[Array, NormalField, Array], tuple[Array, Figures]]
    warp: Callable[[Array, Cameras], tuple[Array, Figures]]


@dataclass(frozen=True)
class Limits:
    """Where the three loops stop.

    Parameters
    ----------
    outer, shading, motion : int
        Most turns of each loop.  The alternation of Eq. 6 and 7 creeps after a few
        turns, that of pose and warp needs 15 to 20.
    outer_mm, shading_mm, motion_mm : float
        A loop has converged when its surface moves less than this, root mean square.
        0.03 mm is a tenth of the accuracy of good normals on a face.
    """

    outer: int = 3
    shading: int = 5
    motion: int = 20
    outer_mm: float = 0.03
    shading_mm: float = 0.03
    motion_mm: float = 0.01

    def __post_init__(self) -> None:
        if min(self.outer, self.shading, self.motion) < 1:
            raise ValueError("each loop of Algorithm 1 needs at least one turn")
        if min(self.outer_mm, self.shading_mm, self.motion_mm) < 0:
            raise ValueError("tolerances must not be negative")

    def progress(self, state: State) -> tuple[int, int]:
        """Turns up to a state, those of loops that ended early included, and of all."""
        turns = self.shading + self.motion
        inner = {
            "shading": state.inner,
            "motion": self.shading + state.inner,
            "outer": turns,
        }[state.stage]
        return (state.outer - 1) * turns + inner, self.outer * turns


@dataclass(frozen=True)
class State:
    """One turn of one loop.

    Parameters
    ----------
    stage : {"shading", "motion", "outer"}
        The loop.
    outer, inner : int
        Number of the outer pass and of the turn in the loop, from 1; ``inner`` is 0
        for the states of the outer loop.
    surface : BSplineSurface
        ``b_0`` in the shading loop, ``b_t`` in the motion loop, ``b`` at the end of a
        pass.
    cameras : tuple of Camera or PhotoFailure
    change_mm : float
        Root mean square movement of the surface in this turn, or in this pass.
    figures : mapping
        Residuals of the step: ``normal_rms_deg``, ``landmark_rms_mm``, ``bending``,
        ``condition``.
    converged : bool
        This loop has reached its tolerance.
    last : bool
        This loop ends with this state, converged or at its limit.
    """

    stage: str
    outer: int
    inner: int
    surface: BSplineSurface
    cameras: Cameras
    change_mm: float
    figures: Figures = field(default_factory=lambda: MappingProxyType({}))
    converged: bool = False
    last: bool = False

    @property
    def residual(self) -> float:
        """Of the latest step: normals in degrees ("shading"), else landmarks in mm."""
        shading = self.stage == "shading"
        return self.figures["normal_rms_deg" if shading else "landmark_rms_mm"]

    @property
    def finished(self) -> bool:
        """The algorithm ends with this state."""
        return self.stage == "outer" and self.last


def algorithm1(
    template: BSplineSurface,
    uv: Array,
    steps: Steps,
    limits: Limits | None = None,
) -> Iterator[State]:
    """Algorithm 1.

    Parameters
    ----------
    template : BSplineSurface
        ``b_t``.
    uv : (p, 2) array
        Points at which movement is measured, those of the normals.
    steps : Steps
        See `paper_steps`.
    limits : Limits, optional

    Yields
    ------
    State
        After each turn of each loop; the last one is ``finished``.

    Raises
    ------
    ReconstructionError
        When no photo can be posed or a linear system has no solution.
    """
    limits = limits or Limits()
    shape = template.shape
    T = template.matrix(*np.asarray(uv, float).T)

    def moved(new: Array, old: Array) -> float:
        return float(np.sqrt(np.mean(np.sum((T @ (new - old)) ** 2, 1))))

    def surface(b: Array) -> BSplineSurface:
        return BSplineSurface(b.reshape(*shape, 3))

    bt = b = template.vector
    for outer in range(1, limits.outer + 1):
        start = b
        b0 = bt
        cameras = _posed(steps.poses(bt))
        for inner in range(1, limits.shading + 1):
            normals = steps.photometric(surface(b0), surface(bt), cameras)
            old = b0
            with singular_reported():
                b0, figures = steps.shading(b0, normals, bt)
            change = moved(b0, old)
            done = change < limits.shading_mm
            state = State(
                stage="shading",
                outer=outer,
                inner=inner,
                surface=surface(b0),
                cameras=cameras,
                change_mm=change,
                figures=figures,
                converged=done,
                last=done or inner == limits.shading,
            )
            yield state
            if state.last:
                break
        for inner in range(1, limits.motion + 1):
            cameras = _posed(steps.poses(bt))
            old = bt
            with singular_reported():
                b, figures = steps.warp(b0, cameras)
            bt = b
            change = moved(bt, old)
            # The first turn also brings the shading in, so it never ends the loop.
            done = change < limits.motion_mm and inner > 1
            state = State(
                stage="motion",
                outer=outer,
                inner=inner,
                surface=surface(bt),
                cameras=cameras,
                change_mm=change,
                figures=figures,
                converged=done,
                last=done or inner == limits.motion,
            )
            yield state
            if state.last:
                break
        change = moved(b, start)
        done = change < limits.outer_mm
        final = replace(
            state,
            stage="outer",
            inner=0,
            change_mm=change,
            converged=done,
            last=done or outer == limits.outer,
        )
        yield final
        if final.last:
            return


def paper_steps(
    landmarks: LandmarkObservations,
    shape: tuple[int, int],
    uv: Array,
    sample: Callable[[BSplineSurface, Cameras], tuple[Array, Array]],
    *,
    zeta: float = 1e-3,
    shading: ShadingParameters | None = None,
    kept: Array | None = None,
) -> Steps:
    """The steps as the paper describes them.

    Parameters
    ----------
    landmarks : LandmarkObservations
        ``q`` of all photos and ``(u(i), v(i))``.
    shape : (M, N)
    uv : (p, 2) array
        Points that get a normal, the ``p`` "pixels" of ``M``.
    sample : (surface, cameras) -> (M, weights)
        Intensities and visibility at ``uv``, (n, p) each; a photo whose camera is a
        failure sees nothing.
    zeta : float
        Of Eq. 8; see `warp`.
    shading : ShadingParameters, optional
        ``lambda`` and the frontal constraint of Eq. 6 and 7.
    kept : (k, 2) array, optional
        Points that no photo tells of (eyes, mouth, the rim): like points of which
        fewer than four photos tell they keep the normal of ``b_t``, with the weight
        `KEPT`. The text has no equation for the control points there.

    Returns
    -------
    Steps
        To replace one of them: ``dataclasses.replace(steps, photometric=...)``.
    """
    uv = np.asarray(uv, float)
    kept = np.zeros((0, 2)) if kept is None else np.asarray(kept, float)
    rows = NormalRows.at(shape, np.concatenate([uv, kept]))

    def photometric(
        surface: BSplineSurface, template: BSplineSurface, cameras: Cameras
    ) -> NormalField:
        M, weights = sample(surface, cameras)
        # S^t of b_t as in section 2.2.1, not of b_0 as in Algorithm 1, where each error
        # of the normals becomes the next reference.
        own = template.normals(*uv.T)
        result = photometric_svd(M, weights, own)
        known = result.chosen.sum(0) >= RANK
        h = np.where(known[:, None], result.normals, own)
        return NormalField(
            np.concatenate([h, template.normals(*kept.T)]),
            np.concatenate([np.where(known, 1.0, KEPT), np.full(len(kept), KEPT)]),
        )

    return Steps(
        poses=lambda b: estimate_poses(b, shape, landmarks),
        photometric=photometric,
        shading=lambda b0, normals, bt: shading_step(b0, normals, bt, rows, shading),
        warp=lambda b0, cameras: warp(b0, shape, cameras, landmarks, zeta),
    )


def _posed(cameras: Sequence[Camera | PhotoFailure]) -> Cameras:
    if not any(isinstance(camera, Camera) for camera in cameras):
        reasons = " ".join(c.reason for c in cameras if isinstance(c, PhotoFailure))
        raise ReconstructionError(f"No photo could be posed. {reasons}".strip())
    return tuple(cameras)


@contextlib.contextmanager
def singular_reported() -> Iterator[None]:
    """A system without a solution, as a sentence."""
    try:
        yield
    except np.linalg.LinAlgError as error:
        raise ReconstructionError(
            f"A linear system of Algorithm 1 has no solution ({error}); use a larger "
            "weight of the regularisation or the method 'joint'."
        ) from error
