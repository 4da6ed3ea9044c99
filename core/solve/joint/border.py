"""What the intensities say about photos and displacement, applied and not formed.

With ``u = h z`` the change of the residuals by the photos, ``W`` their precision, ``s``
the shading and ``den = sum_i W s^2``, the albedo of a sample that is eliminated takes
up ``sum_i W s u / den``.  All couplings of a sample go by four sums over the photos,
``sum_i W c_a u`` for the three ``c_a`` and ``sum_i W s u``.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy import sparse

from ..._types import Array
from ...gram import gram
from .linearise import Linearisation

# Below this a sample is seen by no photo.
_UNSEEN = 1e-9


class Border:
    """Products with the blocks of the intensities.

    Attributes
    ----------
    rows : Linearisation
    den : (p,) array
        Precision of the albedo.
    share : (3, p) array
        Change of the albedo by displacement and slopes.
    """

    def __init__(self, rows: Linearisation) -> None:
        c, W, s = rows.by_displacement, rows.precision, rows.shading
        self.rows = rows
        Ws = W * s
        energy = np.maximum((Ws * s).sum(0), _UNSEEN)
        self.den = energy + rows.albedo_precision
        self.share = np.einsum("ip,aip->ap", Ws, c) / self.den
        self._upright = [sparse.csr_array(t.T) for t in rows.samples.T]

    def displacement_precision(self) -> sparse.csr_array:
        """Block of the displacement, ``(M*N, M*N)``."""
        T, c, W = self.rows.samples.T, self.rows.by_displacement, self.rows.precision
        total = sparse.csr_array((T[0].shape[1],) * 2)
        count = np.diff(T[0].indptr)
        for b in range(3):
            # T_a have their entries in the same places: one product for each b
            data = np.zeros(len(T[0].data))
            Wc = W * c[b]
            for a in range(3):
                A = np.einsum("ip,ip->p", Wc, c[a])
                A -= self.share[a] * self.share[b] * self.den
                data += np.repeat(A, count) * T[a].data
            weighted = sparse.csr_array((data, T[0].indices, T[0].indptr), T[0].shape)
            total += self._upright[b] @ weighted
        return total

    def right(self) -> tuple[Array, Array]:
        """Right sides of displacement ``(M*N,)`` and photos ``(n, m)``."""
        rows = self.rows
        Wr = rows.precision * rows.residual
        taken = np.einsum("ip,ip->p", rows.shading, Wr) / self.den
        Wr -= rows.precision * rows.shading * taken
        force = -np.einsum("aip,ip->ap", rows.by_displacement, Wr)
        return self._spread(force), -rows.pull(Wr)

    @cached_property
    def photo_blocks(self) -> Array:
        """Block of each photo for a known albedo, ``(n, m, m)``."""
        roots = np.sqrt(self.rows.precision)
        out = np.empty((len(roots), self.size, self.size))
        for i, root in enumerate(roots):
            out[i] = gram(root[:, None] * self.rows.by_photo(i))
        return out

    @property
    def size(self) -> int:
        """Number m of parameters of a photo."""
        return self.rows.by_motion.shape[1] + self.rows.harmonics.shape[2]

    def sums(self, z: Array) -> Array:
        """The four sums over the photos for their parameters (n, m), ``(4, p)``."""
        rows = self.rows
        Wu = rows.precision * rows.change(z)
        out = np.empty((4, Wu.shape[1]))
        np.einsum("aip,ip->ap", rows.by_displacement, Wu, out=out[:3])
        np.einsum("ip,ip->p", rows.shading, Wu, out=out[3])
        return out

    def to_shape(self, sums: Array) -> Array:
        """Coupling of the photos with the displacement, ``(M*N,)``."""
        return self._spread(sums[:3] - self.share * sums[3])

    def _spread(self, fields: Array) -> Array:
        """``sum_a T_a^T f_a``, ``(M*N,)``, for fields (3, p)."""
        t, t_u, t_v = self._upright
        return t @ fields[0] + t_u @ fields[1] + t_v @ fields[2]

    def to_photos(self, moved: Array, albedo_sum: Array | None = None) -> Array:
        """Coupling of a displacement (M*N,) with the photos, ``(n, m)``.

        ``albedo_sum`` (p,), the fourth of the sums, adds what the photos tell each
        other by the albedo.
        """
        G = np.empty((4, len(self.den)))
        for a, t in enumerate(self.rows.samples.T):
            G[a] = t @ moved
        G[3] = -(self.share * G[:3]).sum(0)
        if albedo_sum is not None:
            G[3] += albedo_sum / self.den
        rows = self.rows
        x = np.einsum("aip,ap->ip", rows.by_displacement, G[:3])
        x += rows.shading * G[3]
        x *= rows.precision
        return rows.pull(x)
