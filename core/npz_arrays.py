"""The arrays of an ``.npz`` file, whoever wrote it.

Such files come from other people too: nothing in them is executed (no pickles), and
what they claim to hold is judged before it is unpacked.
"""

from __future__ import annotations

import errno
import os
import zipfile
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray


def open_file(path: str | os.PathLike) -> BinaryIO:
    """Open a file for reading; a pipe or a device would be read for ever.

    Raises
    ------
    OSError
        With its reason in ``strerror``.
    """
    if os.path.exists(path) and not os.path.isfile(path) and not os.path.isdir(path):
        raise OSError(errno.EINVAL, "it is no regular file", os.fspath(path))
    return open(path, "rb")  # noqa: SIM115


def read_arrays(file: BinaryIO, most: int) -> dict[str, NDArray]:
    """All arrays of an ``.npz`` file by name.

    Parameters
    ----------
    file : binary file, open for reading
    most : int
        Bytes that all members together may have.

    Raises
    ------
    ValueError
        When it is no such file, is damaged or holds too much; the text says which, as
        the middle of a sentence.
    """
    try:
        with zipfile.ZipFile(file) as archive:
            members = archive.infolist()
        if sum(member.file_size for member in members) > most:
            raise ValueError(f"it holds more than {most // 10**6} MB")
        file.seek(0)
        with np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except Exception as error:
        # zipfile, zlib and numpy raise a dozen kinds for damaged files, from
        # NotImplementedError (a kind of compression) to TokenError (a torn header).
        why = "something is missing" if isinstance(error, EOFError) else str(error)
        if isinstance(error, OSError) and error.strerror:
            why = error.strerror
        why = " ".join(why.split())[:100] or type(error).__name__
        raise ValueError(why) from error
    # A member that is no .npy file comes as bytes.
    return {n: a for n, a in arrays.items() if isinstance(a, np.ndarray)}


def floats(
    arrays: dict[str, NDArray], name: str, *shape: int | None, finite: bool = True
) -> NDArray[np.float64]:
    """One array as float64, its shape and content checked.

    Parameters
    ----------
    arrays : dict of arrays
    name : str
    shape : int or None
        Wanted length of each axis; None for any.
    finite : bool
        Refuse NaN and infinity.

    Raises
    ------
    ValueError
        With the array's name and what is wrong, as the middle of a sentence.
    """
    if name not in arrays:
        raise ValueError(f"{name} is missing")
    value = arrays[name]
    fits = value.ndim == len(shape) and all(
        want in (None, have) for want, have in zip(shape, value.shape, strict=True)
    )
    if not fits or value.dtype.kind not in "fiub":
        wanted = " x ".join("any" if k is None else str(k) for k in shape)
        kind = str(value.dtype)[:40]
        raise ValueError(f"{name} must hold {wanted} numbers, not {kind} {value.shape}")
    # A long double beyond float64 becomes infinite, which is refused below.
    with np.errstate(over="ignore"):
        value = value.astype(np.float64)
    if finite and not np.isfinite(value).all():
        raise ValueError(f"{name} holds values that are not finite")
    return value
