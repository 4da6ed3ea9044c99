"""One height field for the slopes of all texels: weighted Poisson, by cosines.

    min  sum (x - x_0)' A (x - x_0)  +  (|grad z|^2 + l^2 (laplace z)^2) / t^2,
     z   x = (z_u, z_v)

``A`` and ``A x_0 = b`` come from the photos, divided by their noise; the rest is the
prior: slopes of standard deviation ``t`` that hardly change within ``l``. Where the
photos tell nothing, or only in one direction, it decides, so the field is flat there.
With ``A`` the same everywhere this is solved by a cosine transform (Frankot and
Chellappa 1988, with free borders); that solution preconditions conjugate gradients for
the true ``A``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.fft import dctn, idctn
from scipy.sparse.linalg import LinearOperator, cg

from .._types import Array
from ..progress import CheckCancelled
from ..threads import one_blas_thread

Picture = npt.NDArray[np.float32]

#: Standard deviation of the slopes of skin, and length below which they are smooth, mm.
SLOPE, SMOOTH_MM = 0.2, 1.5
#: Side of the square for which this holds, mm: the evidence counts pixels, so photos
#: with more of them may tell more.
_PATCH_MM = 0.4
_TOLERANCE, _STEPS = 1e-3, 100


@dataclass(frozen=True)
class SlopeEvidence:
    """Normal equations of the slopes (z_u, z_v), mm per unit of u and v.

    Attributes
    ----------
    A : (S, S, 2, 2) float32 array
    b : (S, S, 2) float32 array
    noise : (S, S) float32 array
        Variance of what they were made of; infinite where nothing is known.
    """

    A: Picture
    b: Picture
    noise: Picture

    @classmethod
    def empty(cls, size: int) -> SlopeEvidence:
        """For texels of which nothing is known."""
        square = (size, size)
        return cls(
            np.zeros((*square, 2, 2), np.float32),
            np.zeros((*square, 2), np.float32),
            np.full(square, np.inf, np.float32),
        )

    def put(self, rows: slice, A: Picture, b: Picture, noise: Picture) -> None:
        """Set some rows."""
        self.A[rows], self.b[rows], self.noise[rows] = A, b, noise

    def weighed(self, least: float) -> SlopeEvidence:
        """The same divided by the noise, which is taken to be 1 then.

        A few photos may agree by chance: no texel counts more than the usual one.
        ``least`` is the smallest standard deviation of the noise.
        """
        known = np.isfinite(self.noise)
        usual = float(np.median(self.noise[known])) if known.any() else 1.0
        part = 1 / np.maximum(self.noise, max(usual, least**2))
        one = np.where(known, 1, np.inf).astype(np.float32)
        return SlopeEvidence(
            (part[..., None, None] * self.A).astype(np.float32),
            (part[..., None] * self.b).astype(np.float32),
            one,
        )


@one_blas_thread()
def solve_height(
    evidence: SlopeEvidence,
    lengths: tuple[float, float],
    check_cancelled: CheckCancelled,
) -> Array:
    """The height field (S, S), mm.

    Parameters
    ----------
    evidence : SlopeEvidence
        Of noise 1.
    lengths : (float, float)
        Millimetres of one unit of u and of v.
    check_cancelled : callable
        Called in every step; may raise `Cancelled`.
    """
    size = evidence.A.shape[0]
    # Slopes per texel, between four texels each.
    A = _between(evidence.A.astype(float)) * size**2
    b = _between(evidence.b.astype(float)) * size
    if not b.any():
        return np.zeros((size, size))
    texel_u, texel_v = (length / size for length in lengths)
    wave = 2 - 2 * np.cos(np.pi * np.arange(size) / size)
    laplace = wave / texel_u**2 + wave[:, None] / texel_v**2
    area = texel_u * texel_v / _PATCH_MM**2
    prior = area * (laplace + SMOOTH_MM**2 * laplace**2) / SLOPE**2
    mean = A.mean(axis=(0, 1))
    easy = prior + mean[0, 0] * wave + mean[1, 1] * wave[:, None]
    easy[0, 0] = easy[0, 1]  # the mean height is free: it stays 0

    def cosines(x: Array, factor: Array) -> Array:
        transformed = dctn(x.reshape(size, size), norm="ortho")
        return idctn(factor * transformed, norm="ortho").ravel()

    def matrix(x: Array) -> Array:
        check_cancelled()
        z_u, z_v = _slopes(x.reshape(size, size))
        along_u = A[..., 0, 0] * z_u + A[..., 0, 1] * z_v
        along_v = A[..., 0, 1] * z_u + A[..., 1, 1] * z_v
        return _slopes_transposed(along_u, along_v).ravel() + cosines(x, prior)

    square = (size * size, size * size)
    found, _ = cg(
        LinearOperator(square, matvec=matrix, dtype=float),
        _slopes_transposed(b[..., 0], b[..., 1]).ravel(),
        M=LinearOperator(square, matvec=lambda x: cosines(x, 1 / easy), dtype=float),
        rtol=_TOLERANCE,
        maxiter=_STEPS,
    )
    return found.reshape(size, size)


def _between(x: Array) -> Array:
    """Means of four neighbouring texels."""
    return (x[:-1, :-1] + x[1:, :-1] + x[:-1, 1:] + x[1:, 1:]) / 4


def _slopes(z: Array) -> tuple[Array, Array]:
    """Slopes per texel between four texels, along the columns and the rows."""
    rows = (z[:-1] + z[1:]) / 2
    columns = (z[:, :-1] + z[:, 1:]) / 2
    return np.diff(rows, axis=1), np.diff(columns, axis=0)


def _slopes_transposed(along_u: Array, along_v: Array) -> Array:
    """The transpose of `_slopes`."""
    z = np.zeros((len(along_u) + 1, len(along_u) + 1))
    z[:-1, :-1] -= along_u + along_v
    z[1:, 1:] += along_u + along_v
    z[:-1, 1:] += along_u - along_v
    z[1:, :-1] += along_v - along_u
    return z / 2
