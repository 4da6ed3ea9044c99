"""The second level of the preconditioner: what all photos change together.

For a known albedo and shape the photos are nearly independent, so their own blocks
precondition the system well, but for two things: a smooth change of the albedo, or of
the shape, is undone by a change of all lights and cameras, and the more photos there
are, the less says which of the two it is.  There are about as many such directions as
smooth functions span, whatever the number of photos (two-level Schwarz method; Smith,
Bjorstad and Gropp, 1996).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from ..._types import Array
from ...gram import gram, product
from ...surface.bspline import basis_matrix
from .linearise import Linearisation

if TYPE_CHECKING:
    from .system import BorderedSystem

#: Splines on a side that span the smooth changes of the albedo, besides the harmonics,
#: and those of the displacement.
SPLINES = 6
#: The small matrix of this space is measured on about this many samples.
SAMPLES = 400
#: Added to its diagonal: below the smallest eigenvalue of usual systems, enough where
#: a photo has none of these samples.
RIDGE = 1e-6
#: Directions are dropped whose part that others do not have is smaller than this part
#: of the largest one.
LEAST = 1e-5


@dataclass(frozen=True, eq=False)
class CoarseSpace:
    """Directions that the photos' own blocks precondition badly.

    Attributes
    ----------
    Z : (n m, q) array
        Orthonormal, in the coordinates in which the photos' own blocks are identities.
    factor : Cholesky factor
        Of the system in these directions, (q, q).
    """

    Z: Array
    factor: tuple[Array, bool]

    def precondition(self, y: Array) -> Array:
        """``y + Z E^-1 Z^T y`` for ``y`` (n m,)."""
        inside = cho_solve(self.factor, self.Z.T @ y, check_finite=False)
        return y + self.Z @ inside


def coarse_directions(system: BorderedSystem) -> Array:
    """What the photos' parameters do when albedo and shape change smoothly.

    Returns
    -------
    (n, m, q) array
        They change little from one step to the next.
    """
    forces = _forces(system)
    whitened = np.matmul(system.whitening, forces)
    return np.matmul(system.whitening.transpose(0, 2, 1), whitened)


def coarse_space(system: BorderedSystem, directions: Array) -> CoarseSpace:
    """The space of a system that `coarse_directions` span, (n, m, q).

    Those of a system like it will do.
    """
    n, m, _ = directions.shape
    upright = system.whitening.transpose(0, 2, 1)
    Z, R = np.linalg.qr(np.linalg.solve(upright, directions).reshape(n * m, -1))
    # Of directions that depend on others, what is left is rounding.
    U, strength, _ = np.linalg.svd(R)
    Z = product(Z, U[:, strength > LEAST * strength[0]])
    steps = np.matmul(upright, Z.reshape(n, m, -1))
    every = max(1, len(system.intensities.den) // SAMPLES)
    E = _energy(system.thinned(every), steps) + RIDGE * np.eye(Z.shape[1])
    return CoarseSpace(Z, cho_factor(E))


def smooth_albedo(rows: Linearisation, splines: int) -> Array:
    """Changes of the albedo that harmonics and splines span, ``(p, q)``.

    The harmonics are those of the mean photo, so that no order of them is preferred.
    """
    basis = basis_matrix((splines, splines), *rows.samples.uv.T).toarray()
    return rows.albedo[:, None] * np.concatenate([rows.harmonics.mean(0), basis], 1)


def smooth_displacements(system: BorderedSystem) -> Array:
    """Displacements of the net that few splines span, ``(M*N, q)``."""
    m, n = system.state.model.reference.shape
    u, v = np.meshgrid(np.linspace(0, 1, m), np.linspace(0, 1, n), indexing="ij")
    return basis_matrix((SPLINES, SPLINES), u.ravel(), v.ravel()).toarray()


def _forces(system: BorderedSystem) -> Array:
    """Coupling of smooth changes with the photos, ``(n, m, q)``."""
    border, motions = system.intensities, system.state.motions
    rows = border.rows
    albedo, moved = smooth_albedo(rows, SPLINES), smooth_displacements(system)
    by_shape = [np.asarray(t @ moved) for t in rows.samples.T]
    taken = sum(s[:, None] * g for s, g in zip(border.share, by_shape, strict=True))
    fields = [*by_shape, np.concatenate([albedo, -np.asarray(taken)], 1)]
    q = albedo.shape[1]
    W, c, s = rows.precision, rows.by_displacement, rows.shading
    out = np.empty((len(W), border.size, q + moved.shape[1]))
    for i, f in enumerate(out):
        x = s[i, :, None] * fields[3]
        for a in range(3):
            x[:, q:] += c[a, i, :, None] * fields[a]
        x *= W[i, :, None]
        f[:] = product(rows.by_photo(i).T, x)
        f[:motions, q:] += system.coupling[:, i].T @ moved
    return out


def _energy(system: BorderedSystem, steps: Array) -> Array:
    """``Z^T A Z`` for the Schur complement ``A`` and ``steps`` Z (n, m, q), (q, q)."""
    border, shape, motions = system.intensities, system.shape, system.state.motions
    rows, q = border.rows, steps.shape[2]
    E = np.zeros((q, q))
    sums = np.zeros((4, len(border.den), q))
    force = np.zeros((len(system.right), q))
    for i, step in enumerate(steps):
        u = product(rows.by_photo(i), step)
        E += gram(np.sqrt(rows.precision[i, :, None]) * u)
        u *= rows.precision[i, :, None]
        for a, total in enumerate(sums[:3]):
            total += rows.by_displacement[a, i, :, None] * u
        sums[3] += rows.shading[i, :, None] * u
        E += step.T @ system.photo_precision[i] @ step
        force += system.coupling[:, i] @ step[:motions]
    E -= gram(sums[3] / np.sqrt(border.den)[:, None])
    for t, s, f in zip(rows.samples.T, border.share, sums[:3], strict=True):
        force += t.T @ (f - s[:, None] * sums[3])
    smooth, modes = shape.solve(force, shape.D.T @ force)
    return E - force.T @ (smooth + shape.D @ modes)
