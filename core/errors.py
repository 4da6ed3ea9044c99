"""How a job, or one photo of it, fails.

A fault of the whole job is an exception; a fault of one photo is a value, so
that the rest of the folder is still used and the photo's row in the report
says why it was left out.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum


class FailureCode(StrEnum):
    """Why a photo is not used: a code for programs, a `label` for people."""

    label: str

    def __new__(cls, code: str, label: str) -> FailureCode:
        member = str.__new__(cls, code)
        member._value_ = code
        member.label = label
        return member

    UNREADABLE = "unreadable", "cannot be read"
    TOO_LARGE = "too_large", "too large"
    NO_FACE = "no_face", "no face found"
    SMALL_FACE = "small_face", "face too small"
    BLURRED = "blurred", "blurred"
    DARK = "dark", "too dark"
    BRIGHT = "bright", "too bright"
    IMPLAUSIBLE = "implausible", "landmarks form no face"
    OTHER_PERSON = "other_person", "somebody else"
    IGNORED = "ignored", "set aside"
    DUPLICATE = "duplicate", "duplicate"


def one_line(text: str) -> str:
    """The text with line ends and other control characters written out.

    Files and folders have any name; a sentence that names one stays one line and
    steers no terminal.
    """
    return _CONTROL.sub(lambda found: repr(found[0])[1:-1], text)


_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


class ReconstructionError(Exception):
    """The whole job failed; ``str()`` is one sentence with the remedy.

    Parameters
    ----------
    sentence : str
    photos : sequence of PhotoFailure, optional
        Where no photo can be used: each with its reason.
    """

    def __init__(self, sentence: str = "", photos: Sequence[PhotoFailure] = ()) -> None:
        super().__init__(sentence)
        self.photos = tuple(photos)

    def __str__(self) -> str:
        return one_line(super().__str__())


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


@contextlib.contextmanager
def memory_reported() -> Iterator[None]:
    """Within the block a lack of memory, of whichever library, becomes a sentence."""
    try:
        yield
    except Exception as error:
        if not out_of_memory(error):
            raise
        raise ReconstructionError(
            "There is not enough memory; use fewer photos or a smaller net "
            "(control_points 30, 30)."
        ) from None


@dataclass(frozen=True)
class PhotoFailure:
    """Why one photo is not used; falsy, so ``if not photo:`` reads well.

    Parameters
    ----------
    name : str
        The photo's name as in the report.
    code : FailureCode
        For programs; may be given by its value.
    reason : str
        One sentence with the file's name and the remedy, for people.
    """

    name: str
    code: FailureCode | str
    reason: str

    def __post_init__(self) -> None:
        if not isinstance(self.reason, str):
            kind = type(self.reason).__name__
            raise TypeError(f"reason must be a sentence, not {kind}.")
        object.__setattr__(self, "code", FailureCode(self.code))
        object.__setattr__(self, "reason", one_line(self.reason))

    def __bool__(self) -> bool:
        return False
