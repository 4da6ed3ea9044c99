"""The second level of the preconditioner: lights that all photos change together.

For a known albedo the photos are nearly independent, so their own blocks precondition
the system well, but for one thing: a smooth change of the albedo is undone by a change
of all lights, and the more photos there are, the less says which of the two it is.
There are about as many such directions as the light has harmonics, whatever the number
of photos (two-level Schwarz method; Smith, Bjorstad and Gropp, 1996).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from ..._types import Array
from ...surface.bspline import basis_matrix
from .border import Border
from .gram import gram, product
from .linearise import Linearisation

#: Splines on a side that span, with the harmonics, the changes of the albedo.
SPLINES = 8
#: The small matrix of this space is measured on about this many samples.
SAMPLES = 1000
#: Of its own size, added to that matrix: below the smallest eigenvalue of any system.
RIDGE = 1e-5


@dataclass(frozen=True, eq=False)
class CoarseSpace:
    """Directions that the photos' own blocks precondition badly.

    Attributes
    ----------
    Z : (n m, q) array
        In the coordinates in which the photos' own blocks are identities.
    factor : Cholesky factor
        Of the system in these directions, (q, q).
    """

    Z: Array
    factor: tuple[Array, bool]

    def precondition(self, y: Array) -> Array:
        """``y + Z E^-1 Z^T y`` for ``y`` (n m,)."""
        return y + self.Z @ cho_solve(self.factor, self.Z.T @ y)


def coarse_space(border: Border, photo_precision: Array, whiten: Array) -> CoarseSpace:
    """What the photos' parameters do when the albedo changes smoothly.

    Parameters
    ----------
    border : Border
    photo_precision : (n, m, m) array
        What is known of the photos besides the intensities.
    whiten : (n, m, m) array
        Inverse Cholesky factors of the photos' blocks.
    """
    rows = border.rows
    every = max(1, len(rows.albedo) // SAMPLES)
    pick = slice(None, None, every)
    F = smooth_albedo(rows, SPLINES)[pick]
    n, m, q = len(whiten), border.size, F.shape[1]
    Z = np.empty((n, m, q))
    E = np.zeros((q, q))
    total = np.zeros_like(F)
    for i in range(n):
        h, Ws = rows.by_photo(i, every), border.V[3, i, pick, None]
        Z[i] = product(whiten[i], product(h.T, every * Ws * F))
        step = product(whiten[i].T, Z[i])
        u = product(h, step)
        total += Ws * u
        E += every * gram(np.sqrt(rows.precision[i, pick, None]) * u)
        E += step.T @ photo_precision[i] @ step
    E -= every * gram(total / np.sqrt(border.den[pick, None]))
    Z = Z.reshape(n * m, q)
    return CoarseSpace(Z, cho_factor(E + RIDGE * (gram(Z) + np.eye(q))))


def smooth_albedo(rows: Linearisation, splines: int) -> Array:
    """Changes of the albedo that harmonics and splines span, ``(p, q)``."""
    basis = basis_matrix((splines, splines), *rows.samples.uv.T).toarray()
    return rows.albedo[:, None] * np.concatenate([rows.harmonics[0], basis], 1)
