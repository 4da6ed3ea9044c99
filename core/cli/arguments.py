"""What several commands read from the command line, and how they refuse it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from ..files import why_not_writable
from ..formats import HEAD_ENDINGS, WRITERS, ending
from ..settings import Settings


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
        if not sign:
            raise ValueError(f"--set takes NAME=VALUE, got {pair!r}.")
        try:
            values[name] = json.loads(text)
        except ValueError:
            numbers = text.split(",")
            if len(numbers) == 2 and all(x.strip().isdigit() for x in numbers):
                values[name] = [int(x) for x in numbers]
            else:
                values[name] = text
    return Settings.from_dict(values)


def check_outputs(
    outputs: Sequence[str], *, report: str | None = None, log: str | None = None
) -> None:
    """Refuse what cannot be written before the work is done, not after it.

    Raises
    ------
    ValueError
        With a sentence that names the file.
    """
    for name in outputs:
        if not ending(name):
            raise ValueError(
                f"{name}: unknown ending; choose one of "
                f"{', '.join(['.npz', *WRITERS])}."
            )
    if report is not None and Path(report).suffix.lower() not in (".html", ".htm"):
        raise ValueError(f"{report}: the page must end in .html.")
    for name in (*outputs, report, log):
        why = why_not_writable(Path(name)) if name else ""
        if why:
            raise ValueError(f"{name}: {why}.")


def check_head(wanted: bool, outputs: Sequence[str]) -> None:
    """Refuse ``--head`` where no format can hold a head.

    Raises
    ------
    ValueError
        With a sentence that names the formats.
    """
    if wanted and not any(ending(name) in HEAD_ENDINGS for name in outputs):
        raise ValueError(f"--head needs a file {' or '.join(HEAD_ENDINGS)}.")
