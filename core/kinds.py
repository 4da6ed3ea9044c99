"""Kinds of arguments, told at the door: one sentence instead of a fault further in."""

from __future__ import annotations

import os
from collections.abc import Callable
from types import UnionType

import numpy as np
from numpy.typing import NDArray

Kinds = type | UnionType | tuple[type, ...]

PATH: Kinds = (str, os.PathLike)
SWITCH: Kinds = (bool, np.bool_)
NUMBER: Kinds = (int, float, np.integer, np.floating)
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


def expect_number(**given: object) -> None:
    """Refuse what is no number, and true and false; see `expect`."""
    for name, value in given.items():
        if isinstance(value, bool):
            raise TypeError(f"{name} must be a number, not bool.")
    expect(NUMBER, "a number", **given)


def real_numbers(given: object, name: str) -> NDArray[np.float64]:
    """An array of numbers as float64, not copied where it is that already.

    Raises
    ------
    ValueError
        For text, true or false, complex numbers, None, and lists of unequal length.
    """
    try:
        found = np.asarray(given)
    except ValueError:
        raise ValueError(f"{name} must be an array of numbers.") from None
    if found.dtype.kind not in "fiu":
        raise ValueError(f"{name} must hold real numbers, not {found.dtype}.")
    return found.astype(np.float64, copy=False)


def coordinates(given: object, name: str, count: int) -> NDArray[np.float64]:
    """Points ``(..., count)`` as float64; an empty list is no points.

    Raises
    ------
    ValueError
        See `real_numbers`; and for another number of coordinates.
    """
    found = real_numbers(given, name)
    if found.shape == (0,):
        return found.reshape(0, count)
    if found.ndim == 0 or found.shape[-1] != count:
        raise ValueError(f"{name} must be (..., {count}), not {found.shape}.")
    return found


def expect_picture(given: object, name: str, meaning: str, *channels: int) -> None:
    """Refuse what is no square picture of finite floats.

    Parameters
    ----------
    given : object
    name, meaning : str
        What the sentence calls it, and what its numbers are.
    *channels : int
        3 for (S, S, 3); none for (S, S).

    Raises
    ------
    TypeError, ValueError
    """
    if not isinstance(given, np.ndarray):
        raise TypeError(f"{name} must be an array, not {type(given).__name__}.")
    square = given.shape[:1] * 2
    if given.dtype.kind != "f" or given.shape != (*square, *channels) or not given.size:
        wanted = ", ".join(["S", "S", *map(str, channels)])
        raise ValueError(
            f"{name} must be an ({wanted}) array of {meaning} as floats, not "
            f"{given.dtype} of shape {given.shape}."
        )
    if not np.isfinite(given).all():
        raise ValueError(f"{name} must be finite; fill what was not measured first.")
