"""What a folder holds: photos, videos, and what is passed over, with its reason."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ..errors import ReconstructionError
from ..kinds import SWITCH, expect, expect_paths
from .decode import RAW_ENDINGS, why_not
from .mask_file import is_mask, masked
from .png import is_marked

READABLE_ENDINGS = frozenset((
    ".jpg", ".jpeg", ".jpe", ".jfif", ".png", ".apng", ".webp", ".bmp", ".dib",
    ".tif", ".tiff", ".pgm", ".ppm", ".pnm", ".pbm", ".heic", ".heif", ".hif",
    ".avif", ".jp2", ".j2k", ".jpx",
))  # fmt: skip
# Pictures that people do put into the folder and that cannot be read: they are
# listed so that each gets its sentence.
FOREIGN_ENDINGS = RAW_ENDINGS | {".gif", ".jxl", ".psd"}
VIDEO_ENDINGS = frozenset((
    ".mp4", ".mov", ".m4v", ".webm", ".avi", ".mkv",
))  # fmt: skip
# Files that belong to a photo or to the system: nobody takes them for photos.
_SILENT_ENDINGS = frozenset((
    ".json", ".ini", ".db", ".xmp", ".aae", ".thm", ".lrv",
))  # fmt: skip
_NAMED = 5


@dataclass(frozen=True)
class PassedOver:
    """A file or folder that is not read, and why in one sentence."""

    name: str
    reason: str


@dataclass(frozen=True)
class FolderScan:
    """What a folder holds, in natural order of the names.

    Parameters
    ----------
    folder : pathlib.Path
    photos, videos : tuple of pathlib.Path
        A file counts by its ending; whether it can be read is the reader's question.
    passed_over : tuple of PassedOver
        Pictures that bsface wrote, masks and landmark files without a photo, and links
        to folders.
    photo_folders : tuple of str
        Sub-folders that hold photos or videos and were not entered.
    others : tuple of str
        Names of files of other kinds, hidden and landmark files left out.
    """

    folder: Path
    photos: tuple[Path, ...]
    videos: tuple[Path, ...]
    passed_over: tuple[PassedOver, ...]
    photo_folders: tuple[str, ...]
    others: tuple[str, ...]

    @property
    def sources(self) -> tuple[Path, ...]:
        """Photos and videos together."""
        both = [*self.photos, *self.videos]
        return tuple(sorted(both, key=lambda path: natural_key(self.shown(path))))

    def shown(self, path: Path) -> str:
        """The name of a file in reports: its place below the folder."""
        return path.relative_to(self.folder).as_posix()

    def hints(self) -> tuple[str, ...]:
        """Sentences on what may have been meant for photos and was not read."""
        found = [item.reason for item in self.passed_over[:_NAMED]]
        more = len(self.passed_over) - _NAMED
        if more > 0:
            found.append(
                f"{more} more file{'s are' if more > 1 else ' is'} passed over."
            )
        if self.others:
            one = len(self.others) == 1
            kind = "is not a photo and is" if one else "are not photos and are"
            found.append(f"{_listed(self.others)} {kind} passed over.")
        if self.photo_folders:
            listed = _listed(self.photo_folders)
            one = len(self.photo_folders) == 1
            found.append(
                f"The sub-folder{'' if one else 's'} {listed} "
                f"hold{'s' if one else ''} photos that are not read; if they show the "
                "same person, include the sub-folders (--recursive); if each shows "
                "another person, run `bsface batch`."
            )
        return tuple(found)


def scan_folder(folder: str | os.PathLike, recursive: bool = False) -> FolderScan:
    """Find the photos and videos of a folder, and name what is passed over.

    Parameters
    ----------
    folder : path
    recursive : bool
        Also look into the sub-folders. Links to folders are never followed, so that
        no link can lead in a circle.

    Raises
    ------
    ReconstructionError
        If there is no such folder, it is a file, or it may not be read.
    """
    expect_paths(folder=folder)
    expect(SWITCH, "true or false", recursive=recursive)
    if not os.fspath(folder):  # `Path` would take the present folder
        raise ReconstructionError(
            "The name of the folder is empty; give the folder that holds the photos."
        )
    folder = Path(folder)
    _check_folder(folder)
    kinds = ("photo", "video", "mask", "landmarks")
    files: dict[str, list[Path]] = {kind: [] for kind in kinds}
    passed_over: list[PassedOver] = []
    photo_folders: list[str] = []
    others: list[str] = []
    waiting, seen = [folder], set()
    while waiting:
        current = waiting.pop()
        # A junction of Windows is a folder to os.scandir: its true path tells.
        true_path = os.path.realpath(current)
        if true_path in seen:
            continue
        seen.add(true_path)
        for entry in _entries(current, needed=current == folder):
            path = Path(entry.path)
            name = path.relative_to(folder).as_posix()
            kind = _kind(entry)
            if kind == "folder" and recursive:
                waiting.append(path)
            elif kind == "folder" and _holds_photos(path):
                photo_folders.append(name)
            elif kind == "link":
                why = f"{name} is a link to a folder, which is not followed."
                passed_over.append(PassedOver(name, why))
            elif kind == "ours":
                why = f"{name} was written by bsface and is not read as a photo."
                passed_over.append(PassedOver(name, why))
            elif kind == "other":
                others.append(name)
            elif kind in files:
                files[kind].append(path)

    photos = {path.with_suffix("") for path in files["photo"]}
    for path in [*files["photo"]]:
        masked_photo, kind = os.path.splitext(path.with_suffix(""))
        if kind.lower() == ".mask" and Path(masked_photo) in photos:
            files["photo"].remove(path)
            name = path.relative_to(folder).as_posix()
            why = f"{name} is not read: a mask is a PNG file; export it as .mask.png."
            passed_over.append(PassedOver(name, why))
    of_photo = [(path, masked(path.name), "mask") for path in files["mask"]]
    of_photo += [(path, path.stem, "landmark file") for path in files["landmarks"]]
    for path, stem, what in of_photo:
        if path.with_name(stem) not in photos:
            name = path.relative_to(folder).as_posix()
            why = f"{name} is the {what} of no photo here; name it as its photo."
            passed_over.append(PassedOver(name, why))

    def order(path: Path) -> tuple:
        return natural_key(path.relative_to(folder).as_posix())

    return FolderScan(
        folder,
        tuple(sorted(files["photo"], key=order)),
        tuple(sorted(files["video"], key=order)),
        tuple(sorted(passed_over, key=lambda item: natural_key(item.name))),
        tuple(sorted(photo_folders, key=natural_key)),
        tuple(sorted(others, key=natural_key)),
    )


def is_video(path: Path) -> bool:
    """Whether a file is a video by its ending."""
    return path.suffix.lower() in VIDEO_ENDINGS


def list_photos(folder: str | os.PathLike, recursive: bool = False) -> tuple[Path, ...]:
    """The pictures of a folder, in natural order of their names.

    Hidden files and pictures that bsface wrote are passed over; `scan_folder` names
    what is. A file counts by its ending; whether it can be read is `read_photo`'s
    question.

    Parameters
    ----------
    folder : path
    recursive : bool
        Also those of the sub-folders.

    Raises
    ------
    ReconstructionError
        If there is no such folder, it is a file, it may not be read, or it
        holds no picture.
    """
    scan = scan_folder(folder, recursive)
    if not scan.photos:
        raise ReconstructionError(nothing_found(scan))
    return scan.photos


def list_sources(
    folder: str | os.PathLike, recursive: bool = False
) -> tuple[Path, ...]:
    """`list_photos` with the videos among them."""
    scan = scan_folder(folder, recursive)
    if not scan.sources:
        raise ReconstructionError(nothing_found(scan))
    return scan.sources


def nothing_found(scan: FolderScan) -> str:
    """Why a folder is of no use, in one sentence with the remedy."""
    if scan.photo_folders:
        return (
            f"{scan.folder} holds no photos itself, but its sub-folders do "
            f"({_listed(scan.photo_folders)}); give one of them, include the "
            "sub-folders (--recursive) if all show one person, or run `bsface batch`."
        )
    if any("written by bsface" in item.reason for item in scan.passed_over):
        return (
            f"{scan.folder} holds no photos but pictures that bsface wrote; put "
            "photos of one person into it."
        )
    return (
        f"{scan.folder} holds no photos; put JPEG, PNG, TIFF, WebP or BMP "
        "pictures of one person into it."
    )


def natural_key(name: str) -> tuple:
    """Sort key by which ``2.jpg`` comes before ``10.jpg``, whatever the case."""
    parts = re.split(r"(\d+)", name.casefold())
    # Text and numbers alternate, so equal positions always compare like kinds.
    return tuple(int(p) if p.isdecimal() else p for p in parts), name


def _check_folder(folder: Path) -> None:
    try:
        mode = folder.stat().st_mode
    except OSError as error:
        raise ReconstructionError(
            f"{folder}: cannot open this folder ({why_not(error)}); "
            "give the folder that holds the photos."
        ) from None
    except ValueError:
        raise ReconstructionError(
            f"{str(folder)!r} is not a possible folder name; "
            "give the folder that holds the photos."
        ) from None
    if not stat.S_ISDIR(mode):
        raise ReconstructionError(
            f"{folder} is a file, not a folder; give the folder that holds the photos."
        )


def _entries(folder: Path, needed: bool) -> Iterator[os.DirEntry]:
    try:
        with os.scandir(folder) as entries:
            yield from entries
    except OSError as error:
        if needed:
            raise ReconstructionError(
                f"{folder}: the folder cannot be read ({why_not(error)}); "
                "check its permissions."
            ) from None


def _kind(entry: os.DirEntry) -> str:
    """What it counts as: ``photo``, ``mask``, ``folder``, ...; ``silent`` = nothing."""
    if entry.name.startswith("."):
        return "silent"
    try:
        if entry.is_dir():
            return "link" if entry.is_symlink() else "folder"
    except OSError:
        pass  # a link to itself: the reader says so
    ending = Path(entry.name).suffix.lower()
    if is_mask(entry.name):
        return "mask"
    if ending == ".png" and _is_ours(entry):
        return "ours"
    if ending in READABLE_ENDINGS | FOREIGN_ENDINGS:
        return "photo"
    if ending in VIDEO_ENDINGS:
        return "video"
    if ending == ".pts":  # .json is written by many programs for much else
        return "landmarks"
    return "silent" if ending in _SILENT_ENDINGS else "other"


def _is_ours(entry: os.DirEntry) -> bool:
    try:
        # A named pipe would block for ever when opened.
        if not entry.is_file():
            return False
        with open(entry.path, "rb") as file:
            return is_marked(file.read(64))
    except OSError:
        return False


def _holds_photos(folder: Path) -> bool:
    try:
        with os.scandir(folder) as entries:
            return any(_kind(entry) in ("photo", "video") for entry in entries)
    except OSError:
        return False


def _listed(names: tuple[str, ...] | list[str]) -> str:
    shown = ", ".join(names[:_NAMED])
    return shown if len(names) <= _NAMED else f"{shown} and {len(names) - _NAMED} more"
