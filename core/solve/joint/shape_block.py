"""Displacement and modes for known photos: a sparse block and a few dense columns."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve

from ..._types import Array
from .banded import banded_cholesky, mirrored_order
from .state import DisplacementModel, State


class ShapeBlock:
    """Exact solutions of the system of displacement ``d`` and modes ``a``.

    Attributes
    ----------
    S_terms : (M*N, M*N) sparse array
        What is known of the displacement ``d + D a`` besides the intensities.
    D : (M*N, k) array
        Displacement by the modes.
    model : DisplacementModel
    """

    def __init__(
        self,
        S: sparse.csr_array,
        terms: list[sparse.csr_array],
        model: DisplacementModel,
    ) -> None:
        self.S_terms = sum(terms, sparse.csr_array(S.shape))
        self.D, self.model = model.D, model
        S = S + self.S_terms
        total = sparse.csr_array(S + model.prior.along_normals)
        self.factor = banded_cholesky(total, mirrored_order(model.prior.shape))
        self._SD = S @ self.D
        self._PD = self.factor.solve(self._SD)
        inner = self.D.T @ self._SD + np.eye(self.D.shape[1])
        self._corner = cho_factor(inner - self._SD.T @ self._PD)

    def solve(self, force: Array, modes: Array) -> tuple[Array, Array]:
        """``d, a`` for right sides ``(M*N,)`` and ``(k,)``."""
        d = self.factor.solve(force)
        a = cho_solve(self._corner, modes - self._SD.T @ d)
        return d - self._PD @ a, a

    def right(self, force: Array, state: State) -> tuple[Array, Array]:
        """Both right sides, the prior's included, for that of the displacement."""
        model = self.model
        # the prior holds the whole displacement from the template, so what the
        # reference already has counts too
        smooth = model.prior.along_normals @ (state.smooth + model.smooth)
        return force - smooth, self.D.T @ force - (state.modes + model.modes)
