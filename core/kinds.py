"""Kinds of arguments, told at the door: one sentence instead of a fault further in."""

from __future__ import annotations

import os
from collections.abc import Callable
from types import UnionType

import numpy as np

Kinds = type | UnionType | tuple[type, ...]

PATH: Kinds = (str, os.PathLike)
SWITCH: Kinds = (bool, np.bool_)
CALLBACK: Kinds = Callable | type(None)


def expect(kinds: Kinds, wanted: str, **given: object) -> None:
    """Refuse arguments of another kind.

    Parameters
    ----------
    kinds : type, union or tuple of types
    wanted : str
        What they must be, as in "must be a path".
    **given
        The arguments by their names.

    Raises
    ------
    TypeError
    """
    for name, value in given.items():
        if not isinstance(value, kinds):
            raise TypeError(f"{name} must be {wanted}, not {type(value).__name__}.")


def expect_paths(**given: object) -> None:
    """Refuse what is no path; see `expect`."""
    expect(PATH, "a path", **given)


def expect_whole(low: int, high: int, **given: object) -> None:
    """Refuse what is no whole number from ``low`` to ``high``; see `expect`.

    Raises
    ------
    TypeError, ValueError
    """
    wanted = f"a whole number from {low} to {high}"
    for name, value in given.items():
        if isinstance(value, bool) or not isinstance(value, int | np.integer):
            raise TypeError(f"{name} must be {wanted}, not {type(value).__name__}.")
        if not low <= value <= high:
            raise ValueError(f"{name} must be {wanted}, not {value}.")
