"""How a job, or one photo of it, fails.

A fault of the whole job is an exception; a fault of one photo is a value, so
that the rest of the folder is still used and the photo's row in the report
says why it was left out.
"""

from __future__ import annotations

from dataclasses import dataclass

FAILURE_CODES = (
    "unreadable",
    "too_large",
    "no_face",
    "small_face",
    "blurred",
    "dark",
    "bright",
    "implausible",
    "other_person",
    "ignored",
    "duplicate",
)


class ReconstructionError(Exception):
    """The whole job failed; ``str()`` is one sentence with the remedy."""


class Cancelled(Exception):
    """Raised by a progress callback to stop the job."""


# What the libraries say when memory runs out: OpenCV, SuperLU, NumPy, C++.
_NO_MEMORY = ("bad_alloc", "Insufficient memory", "MALLOC failed", "nable to allocate")


def out_of_memory(error: BaseException) -> bool:
    """Whether an exception says that memory ran out, whichever library raised it."""
    if isinstance(error, MemoryError):
        return True
    return not isinstance(error, ReconstructionError) and any(
        words in str(error) for words in _NO_MEMORY
    )


@dataclass(frozen=True)
class PhotoFailure:
    """Why one photo is not used; falsy, so ``if not photo:`` reads well.

    Parameters
    ----------
    name : str
        The photo's name as in the report.
    code : str
        One of `FAILURE_CODES`, for programs.
    reason : str
        One sentence with the file's name and the remedy, for people.
    """

    name: str
    code: str
    reason: str

    def __post_init__(self) -> None:
        if self.code not in FAILURE_CODES:
            raise ValueError(f"unknown failure code {self.code!r}")

    def __bool__(self) -> bool:
        return False
