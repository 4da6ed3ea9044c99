"""The Gauss-Newton system: albedo eliminated, displacement bordered by the rest.

All blocks have the form ``T_a^T diag(.) T_b`` with ``a, b`` in value, u-slope, v-slope;
what belongs to one photo (camera, light) borders them.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve

from ..._types import Array
from ...camera.camera import PARAMETERS
from .block_banded import BlockCholesky, block_cholesky
from .gram import gram
from .linearise import Linearisation
from .state import State, Step


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
        To be summed: block of the displacement, without its prior.
    right : (M*N,) array
        Its right side.
    coupling : (M*N, n m) array
        Block between displacement and photos.
    photo_precision, photo_right : (n m, n m), (n m,) arrays
        Block and right side of the photos, ``m = 7 + q`` each.
    """

    def __init__(self, state: State) -> None:
        size, n = len(state.smooth), len(state.cameras)
        m = PARAMETERS + state.lights.shape[1]
        self.state = state
        self.precision: list[sparse.csr_array] = []
        self.right = np.zeros(size)
        self.coupling = np.zeros((size, n * m))
        self.photo_precision = np.zeros((n * m, n * m))
        self.photo_right = np.zeros(n * m)

    def add_displacement(self, precision: sparse.csr_array, right: Array) -> None:
        """Add to the block of the displacement, ``(M*N, M*N)`` and ``(M*N,)``."""
        self.precision.append(precision)
        self.right += right

    def add_photo(self, i: int, which: slice, precision: Array, right: Array) -> None:
        """Add to the block of some parameters (slice of the m) of photo ``i``."""
        at = self._columns(i, which)
        self.photo_precision[at, at] += precision
        self.photo_right[at] += right

    def add_coupling(self, i: int, which: slice, coupling: Array) -> None:
        """Add between the displacement and some parameters of a photo, (M*N, m')."""
        self.coupling[:, self._columns(i, which)] += coupling

    def _columns(self, i: int, which: slice) -> slice:
        m = len(self.photo_right) // len(self.state.cameras)
        first, last, _ = which.indices(m)
        return slice(i * m + first, i * m + last)

    def solve(self) -> Step:
        """The step: sparse for the displacement, dense for modes and photos."""
        f, k = self._factors, len(self.state.modes)
        step = cho_solve(f.schur, f.right - f.Y.T @ f.y)
        smooth = f.displacement.other_half((f.y - f.Y @ step)[:, None])[:, 0]
        photos = step[k:].reshape(len(self.state.cameras), -1)
        return Step(smooth, step[:k], photos)

    def deviation(self) -> Array:
        """Standard deviation of the displacement of each control point, ``(M*N,)``.

        The root of the diagonal of ``[I D] H^-1 [I D]^T`` for the bordered matrix.
        """
        f, D = self._factors, self.state.model.D
        Z = f.displacement.other_half(f.Y)
        Z[:, : D.shape[1]] -= D
        inner = f.displacement.inverse_diagonal()
        outer = (Z * cho_solve(f.schur, Z.T).T).sum(1)
        return np.sqrt(np.maximum(inner + outer, 0.0))

    @cached_property
    def _factors(self) -> _Factors:
        state, model = self.state, self.state.model
        D, k = model.D, len(state.modes)
        S = sum(self.precision[1:], self.precision[0])
        SD = S @ D
        border = np.concatenate([SD, self.coupling], 1)
        DB = D.T @ self.coupling
        corner = np.block([[D.T @ SD + np.eye(k), DB], [DB.T, self.photo_precision]])
        # the prior holds the whole displacement from the template, so what the
        # reference already has counts too
        modes = D.T @ self.right - (state.modes + model.modes)
        top = self.right - model.prior.smooth @ (state.smooth + model.smooth)
        factor = block_cholesky(
            sparse.csr_array(S + model.prior.smooth), model.reference.shape
        )
        # border^T (S + smooth)^-1 border is the square of half a solution
        Y = factor.half(np.concatenate([border, top[:, None]], 1))
        y, Y = Y[:, -1], Y[:, :-1]
        schur = cho_factor(corner - gram(Y))
        right = np.concatenate([modes, self.photo_right])
        return _Factors(factor, Y, y, schur, right)


class _Factors(NamedTuple):
    """Of the bordered matrix; ``Y, y`` are half solutions of border and right side."""

    displacement: BlockCholesky
    Y: Array
    y: Array
    schur: tuple[Array, bool]
    right: Array


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
    T, c, W, s = rows.samples.T, rows.by_displacement, rows.precision, rows.shading
    n, p, _ = c.shape
    Ws = W * s
    den = np.maximum((Ws * s).sum(0), 1e-9) + rows.albedo_precision
    r = rows.residual - s * ((Ws * rows.residual).sum(0) / den)
    Wc = W[..., None] * c
    cs = np.einsum("ip,ipa->pa", Ws, c)
    share = cs / den[:, None]
    A = np.einsum("ipa,ipb->pab", Wc, c) - cs[:, :, None] * share[:, None, :]
    right = -np.einsum("ipa,ip->pa", Wc, r)
    upright = [sparse.csr_array(t.T) for t in T]
    for a in range(3):
        for b in range(3):
            system.precision.append(upright[a] @ sparse.diags_array(A[:, a, b]) @ T[b])
        system.right += upright[a] @ right[:, a]
    m = len(system.photo_right) // n
    G = np.empty((p, n * m))
    root = np.sqrt(den)
    # photo by photo: what one photo needs stays in the processor's cache
    for i in range(n):
        h = rows.by_photo(i)
        G[:, i * m : (i + 1) * m] = (Ws[i] / root)[:, None] * h
        mixed = Wc[i] - share * Ws[i][:, None]
        coupled = [t @ (mixed[:, a, None] * h) for a, t in enumerate(upright)]
        system.add_coupling(i, slice(None), np.sum(coupled, axis=0))
        Wh = W[i][:, None] * h
        system.add_photo(i, slice(None), Wh.T @ h, -(Wh.T @ r[i]))
    system.photo_precision -= gram(G)
    for term in terms:
        term.add_to(system)
    return system
