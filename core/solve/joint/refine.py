"""Shading and motion in one linearised system over all photos.

The paper alternates between normals (1st order) and landmarks (0th order).  Here both
kinds of information come from the intensities themselves (`linearise`).  The
displacement along the normals is a spline with the surface's own basis, so both are
rows of ``T, T1, T2``.  One Gauss-Newton system holds displacement, identity modes, all
cameras, expressions and lights; the albedo is projected out point by point (`system`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..._types import Array
from ...images.photo import Photo
from ...photometry.lighting import independent_share
from ...photometry.sampling import smooth_photo, view_weights
from ...photometry.skin import SkinMask
from ...progress import CheckCancelled
from .coarse_space import coarse_directions
from .linearise import (
    Linearisation,
    Picture,
    PictureReader,
    Readings,
    RobustShading,
    Shading,
    ShadingSolver,
    Visibility,
    linearise,
    read_photos,
)
from .options import JointOptions
from .samples import Samples, sample_surface
from .state import State, Step
from .system import BorderedSystem, Term, assemble

#: Largest part by which a step is made longer than Gauss and Newton have it.
OVER_RELAXATION = 0.5
#: Photos are kept up to this distance from the face, as it may still move: standard
#: deviations of the Gaussian that smooths them.
REACH = 10.0


@dataclass(frozen=True, eq=False)
class JointParts:
    """Parts of the joint method that can be replaced.

    Attributes
    ----------
    reader : callable
        Smooths a photo.
    visibility : callable
        Says how well each photo sees each sample, as `view_weights`.
    shading : callable or None
        Estimates light and albedo; None = `RobustShading` of the options.
    terms : sequence of Term
        Added to those of the problem.
    skin : sequence of n SkinMask, or None
        What of each photo is skin; empty = all of it, None = `skin_masks`.
    """

    reader: PictureReader = smooth_photo
    visibility: Visibility = view_weights
    shading: ShadingSolver | None = None
    terms: Sequence[Term] = ()
    skin: Sequence[SkinMask] | None = None


@dataclass(frozen=True, eq=False)
class Refinement:
    """What a refinement works with.

    Attributes
    ----------
    photos : sequence of n Photo
    photo_weights : (n,) array
        How much each photo counts.
    options : JointOptions
    terms : sequence of Term
        All besides the intensities and the prior of the shape.
    parts : JointParts
        Reader, visibility and shading are taken from here.
    """

    photos: Sequence[Photo]
    photo_weights: Array
    options: JointOptions
    terms: Sequence[Term]
    parts: JointParts = JointParts()  # noqa: RUF009 (frozen)

    @property
    def skin(self) -> tuple[SkinMask, ...]:
        """What of each photo is skin; empty = all of it."""
        return tuple(self.parts.skin or ())

    def pictures(
        self, state: State, samples: Samples, check_cancelled: CheckCancelled
    ) -> list[Picture]:
        """The faces in the photos, smoothed for the samples' level."""
        points = samples.geometry(state.surface, state.expressions).points
        X = np.broadcast_to(points, (len(self.photos), *points.shape[1:]))
        reach = REACH * samples.level.blur_mm
        found = []
        for photo, camera, x in zip(self.photos, state.cameras, X, strict=True):
            check_cancelled()
            picture = self.parts.reader(photo, camera, samples.level.blur_mm)
            found.append(picture.around(camera.project(x), reach * camera.s))
        return found

    def look(
        self,
        pictures: Sequence[Picture],
        samples: Samples,
        state: State,
        check_cancelled: CheckCancelled,
    ) -> Evidence:
        """Light and albedo for the face as it is, and the derivatives."""
        options, parts = self.options, self.parts
        check_cancelled()
        view = parts.visibility(state.faces, state.cameras, samples.uv, options.grazing)
        check_cancelled()
        view = view * self.photo_weights[:, None]
        seen = read_photos(pictures, samples, state, view, self.skin)
        check_cancelled()
        solve = parts.shading or RobustShading(options.noise, options.light_ridge)
        shading = solve(seen, samples, state)
        state = replace(state, lights=shading.lights, albedo=shading.albedo)
        check_cancelled()
        share = independent_share(shading.noise, options.noise, options.independence)
        rows = linearise(seen, shading, samples, share)
        check_cancelled()
        return Evidence(state, seen, shading, rows)


