"""What a run is to write, judged before the work is done and not after it."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterable, Sequence, Set
from pathlib import Path

from ..errors import ReconstructionError
from ..files import is_named_pipe, why_not_writable
from ..formats import WRITERS, ending
from ..formats.mtl import ENDS, SIGNATURES, plain_stem
from ..images.folder import is_video, scan_folder
from ..images.mask_file import ENDING as MASK_ENDING
from ..images.mask_file import is_mask, mask_file_beside
from ..landmarks.landmarks import LANDMARK_ENDINGS, landmark_file_beside
from .report import PAGE_ENDINGS, report_files


def check_outputs(
    outputs: Sequence[str],
    *,
    report: str | None = None,
    log: str | None = None,
    photos: str | None = None,
    read: Sequence[str] = (),
    recursive: bool = False,
) -> None:
    """Refuse what cannot be written, and what would take another file with it.

    Parameters
    ----------
    outputs : sequence of str
        Files whose ending is their format.
    report, log : str, optional
        The page, and the log.
    photos : str, optional
        Folder or video that is read; none of its files may be written over.
    read : sequence of str
        More files that are read and may not be written over.
    recursive : bool
        Whether the sub-folders are read too.

    Raises
    ------
    ValueError
        With a sentence that names the file.
    """
    for name in outputs:
        found = ending(name)
        if not found:
            raise ValueError(
                f"{name}: unknown ending; choose one of "
                f"{', '.join(['.npz', *WRITERS])}."
            )
        if Path(name).name.lower() == found:
            raise ValueError(f"{name}: give the file a name before its ending.")
    if report is not None and Path(report).suffix.lower() not in PAGE_ENDINGS:
        raise ValueError(f"{report}: the page must end in .html.")
    asked = [(name, files_of(name)) for name in dict.fromkeys(outputs)]
    if report is not None:
        asked.append((report, report_files(report)))
    if log is not None:
        if not log or ending(log):
            raise ValueError(f"{log}: give the log another name, such as run.log.")
        # A terminal or /dev/null is a place for a log.
        special = os.path.exists(log) and not os.path.isfile(log)
        if os.path.isdir(log) or is_named_pipe(log) or not special:
            asked.append((log, (Path(log),)))
    inputs = _inputs(photos, recursive) if photos else []
    kept, beside = _identities(inputs), _names_beside(inputs)
    own = _identities([Path(name) for name in read])
    whose: dict[tuple[str, str], tuple[int, Path]] = {}
    for number, (name, files) in enumerate(asked):
        for path in files:
            why = why_not_writable(path)
            if why:
                raise ValueError(f"{path}: {why}.")
            _refuse(path, kept, own)
            folder, file = os.path.split(os.path.realpath(path))
            other, first = whose.setdefault((folder, file.casefold()), (number, path))
            if other != number:
                alike = os.path.basename(os.path.realpath(first)) == file
                same = (
                    f"would both write {path}"
                    if alike
                    else f"need {first} and {path}, which many systems take for one"
                )
                raise ValueError(
                    f"{asked[other][0]} and {name} {same}; give one of them another "
                    "name."
                )
    for place, (_, path) in whose.items():
        if place in beside:
            raise ValueError(
                f"{path} would be taken for the landmarks or the mask of a photo; "
                "choose another name or folder."
            )


def check_inputs(
    files: Iterable[Path], *, photos: Iterable[Path] = (), read: Iterable[Path] = ()
) -> None:
    """Refuse to write over what is read.

    Parameters
    ----------
    files : iterable of Path
        Files that would be written.
    photos : iterable of Path
        Photos; their landmark and mask files are kept too.
    read : iterable of Path
        More files that are read.

    Raises
    ------
    ValueError
        With a sentence that names the file.
    """
    photos = list(photos)
    kept, own = _identities([*photos, *_beside(photos)]), _identities(list(read))
    for path in files:
        _refuse(path, kept, own)


def files_of(name: str | os.PathLike) -> tuple[Path, ...]:
    """The files that a textured face in this format may consist of."""
    path = Path(name)
    if ending(path) != ".obj":
        return (path,)
    pictures = itertools.product((*ENDS, "_eyes"), SIGNATURES.values())
    ends = (".mtl", *map("".join, pictures))
    return (path, *(path.with_name(plain_stem(path) + end) for end in ends))


def _inputs(photos: str, recursive: bool) -> list[Path]:
    """Photos and videos with their landmark and mask files."""
    path = Path(photos)
    if is_video(path):
        return [path]
    try:
        found = scan_folder(path, recursive)
    except ReconstructionError:
        return []  # said by whoever reads the photos
    return [*found.sources, *_beside(found.photos)]


def _beside(photos: Iterable[Path]) -> list[Path]:
    """The landmark and mask files of photos."""
    both = (landmark_file_beside, mask_file_beside)
    found = [beside(photo) for photo in photos for beside in both]
    return [path for path in found if path is not None]


def _refuse(path: Path, kept: Set[tuple[int, int]], own: Set[tuple[int, int]]) -> None:
    """Raise where a file is one of the photos or of what else is read."""
    known = _identities([path])
    if known & kept:
        raise ValueError(
            f"{path} belongs to the photos and would be written over; choose another "
            "name or folder."
        )
    if known & own:
        raise ValueError(
            f"{path} is read and would be written over; choose another name."
        )


def _names_beside(inputs: Sequence[Path]) -> frozenset[tuple[str, str]]:
    """Folder and name of the landmark and mask files that photos may have."""
    found = set()
    for path in inputs:
        if (
            is_video(path)
            or is_mask(path.name)
            or path.suffix.lower() in LANDMARK_ENDINGS
        ):
            continue
        folder = os.path.realpath(path.parent)
        for end in (*LANDMARK_ENDINGS, MASK_ENDING):
            found.add((folder, (path.stem + end).casefold()))
    return frozenset(found)


def _identities(paths: Sequence[Path]) -> frozenset[tuple[int, int]]:
    """What the system knows the files by that are there, whatever their names."""
    found = set()
    for path in paths:
        try:
            info = path.stat()
        except (OSError, ValueError):
            continue
        found.add((info.st_dev, info.st_ino))
    return frozenset(found)
