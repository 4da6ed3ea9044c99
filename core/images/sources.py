"""Which photos the caller means: folder, video, paths or arrays, and their names."""

from __future__ import annotations

import itertools
import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path, PurePath

import numpy as np

from ..errors import ReconstructionError, one_line
from .folder import is_video, nothing_found, scan_folder

#: What `reconstruct` takes as photos: a folder, or a sequence of paths or arrays.
Photos = str | os.PathLike | Sequence | np.ndarray
#: Names with paths or arrays.
Sources = list[tuple[str, Path | np.ndarray]]


def photo_sources(photos: Photos, recursive: bool) -> tuple[Sources, tuple[str, ...]]:
    """The photos and videos that are meant, each with a name of its own.

    Parameters
    ----------
    photos : folder, video, or sequence of paths or (H, W, 3) arrays
    recursive : bool
        Whether a folder's sub-folders are read too.

    Returns
    -------
    sources : list of (str, path or array)
        Names, unlike each other, with what they stand for.
    hints : tuple of str
        Sentences on what is passed over.

    Raises
    ------
    ReconstructionError
        If the folder cannot be read, there are no photos, or one picture was given
        in place of several.
    TypeError
        If it is something else than photos.
    """
    if isinstance(photos, str | os.PathLike):
        if is_video(Path(photos)):
            return [(printable(Path(photos).name), Path(photos))], ()
        scan = scan_folder(photos, recursive)
        if not scan.sources:
            raise ReconstructionError(nothing_found(scan))
        names = photo_names([scan.shown(path) for path in scan.sources])
        return list(zip(names, scan.sources, strict=True)), scan.hints()
    if isinstance(photos, np.ndarray) and _one_picture(photos):
        raise ReconstructionError(
            f"One picture of shape {photos.shape} was given in place of several; "
            "give a list of them, such as [picture, picture, picture]."
        )
    number = isinstance(photos, np.ndarray) and photos.ndim == 0
    unfit = isinstance(photos, Mapping | bytes) or number
    if unfit or not isinstance(photos, Iterable):
        raise TypeError(
            "photos must be a folder, or a list of paths or of (H, W, 3) arrays, not "
            f"{type(photos).__name__}."
        )
    items = [_source(item) for item in photos]
    if not items:
        raise ReconstructionError(
            "No photos were given; give one at least, better ten or more."
        )
    names = photo_names(
        item.name if isinstance(item, Path) else f"picture {i + 1}"
        for i, item in enumerate(items)
    )
    return list(zip(names, items, strict=True)), ()


def photo_names(wanted: Iterable[str]) -> list[str]:
    """Names that can be printed and are unlike each other: equal ones get numbers."""
    names = [printable(name) for name in wanted]
    count, taken = Counter(names), set(names)
    for i, name in enumerate(names):
        if count[name] > 1:
            numbered = (f"{name} ({number})" for number in itertools.count(1))
            names[i] = next(other for other in numbered if other not in taken)
            taken.add(names[i])
    return names


def _source(item: object) -> Path | np.ndarray:
    if isinstance(item, np.ndarray):
        return item
    if isinstance(item, str | os.PathLike):
        return Path(item)
    raise TypeError(
        f"each photo must be a path or an (H, W, 3) array, not {type(item).__name__}."
    )


def _one_picture(array: np.ndarray) -> bool:
    """Whether an array is a picture itself and not a stack of them."""
    return array.ndim == 2 or (array.ndim == 3 and array.shape[2] in (1, 3, 4))


def ignored_names(given: object) -> tuple[str, ...]:
    """The names of photos to leave out, whatever kind of list they are in.

    Raises
    ------
    TypeError
        If it is a single text, no list, or not a list of names or paths.
    """
    if isinstance(given, str | bytes) or not isinstance(given, Iterable):
        example = given if isinstance(given, str) else "007.jpg"
        raise TypeError(
            f"ignore must be a list of photo names, such as [{example!r}], not "
            f"{'a text' if isinstance(given, str) else type(given).__name__}."
        )
    names = [x.as_posix() if isinstance(x, PurePath) else x for x in given]
    for name in names:
        if not isinstance(name, str):
            raise TypeError(
                "ignore must be a list of photo names, such as ['007.jpg'], without "
                f"{type(name).__name__} in it."
            )
    return tuple(names)


def is_name_of(name: str, names: Sequence[str]) -> bool:
    """Whether it is one of the names; that of a frame begins with its video's."""
    return name in names or any(
        name.startswith(f"{video} ") for video in names if is_video(Path(video))
    )


def check_names(given: Sequence[str], names: Sequence[str], purpose: str) -> None:
    """Refuse names that no photo has.

    Parameters
    ----------
    given : sequence of str
    names : sequence of str
        Those of all photos.
    purpose : str
        What the named photos are wanted for, as it follows "to" in the message.

    Raises
    ------
    ReconstructionError
        For the first name of ``given`` that is not among ``names``.
    """
    # A name with a slip would let the photo in, and the slip show after the work.
    for name in given:
        if not is_name_of(name, names):
            listed = ", ".join(names[:5])
            if len(names) > 5:
                listed += f" ... ({len(names)} photos)"
            raise ReconstructionError(
                f"There is no photo {name!r} to {purpose}; the names are {listed}."
            )


def printable(name: str) -> str:
    """The name as it can be printed: bytes that are no text become "?"."""
    return one_line(name.encode("utf-8", "replace").decode("utf-8"))
