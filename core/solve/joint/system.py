"""The Gauss-Newton system: albedo eliminated, displacement bordered by the rest.

The unknowns are displacement ``d``, modes ``a`` and the cameras, expressions and lights
``z_i`` of n photos.  Only what is small or sparse is formed: the block of the
displacement, ``T_a^T diag(.) T_b`` with ``a, b`` in value, u-slope, v-slope, and one
block per photo.  All that couples photos with the face and, by the albedo, with each
other is applied sample by sample (`border`), so that memory and time are linear in the
number of photos.

The step comes from the Schur complement of the photos: displacement and modes are
eliminated exactly, by Cholesky factors, and conjugate gradients find ``z``.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy import sparse
from scipy.linalg.lapack import dtrtri
from scipy.sparse.linalg import LinearOperator, cg

from ..._types import Array
from ...errors import ReconstructionError
from ...progress import CheckCancelled, never_cancelled
from .border import Border
from .coarse_space import coarse_directions, coarse_space
from .linearise import Linearisation
from .marginal import displacement_deviation
from .shape_block import ShapeBlock
from .state import State, Step

#: Far more steps than any system has needed.
MOST_STEPS = 2000


class Term(Protocol):
    """A part of the cost besides the intensities and the prior of the shape."""

    def add_to(self, system: BorderedSystem, /) -> None:
        """Add precision and right side at the state of the system."""
        ...


class BorderedSystem:
    """Normal equations of displacement, modes and photos at a state.

    Attributes
    ----------
    state : State
        Where the residuals are linearised.
    precision : list of (M*N, M*N) sparse arrays
        To be summed: block of the displacement, without prior and intensities.
    right : (M*N,) array
        Its right side.
    photo_precision, photo_right : (n, m, m), (n, m) arrays
        Block and right side of each photo, ``m = 7 + e + q``; without the intensities,
        whose blocks are in `border`.
    coupling : (M*N, n, 7 + e) array
        Between displacement and cameras and expressions, without the intensities.
    border : Border or None
        All that the intensities say about the photos.
    """

    def __init__(self, state: State) -> None:
        size, n = len(state.smooth), len(state.cameras)
        m = state.motions + state.lights.shape[1]
        self.state = state
        self.precision: list[sparse.csr_array] = []
        self.right = np.zeros(size)
        self.photo_precision = np.zeros((n, m, m))
        self.photo_right = np.zeros((n, m))
        self.coupling = np.zeros((size, n, state.motions))
        self.border: Border | None = None

    def add_displacement(self, precision: sparse.csr_array, right: Array) -> None:
        """Add to the block of the displacement, ``(M*N, M*N)`` and ``(M*N,)``."""
        self.precision.append(precision)
        self.right += right

    def add_photo(self, i: int, which: slice, precision: Array, right: Array) -> None:
        """Add to the block of some parameters (slice of the m) of photo ``i``."""
        self.photo_precision[i, which, which] += precision
        self.photo_right[i, which] += right

    def add_coupling(self, i: int, coupling: Array) -> None:
        """Add between displacement and motion of photo ``i``, ``(M*N, 7 + e)``."""
        self.coupling[:, i] += coupling

    def solve(self, tolerance: float, directions: Array | None = None) -> Step:
        """The step.

        Parameters
        ----------
        tolerance : float
            Relative residual at which the conjugate gradients stop, in the metric of
            the photos' blocks.
        directions : (n, m, q) array, optional
            For the preconditioner: the `coarse_directions` of this system, or of one
            that is like it; by default its own.

        Raises
        ------
        ReconstructionError
            The conjugate gradients do not converge.
        """
        state, shape = self.state, self.shape
        top = shape.right(self.right, state)
        right = self.photo_right - self._to_photos(shape.solve(*top))
        whiten = self.whitening
        if directions is None:
            directions = coarse_directions(self)
        coarse = coarse_space(self, directions)
        size = right.size

        def multiply(y: Array) -> Array:
            z = _apply(whiten.transpose(0, 2, 1), y.reshape(right.shape))
            return _apply(whiten, self._schur(z)).ravel()

        y, failed = cg(
            LinearOperator((size, size), multiply, dtype=float),
            _apply(whiten, right).ravel(),
            rtol=tolerance,
            maxiter=MOST_STEPS,
            M=LinearOperator((size, size), coarse.precondition, dtype=float),
        )
        if failed:
            raise ReconstructionError(
                "Light and shape could not be measured together; leave out photos "
                'that hardly show the face, or use the method "motion".'
            )
        z = _apply(whiten.transpose(0, 2, 1), y.reshape(right.shape))
        force = self._to_shape(z)
        smooth, modes = shape.solve(top[0] - force, top[1] - shape.D.T @ force)
        return Step(smooth, modes, z)

    def thinned(self, every: int) -> BorderedSystem:
        """The same system with one of ``every`` samples, which count as many times."""
        thin = BorderedSystem(self.state)
        thin.precision, thin.coupling = self.precision, self.coupling
        thin.photo_precision = self.photo_precision
        thin.border = Border(self.intensities.rows.thinned(every))
        return thin

    def deviation(self, check_cancelled: CheckCancelled = never_cancelled) -> Array:
        """Standard deviation of the displacement of each control point, ``(M*N,)``."""
        return displacement_deviation(self, check_cancelled=check_cancelled)

    @property
    def intensities(self) -> Border:
        """The border; every system that is solved has one."""
        if self.border is None:
            raise ValueError("a system without intensities has no unique solution")
        return self.border

    @cached_property
    def shape(self) -> ShapeBlock:
        """Displacement and modes for known photos."""
        return ShapeBlock(
            self.intensities.displacement_precision(), self.precision, self.state.model
        )

    @cached_property
    def whitening(self) -> Array:
        """``L_i^-1`` of the Cholesky factor of each photo's block, (n, m, m)."""
        # SciPy's BLAS counts columns first: its upper factor is our lower one
        return np.stack([dtrtri(L.T)[0].T for L in np.linalg.cholesky(self.own)])

    @cached_property
    def own(self) -> Array:
        """Block of each photo for a known albedo, ``(n, m, m)``."""
        return self.intensities.photo_blocks + self.photo_precision

    def _schur(self, z: Array) -> Array:
        """Product with the Schur complement of the photos, ``(n, m)``."""
        border = self.intensities
        sums = border.sums(z)
        force = border.to_shape(sums) + self._motions_to_shape(z)
        smooth, modes = self.shape.solve(force, self.shape.D.T @ force)
        moved = smooth + self.shape.D @ modes
        out = _apply(self.own, z) - border.to_photos(moved, sums[3])
        out[:, : self.state.motions] -= self._shape_to_motions(moved)
        return out

    def _to_shape(self, z: Array) -> Array:
        """Coupling of the photos with the displacement, ``(M*N,)``."""
        border = self.intensities
        return border.to_shape(border.sums(z)) + self._motions_to_shape(z)

    def _to_photos(self, step: tuple[Array, Array]) -> Array:
        """Coupling of displacement and modes with the photos, ``(n, m)``."""
        moved = step[0] + self.shape.D @ step[1]
        out = self.intensities.to_photos(moved)
        out[:, : self.state.motions] += self._shape_to_motions(moved)
        return out

    def _motions_to_shape(self, z: Array) -> Array:
        motions = np.ascontiguousarray(z[:, : self.state.motions])
        return self.coupling.reshape(len(self.right), -1) @ motions.ravel()

    def _shape_to_motions(self, moved: Array) -> Array:
        pull = moved @ self.coupling.reshape(len(moved), -1)
        return pull.reshape(-1, self.state.motions)


def _apply(blocks: Array, z: Array) -> Array:
    """Products of matrices (n, m, m) with vectors (n, m)."""
    return np.matmul(blocks, z[..., None])[..., 0]


def assemble(
    rows: Linearisation, state: State, terms: Iterable[Term]
) -> BorderedSystem:
    """The system of the intensities, with the albedo eliminated, and of other terms.

    Parameters
    ----------
    rows : Linearisation
        At ``state``.
    state : State
    terms : iterable of Term
    """
    system = BorderedSystem(state)
    border = Border(rows)
    system.border = border
    right, photo_right = border.right()
    system.right += right
    system.photo_right += photo_right
    for term in terms:
        term.add_to(system)
    return system
