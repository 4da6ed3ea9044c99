"""What several commands read from the command line, and how they refuse it."""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..formats import ending
from ..settings import Settings
from .terminal import write_out

if TYPE_CHECKING:
    from _typeshed import SupportsWrite


_WHOLE = re.compile(r"\s*[0-9]{1,9}\s*")


class Parser(argparse.ArgumentParser):
    """A parser whose help ends with 1 where it cannot be written."""

    def print_help(self, file: SupportsWrite[str] | None = None) -> None:
        """The help, on the standard output."""
        if file is not None:
            super().print_help(file)
        elif code := write_out(self.format_help()):
            self.exit(code)


def parse_settings(pairs: Sequence[str]) -> Settings:
    """Settings from ``NAME=VALUE`` words.

    Raises
    ------
    ValueError
        With a sentence that names the word.
    """
    values = {}
    for pair in pairs:
        name, sign, text = pair.partition("=")
        if not sign or not name:
            raise ValueError(f"--set takes NAME=VALUE, got {pair!r}.")
        if name in values:
            raise ValueError(f"The setting {name} is given twice; leave one out.")
        try:
            values[name] = json.loads(text)
        except (ValueError, RecursionError):  # brackets within brackets
            numbers = text.split(",")
            if len(numbers) == 2 and all(map(_WHOLE.fullmatch, numbers)):
                values[name] = [int(x) for x in numbers]
            else:
                values[name] = text
    return Settings.from_dict(values)


def check_named(args: argparse.Namespace, *names: str) -> None:
    """Refuse empty names, as variables of a script give them that are not set.

    Parameters
    ----------
    args : argparse.Namespace
    names : str
        Of arguments that are None, a text or a list of texts.

    Raises
    ------
    ValueError
        With a sentence that names the argument.
    """
    for name in names:
        given = getattr(args, name)
        if "" in (given if isinstance(given, list) else [given]):
            raise ValueError(f"The name given for {name} is empty; give a file.")


def check_held(option: str, endings: Sequence[str], outputs: Sequence[str]) -> None:
    """Refuse an option whose content no output can hold.

    Parameters
    ----------
    option : str
        Such as ``--head``; it was given.
    endings : sequence of str
        Of the formats that hold it.
    outputs : sequence of str

    Raises
    ------
    ValueError
        With a sentence that names the formats.
    """
    if not any(ending(name) in endings for name in outputs):
        raise ValueError(f"{option} needs a file {' or '.join(endings)}.")
