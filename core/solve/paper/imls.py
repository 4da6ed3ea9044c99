"""Algorithm 1 with the evidence of the joint step: shading and motion in turn.

One pass, from a motion estimate ``b_t``, at one blur of the photos:

1. Photometric stereo on the surface: lights and albedo under the face's own shadows,
   then a normal ``h`` at each sample, with its precision.
2. Shading: Eq. 6, then Eq. 7, from ``b_0 = b_t``.
3. Motion: Eq. 8 around ``b_0``, with the cameras, from landmarks and from how the
   intensities move with the surface.

Each of them is one linear least-squares problem.

Readings of the text
--------------------
* The frontal constraint ``T^(sxy)``: control points move along the normals of the
  motion estimate only, by ``delta``.  A surface whose tangents are ``F_u, F_v`` has
  the normal ``h`` when ``delta_u = -F_u . h`` and ``delta_v = -F_v . h``, so Eq. 6,
  which moves ``F_v`` and freezes ``F_u``, is a fit of ``delta_v``, and Eq. 7 one of
  ``delta_u``.  ``lambda`` is 1 in the precision of the normals.
* Normals count by the precision with which the photos determine them.
* ``b_t`` is kept by its 0th order: with the precision of the motion step's
  intensities, and of the prior of faces in place of a ridge.
* Eq. 8 keeps the shape of ``b_0`` by its normals with their precision, which is what
  shading knows, in place of all second derivatives; the prior of faces regularises.
* Lights and normals are not free together, as in the joint step: that is what the
  alternation costs in accuracy.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve

from ..._types import Array
from ...problem import FaceEstimate, Iteration, Problem
from ...progress import CheckCancelled, never_cancelled
from ..joint.banded import banded_cholesky, mirrored_order
from ..joint.coarse_space import coarse_directions
from ..joint.linearise import (
    Linearisation,
    Readings,
)
from ..joint.method import begin, estimate_at, photometric_evidence
from ..joint.options import JointOptions
from ..joint.refine import Evidence, JointIteration, JointParts, movement, take_step
from ..joint.samples import Samples, sample_surface
from ..joint.state import DisplacementModel, State, Step
from ..joint.system import BorderedSystem, Term, assemble
from ..joint.terms import LandmarkTerm
from ..landmark_term import facing_weight, landmark_rows
from .algorithm1 import singular_reported

#: Passes at each blur, from coarse to fine, in units of `Settings.outer_passes`.
PASSES = (2, 2, 3)
#: Standard deviation of the turn of a normal in one photometric stereo, radians: how
#: far the linearisation reaches, and what holds a normal that few photos determine.
TURN = 0.3


class SlopeField(NamedTuple):
    """What photometric stereo asks of the displacement at the samples.

    Attributes
    ----------
    slopes : (p, 2) array
        ``delta_u, delta_v`` that give the surface the normals ``h``.
    precision : (p, 2, 2) array
        Of the slopes.
    metric : (p, 2, 2) array
        The angle between two normals is the length of the difference of their slopes
        in it, radians.
    position : (p,) array
        Precision of ``delta`` itself by the intensities, 1/mm^2.
    """

    slopes: Array
    precision: Array
    metric: Array
    position: Array

    @property
    def force(self) -> Array:
        """Precision times slopes: right side of the normal equations, ``(p, 2)``."""
        return np.einsum("pab,pb->pa", self.precision, self.slopes)

    def rms_degrees(self) -> float:
        """Root mean square angle between ``h`` and the normals of the surface."""
        angle2 = np.einsum("pa,pab,pb->p", self.slopes, self.metric, self.slopes)
        weight = np.trace(self.precision, axis1=1, axis2=2)
        weight = weight / np.trace(self.metric, axis1=1, axis2=2)
        return float(np.degrees(np.sqrt((weight * angle2).sum() / weight.sum())))


@dataclass(frozen=True, eq=False)
class NormalTerm:
    """The second term of Eq. 8: the normals that shading found, with their precision.

    Attributes
    ----------
    samples : Samples
    field : SlopeField
        At the state of the system.
    """

    samples: Samples
    field: SlopeField

    def add_to(self, system: BorderedSystem) -> None:
        """Add the normals of all samples."""
        T = self.samples.T[1:]
        precision = sum(
            _weighted(T[a], T[b], self.field.precision[:, a, b])
            for a in (0, 1)
            for b in (0, 1)
        )
        force = self.field.force
        right = T[0].T @ force[:, 0] + T[1].T @ force[:, 1]
        system.add_displacement(sparse.csr_array(precision), right)


def _landmark_rms(state: State, terms: Sequence[Term]) -> float:
    """Root mean square landmark residual, mm at the head."""
    term = next(t for t in terms if isinstance(t, LandmarkTerm))
    uv = term.observations.uv
    X, normals = state.surface.evaluate(*uv.T), state.surface.normals(*uv.T)
    X = X + term.offset
    total = squares = 0.0
    for i, camera in enumerate(state.cameras):
        weight = term.observations.weight[i] * facing_weight(camera, X, normals)
        pixels = term.observations.pixels[i]
        Q = X + term.expressions @ state.expressions[i]
        rows = landmark_rows(camera, Q, pixels, weight, term.sigma)
        total += float(rows.weight.sum())
        squares += float((rows.weight * rows.distance**2).sum())
    return float(np.sqrt(squares / max(total, 1e-30)))


def imls(
    problem: Problem,
    estimate: FaceEstimate,
    check_cancelled: CheckCancelled = never_cancelled,
    parts: JointParts = JointParts(),  # noqa: B008 (frozen)
    options: JointOptions | None = None,
) -> Iterator[Iteration]:
    """Refine an estimate by shading and motion in turn.

    Parameters
    ----------
    problem : Problem
    estimate : FaceEstimate
        Of the motion stage; its expressions and photo weights are relative to the
        surface of the result.
    check_cancelled : callable
        Called between the parts of a step; may raise `Cancelled`.
    parts : JointParts
        What is not as usual.
    options : JointOptions, optional
        A level takes as many passes as it has iterations; by default `schedule`.

    Yields
    ------
    Iteration
        Two per pass, "shading" and "motion"; the last one carries the photometric
        evidence.
    """
    options = options or schedule(
        JointOptions.of(problem), problem.settings.outer_passes
    )
    work, state = begin(problem, estimate, options, parts, check_cancelled)
    done, total = 0, 2 * sum(level.iterations for level in options.levels)
    for number, level in enumerate(options.levels):
        samples = sample_surface(state, level, options.shadows)
        state = state.at_level(len(samples.uv), level.degree)
        pictures = work.pictures(state, samples, check_cancelled)
        directions: Array | None = None
        for turn in range(1, level.iterations + 1):
            now = work.look(pictures, samples, state, check_cancelled)
            with singular_reported():
                state, angle, size = shading_step(now, samples, options.max_step_mm)
            done += 1
            found = estimate_at(state, problem, estimate)
            yield Iteration("shading", found, angle, size, done, total)
            now = work.look(pictures, samples, state, check_cancelled)
            with singular_reported():
                system = motion_system(now, samples, work.terms)
                if directions is None:
                    directions = coarse_directions(system)
                step = system.solve(options.tolerance, directions)
            moved = movement(now.state, step, samples)
            state, size = take_step(now.state, step, moved, options.max_step_mm)
            done += 1
            found = estimate_at(state, problem, estimate)
            if done == total:
                last = JointIteration(
                    level=number,
                    turn=turn,
                    before=now.state,
                    state=state,
                    readings=now.readings,
                    shading=now.shading,
                    rows=now.rows,
                    system=system,
                    step_mm=size,
                )
                evidence = photometric_evidence(last)
                found = replace(found, photometric=evidence, skin=work.skin)
            rms = _landmark_rms(state, work.terms)
            yield Iteration("motion", found, rms, size, done, total)


def schedule(options: JointOptions, passes: int) -> JointOptions:
    """The same blurs and weights, with ``passes`` times `PASSES` at each blur."""
    levels = tuple(
        level._replace(iterations=times * passes)
        for level, times in zip(options.levels, PASSES, strict=True)
    )
    return replace(options, levels=levels)


def photometric_stereo(rows: Linearisation, readings: Readings) -> SlopeField:
    """A normal at each sample under known lights, the albedo eliminated."""
    c, W, s = rows.by_displacement, rows.precision, rows.shading
    Ws = W * s
    energy = np.maximum((Ws * s).sum(0), 1e-9) + rows.albedo_precision
    r = rows.residual - s * ((Ws * rows.residual).sum(0) / energy)
    cs = np.einsum("ip,aip->pa", Ws, c)
    A = np.einsum("aip,ip,bip->pab", c, W, c)
    A -= cs[:, :, None] * cs[:, None, :] / energy[:, None, None]
    force = -np.einsum("aip,ip,ip->pa", c[1:], W, r)
    g = np.stack([readings.geometry.g_u, readings.geometry.g_v], 2)
    metric = np.einsum("kpax,kpbx->pab", g, g) / len(g)
    precision = A[:, 1:, 1:] + metric / TURN**2
    slopes = np.linalg.solve(precision, force[..., None])[..., 0]
    return SlopeField(slopes, precision, metric, np.maximum(A[:, 0, 0], 0.0))


def shading_step(
    evidence: Evidence, samples: Samples, max_step_mm: float
) -> tuple[State, float, float]:
    """Eq. 6, then Eq. 7: ``F_v`` and then ``F_u`` take the normals.

    Returns
    -------
    state : State
        ``b_0``.
    angle : float
        Root mean square angle between the normals found and those reached, degrees.
    step_mm : float
        Largest movement of the samples.
    """
    state = evidence.state
    field = photometric_stereo(evidence.rows, evidence.readings)
    T, T1, T2 = samples.T
    # Both equations have one matrix: in each, the derivative that is frozen counts as
    # much (lambda) as the one that is fitted.
    S = (
        _weighted(T1, T1, field.precision[:, 0, 0])
        + _weighted(T2, T2, field.precision[:, 1, 1])
        + _weighted(T, T, field.position)
    )
    solve = ShapeSolver(sparse.csr_array(S), state.model)
    start = state.surface
    for frozen, fitted in ((T1, 1), (T2, 0)):
        free = T2 if frozen is T1 else T1
        step = solve(free.T @ field.force[:, fitted], len(state.cameras))
        before = state.displacement
        state, _ = take_step(state, step, movement(state, step, samples), max_step_mm)
        moved = state.displacement - before
        reached = np.stack([T1 @ moved, T2 @ moved], 1)
        field = field._replace(slopes=field.slopes - reached)
    moved = T @ (state.surface.vector - start.vector)
    size = float(np.linalg.norm(moved, axis=1).max())
    return state, field.rms_degrees(), size


def motion_system(
    evidence: Evidence, samples: Samples, terms: Sequence[Term]
) -> BorderedSystem:
    """Eq. 8 with the cameras: 0th order of intensities and landmarks, known normals."""
    rows = evidence.rows
    field = photometric_stereo(rows, evidence.readings)
    along = rows.by_displacement * np.array([1.0, 0.0, 0.0])[:, None, None]
    motion = rows._replace(by_displacement=along, harmonics=rows.harmonics[..., :0])
    dark = replace(evidence.state, lights=evidence.state.lights[:, :0])
    return assemble(motion, dark, [*terms, NormalTerm(samples, field)])


class ShapeSolver:
    """Displacement for known forces, near the state: half of the prior's precision.

    Eq. 6 and 7 share the prior, so each of them has one half.
    """

    def __init__(self, precision: sparse.csr_array, model: DisplacementModel) -> None:
        prior = 0.5 * model.prior.along_normals
        self.D = D = model.D
        order = mirrored_order(model.prior.shape)
        self.factor = banded_cholesky(sparse.csr_array(precision + prior), order)
        self.SD = precision @ D
        self.PD = self.factor.solve(self.SD)
        corner = D.T @ self.SD + 0.5 * np.eye(D.shape[1])
        self.schur = cho_factor(corner - self.SD.T @ self.PD)

    def __call__(self, force: Array, photos: int) -> Step:
        d = self.factor.solve(force)
        modes = cho_solve(self.schur, self.D.T @ force - self.SD.T @ d)
        return Step(d - self.PD @ modes, modes, np.zeros((photos, 0)))


def _weighted(
    T: sparse.csr_array, U: sparse.csr_array, weight: Array
) -> sparse.csr_array:
    return sparse.csr_array(T.T @ sparse.diags_array(weight) @ U)
