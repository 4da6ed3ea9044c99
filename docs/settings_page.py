#!/usr/bin/env python3
"""Write the table of docs/settings.md from the dataclass.

    python docs/settings_page.py

Names, defaults and limits come from ``core/settings.py``, the words from the docstring
of `Settings`.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
from pathlib import Path

from bsface.settings import CHOICES, LIMITS, Settings

PAGE = Path(__file__).resolve().parent / "settings.md"
START, END = "<!-- table settings -->\n", "<!-- end -->"


def words() -> dict[str, str]:
    """Name -> sentence, from the docstring."""
    text = inspect.cleandoc(Settings.__doc__ or "")
    entry = re.compile(r"^(\w[\w, ]*) : .*\n((?:    .*\n?)+)", re.MULTILINE)
    found = {}
    for names, body in entry.findall(text):
        for name in names.split(", "):
            found[name] = " ".join(body.split()).replace("``", "`")
    return found


def allowed(name: str, default: object) -> str:
    """What a setting may be."""
    if name in CHOICES:
        return ", ".join(map(str, CHOICES[name]))
    if isinstance(default, bool):
        return "true, false"
    if name in LIMITS:
        low, high = LIMITS[name]
        return f"{low:g} to {high:g}"
    return "two whole numbers"


def table() -> str:
    """The table in Markdown."""
    says = words()
    lines = ["| setting | default | allowed | meaning |", "|---|---|---|---|"]
    for field in dataclasses.fields(Settings):
        value = field.default
        shown = str(value).lower() if isinstance(value, bool) else str(value)
        lines.append(
            f"| `{field.name}` | {shown} | {allowed(field.name, value)} "
            f"| {says[field.name]} |"
        )
    return "\n".join(lines) + "\n"


def page(text: str) -> str:
    """The page with a fresh table."""
    before, _, rest = text.partition(START)
    return before + START + table() + END + rest.partition(END)[2]


def main() -> None:
    """Rewrite the page."""
    PAGE.write_text(page(PAGE.read_text("utf-8")), "utf-8")
    print(f"{PAGE.name}: {len(dataclasses.fields(Settings))} settings")


if __name__ == "__main__":
    main()
