"""``A^T A`` by SciPy's BLAS.

NumPy and SciPy bring an OpenBLAS each.  That of NumPy 1.26, which Blender 4.5 has, is
older and does not know recent processors: it then takes its kernels for the Pentium 4,
which are several times slower.  The products that the joint step spends its time on
therefore go to SciPy's, and only one triangle of them is computed.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg.blas import dgemm, dsyrk

from ._types import Array


def gram(A: Array) -> Array:
    """``A^T A`` for ``A`` (p, q) in C order, ``(q, q)``; exactly symmetric."""
    # BLAS counts columns first, so its upper triangle is our lower one.
    lower = np.asarray(dsyrk(1.0, A.T)).T
    mirror_lower(lower)
    return lower


def mirror_lower(A: Array) -> None:
    """Write the lower triangle of ``A`` (q, q) into its upper one.

    In place: matrices of this size make the peak of the memory.
    """
    for i in range(len(A)):
        A[i, i + 1 :] = A[i + 1 :, i]


def product(A: Array, B: Array) -> Array:
    """``A B`` for arrays in C order, ``(p, r)`` in C order."""
    # a C array is the transpose of a Fortran one: B^T A^T without a copy
    return np.asarray(dgemm(1.0, B.T, A.T)).T