@dataclass(frozen=True, eq=False)
class Evidence:
    """The photos at a state.

    Attributes
    ----------
    state : State
        With the lights and the albedo of `shading`.
    readings : Readings
    shading : Shading
    rows : Linearisation
    """

    state: State
    readings: Readings
    shading: Shading
    rows: Linearisation


@dataclass(frozen=True, eq=False)
class JointIteration:
    """One Gauss-Newton step, with what it was made of.

    Attributes
    ----------
    level, turn : int
        Number of the level, and of the step in it from 1.
    before, state : State
        Before the step, with the lights and the albedo found for it, and after.
    readings : Readings
    shading : Shading
    rows : Linearisation
    system : BorderedSystem
    step_mm : float
        Largest movement of the samples.
    """

    level: int
    turn: int
    before: State
    state: State
    readings: Readings
    shading: Shading
    rows: Linearisation
    system: BorderedSystem
    step_mm: float

    @property
    def residual(self) -> float:
        """Root mean square of the weighted residuals."""
        W, r = self.shading.weights, self.shading.residual
        return float(np.sqrt((W * r**2).sum() / max(W.sum(), 1e-30)))


def refine(
    state: State, work: Refinement, check_cancelled: CheckCancelled
) -> Iterator[JointIteration]:
    """Iterate the joint system, from coarse to fine.

    Parameters
    ----------
    state : State
        Start.
    work : Refinement
    check_cancelled : callable
        Called between the parts of a step; may raise `Cancelled`.

    Yields
    ------
    JointIteration
        After each step.
    """
    options = work.options
    for number, level in enumerate(options.levels):
        samples = sample_surface(state, level, options.shadows)
        state = state.at_level(len(samples.uv), level.degree)
        pictures = work.pictures(state, samples, check_cancelled)
        last: Array | None = None
        directions: Array | None = None
        for turn in range(1, level.iterations + 1):
            now = work.look(pictures, samples, state, check_cancelled)
            system = assemble(now.rows, now.state, work.terms)
            check_cancelled()
            if directions is None:  # the level's other steps are like the first one
                directions = coarse_directions(system)
            step = system.solve(options.tolerance, directions)
            check_cancelled()
            moved = movement(now.state, step, samples)
            stretch, last = relaxation(moved, last), moved
            state, size = take_step(
                now.state, step, moved, options.max_step_mm, stretch
            )
            settled = turn == level.iterations or size < level.settled_mm
            if settled:  # whoever gets the last step may need the memory
                pictures, directions = [], None
            yield JointIteration(
                number,
                turn,
                now.state,
                state,
                now.readings,
                now.shading,
                now.rows,
                system,
                size,
            )
            # What one step is made of is most of the memory: not that of two at a time.
            del now, system
            if settled:
                break


def take_step(
    state: State,
    step: Step,
    moved: Array,
    max_step_mm: float,
    stretch: float = 1.0,
) -> tuple[State, float]:
    """The state after a step, shortened if need be; its largest movement, mm.

    ``moved`` is the `movement` of the samples by the whole step.
    """
    size = float(np.abs(moved).max())
    damping = min(stretch, max_step_mm / max(size, 1e-12))
    return state.retract(step, damping), damping * size


def movement(state: State, step: Step, samples: Samples) -> Array:
    """How far a step moves the samples along their directions, mm, ``(p,)``."""
    return samples.T[0] @ (step.smooth + state.model.D @ step.modes)


def relaxation(moved: Array, last: Array | None) -> float:
    """Factor on a step: longer the more it goes the way of the one before.

    Robust weights, shadows and visibility are those of the face before the step, so
    that steps in one direction follow each other, each a little shorter.
    """
    if last is None:
        return 1.0
    lengths = float(np.linalg.norm(moved) * np.linalg.norm(last))
    return 1.0 + OVER_RELAXATION * max(float(moved @ last) / max(lengths, 1e-30), 0.0)
