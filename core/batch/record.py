"""What a batch remembers of each person, so that it can be stopped and started again.

``OUT/<person>/done.json`` is written last. It holds the fingerprint of everything that
the result depends on (photos, landmark and mask files, settings, wanted files, and the
versions of bsface, Python, NumPy, SciPy, OpenCV and the system) and the hash of every
file written: a person is skipped when both still fit.
"""

from __future__ import annotations

import csv
import dataclasses
import hashlib
import io
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..errors import ReconstructionError, one_line
from ..files import is_temporary, write_text
from ..images.folder import list_sources
from ..landmarks.candidates import files_beside
from ..report.facts import SCHEMA, versions

RECORD = "done.json"


@dataclass(frozen=True)
class Outcome:
    """What became of one person.

    Attributes
    ----------
    person : str
        Name of the folder.
    status : str
        "done", "skipped" (finished before, nothing changed) or "failed".
    reason : str
        Sentence when failed.
    used, photos : int
        Photos used and in the folder.
    warnings : tuple of str
    files : tuple of str
        Names in the person's output folder.
    seconds : float
        Of this run; 0 when skipped.
    """

    person: str
    status: str
    reason: str = ""
    used: int = 0
    photos: int = 0
    warnings: tuple[str, ...] = ()
    files: tuple[str, ...] = ()
    seconds: float = field(default=0.0, compare=False)


def fingerprint(folder: Path, settings: dict[str, Any], wanted: Sequence[str]) -> str:
    """Hash of everything that a person's files depend on.

    Raises
    ------
    ReconstructionError
        When the folder holds no photos or cannot be read.
    """
    total = hashlib.sha256()
    # Another version may give another face.
    total.update(json.dumps([settings, list(wanted), versions()]).encode())
    for photo in list_sources(folder):
        for path in (photo, *files_beside(photo)):
            total.update(f"{path.name}\0{hash_of(path)}".encode())
    return total.hexdigest()


def hash_of(path: Path) -> str:
    """SHA-256 of a file; of its name alone when it cannot be read."""
    try:
        if not path.is_file():  # to open a named pipe would wait for ever
            raise FileNotFoundError
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return hashlib.sha256(os.fsencode(path.name)).hexdigest()


def write_record(folder: Path, mark: str, outcome: Outcome) -> None:
    """Remember a finished person."""
    content = {
        "fingerprint": mark,
        "used": outcome.used,
        "photos": outcome.photos,
        "warnings": list(outcome.warnings),
        "files": {name: hash_of(folder / name) for name in outcome.files},
        "older": left_over(folder, outcome.files),
    }
    write_text(folder / RECORD, json.dumps(content, indent=1) + "\n")


def recall(folder: Path, mark: str) -> Outcome | None:
    """The outcome of an earlier run if all of it still holds, else None."""
    content = _read_record(folder)
    try:
        files = dict(content["files"])
        if content["fingerprint"] != mark:
            return None
        if any(hash_of(folder / name) != digest for name, digest in files.items()):
            return None
        return Outcome(
            person=folder.name,
            status="skipped",
            used=int(content["used"]),
            photos=int(content["photos"]),
            warnings=tuple(str(sentence) for sentence in content["warnings"]),
            files=tuple(files),
        )
    except (OSError, ValueError, LookupError, TypeError, ArithmeticError):
        return None


def _read_record(folder: Path) -> Any:
    """What `write_record` wrote, or whatever stands in its place; None for nothing."""
    try:
        return json.loads((folder / RECORD).read_text("utf-8"))
    except (OSError, ValueError):
        return None
    except RecursionError:  # brackets within brackets
        return None


def left_over(folder: Path, files: Sequence[str]) -> tuple[str, ...]:
    """What other runs wrote for a person and the last one did not.

    Parameters
    ----------
    folder : Path
        Of the person's results.
    files : sequence of str
        Those that hold the person's face now.
    """
    content = _read_record(folder)
    try:
        before = {str(name) for name in [*content["files"], *content.get("older", [])]}
        return tuple(
            sorted(n for n in before.difference(files) if (folder / n).exists())
        )
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        return ()


def sweep(folder: Path) -> None:
    """Remove half-written files of a run that was killed."""
    if folder.is_dir():
        for path in folder.iterdir():
            if is_temporary(path.name) and path.is_file():
                path.unlink(missing_ok=True)


def people_in(folder: str | os.PathLike) -> tuple[Path, ...]:
    """The sub-folders of a folder, one per person, in the order of their names.

    Raises
    ------
    ReconstructionError
        When there is no such folder or it has no sub-folder.
    """
    folder = Path(folder)
    try:
        here = Path(os.path.realpath(folder))
        found = sorted(
            p
            for p in folder.iterdir()
            if (p.is_dir() or _leads_nowhere(p))
            and not p.name.startswith(".")
            # a link to the folder itself or to one above it is no person
            and not here.is_relative_to(os.path.realpath(p))
        )
    except OSError as error:
        raise ReconstructionError(
            f"{folder}: cannot open this folder ({error.strerror}); give the folder "
            "that holds one sub-folder of photos per person."
        ) from None
    if not found:
        raise ReconstructionError(
            f"{folder} has no sub-folders; put the photos of each person into one."
        )
    return tuple(found)


def _leads_nowhere(path: Path) -> bool:
    """Whether it is a link to what is not there, and not to itself.

    Such a person, on a drive that is not mounted, fails and is not passed over.
    """
    return path.is_symlink() and not os.path.lexists(os.path.realpath(path))


def summary_csv(outcomes: Sequence[Outcome]) -> str:
    """The table of a batch; the same text whether it was interrupted or not."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["person", "status", "used", "photos", "remark"])
    for outcome in outcomes:
        status = "failed" if outcome.status == "failed" else "done"
        person = _cell(outcome.person)
        remark = _cell(_remark(outcome))
        table.writerow([person, status, outcome.used, outcome.photos, remark])
    return text.getvalue()


def _cell(text: str) -> str:
    """A cell that no spreadsheet takes for a formula (folders have any names)."""
    return f"'{text}" if text.startswith(("=", "+", "-", "@", "\t", "\r")) else text


def _remark(outcome: Outcome) -> str:
    return " ".join(filter(None, [outcome.reason, *outcome.warnings]))


def batch_facts(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """The same for programs; ``docs/result.schema.json`` describes it."""
    people = [dataclasses.asdict(outcome) for outcome in outcomes]
    return {"schema": SCHEMA, "people": people}


def summary_lines(outcomes: Sequence[Outcome]) -> list[str]:
    """The same for a terminal, with times."""
    names = [one_line(o.person) for o in outcomes]
    width = max(map(len, names), default=6)
    lines = [f"{'person':<{width}}  {'status':<7}  {'photos':>9}  {'time':>7}  remark"]
    for name, o in zip(names, outcomes, strict=True):
        time = f"{o.seconds:.0f} s" if o.seconds else ""
        photos = f"{o.used} of {o.photos}"
        lines.append(
            f"{name:<{width}}  {o.status:<7}  {photos:>9}  {time:>7}  {_remark(o)}"
        )
    return lines
