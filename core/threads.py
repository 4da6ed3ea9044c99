"""One thread for the dense algebra, so that equal photos give equal bytes.

OpenBLAS splits a product over its threads, so the order of its sums, and with it the
last bits, depends on how many there are.  The systems here are too small to gain much
from threads; sampling and the networks (OpenCV) keep theirs, which do not share sums.
"""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np
import scipy
from scipy.linalg import cholesky
from scipy.linalg.blas import dgemm

from .process_state import Undo, WhileAnyone


def take_working_space() -> None:
    """Make both OpenBLAS take their working space now.

    They wait for ever for space that they do not get, when the memory of the process
    is limited and the photos have filled it.
    """
    A = np.ones((256, 256))
    dgemm(1.0, A @ A, cholesky(np.eye(256)))


def _take_one_thread() -> Undo:
    before = [(set_, get()) for get, set_ in _controls()]
    for set_, _ in before:
        set_(1)

    def undo() -> None:
        for set_, count in before:
            set_(count)

    return undo


#: Holds the OpenBLAS of NumPy and of SciPy at one thread inside a block; does nothing
#: where they are built with another BLAS.
one_blas_thread = WhileAnyone(_take_one_thread)


@lru_cache(maxsize=1)
def _controls() -> tuple[tuple[Callable[[], int], Callable[[int], None]], ...]:
    """Functions that get and set the number of threads of each OpenBLAS."""
    found = []
    for package in (np, scipy):
        folder = Path(str(package.__file__)).parent
        beside = folder.with_name(folder.name + ".libs")  # Linux, Windows
        for place in (beside, folder / ".dylibs"):
            for path in sorted(place.glob("*openblas*")):
                with contextlib.suppress(OSError, AttributeError, StopIteration):
                    library = ctypes.CDLL(str(path))
                    found.append((_get(library), _set(library)))
    return tuple(found)


def _get(library: ctypes.CDLL) -> Callable[[], int]:
    function = _named(library, "openblas_get_num_threads")
    function.restype, function.argtypes = ctypes.c_int, []
    return function


def _set(library: ctypes.CDLL) -> Callable[[int], None]:
    function = _named(library, "openblas_set_num_threads")
    function.restype, function.argtypes = None, [ctypes.c_int]
    return function


def _named(library: ctypes.CDLL, name: str):
    """The function, under the name that the wheels gave it."""
    names = (p + name + s for p in ("", "scipy_") for s in ("", "64_"))
    return next(getattr(library, n) for n in names if hasattr(library, n))
