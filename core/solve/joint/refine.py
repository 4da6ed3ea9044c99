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
from ...photometry.sampling import smooth_photo, view_weights
from ...photometry.skin import SkinMask
from ...progress import CheckCancelled
from .linearise import (
    Linearisation,
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
from .samples import sample_surface
from .state import State
from .system import BorderedSystem, Term, assemble


@dataclass(frozen=True, eq=False)
class JointParts:
    """Parts of the joint method that can be replaced.

    Attributes
    ----------
    options : JointOptions or None
        None = those of the problem's settings.
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

    options: JointOptions | None = None
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
    options, parts = work.options, work.parts
    solve_shading = parts.shading or RobustShading(options.noise, options.light_ridge)
    confidence = options.independence / options.noise**2
    for number, level in enumerate(options.levels):
        samples = sample_surface(state, level, options.shadows)
        state = state.at_level(len(samples.uv), level.degree)
        pictures = []
        for photo, camera in zip(work.photos, state.cameras, strict=True):
            check_cancelled()
            pictures.append(parts.reader(photo, camera, level.blur_mm))
        for turn in range(1, level.iterations + 1):
            check_cancelled()
            view = parts.visibility(
                state.faces,
                state.cameras,
                samples.uv,
                options.grazing,
            )
            check_cancelled()
            view = view * work.photo_weights[:, None]
            seen = read_photos(pictures, samples, state, view, work.parts.skin or ())
            check_cancelled()
            shading = solve_shading(seen, samples, state)
            before = replace(state, lights=shading.lights, albedo=shading.albedo)
            check_cancelled()
            rows = linearise(seen, shading, samples, confidence)
            check_cancelled()
            system = assemble(rows, before, work.terms)
            check_cancelled()
            step = system.solve()
            check_cancelled()
            moved = samples.T[0] @ (step.smooth + state.model.D @ step.modes)
            size = float(np.abs(moved).max())
            damping = min(1.0, options.max_step_mm / max(size, 1e-12))
            state = before.retract(step, damping)
            size *= damping
            yield JointIteration(
                number, turn, before, state, seen, shading, rows, system, size
            )
            if size < level.settled_mm:
                break
