"""Rows of results as a text table and as a CSV file."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from bsface.files import write_text

#: Columns of the accuracy table: key, heading, format.
COLUMNS = (
    ("mean", "mean %", ".2f"),
    ("median", "median %", ".2f"),
    ("rms", "RMS %", ".2f"),
    ("std", "std %", ".2f"),
    ("p90", "p90 %", ".2f"),
    ("normals", "normals", ".1f"),
    ("used", "used", ".0%"),
    ("seconds", "s", ".0f"),
)


def text_table(
    rows: Sequence[Mapping[str, object]],
    columns: Sequence[tuple[str, str, str]],
    labels: Sequence[tuple[str, str]],
) -> str:
    """Aligned columns: labels to the left, numbers to the right.

    Parameters
    ----------
    rows : sequence of mappings
        Missing or NaN numbers are shown as a dash.
    columns : sequence of (key, heading, format)
    labels : sequence of (key, heading)
    """
    heads = [h for _, h in labels] + [h for _, h, _ in columns]
    lines = [
        [str(row.get(k, "")) for k, _ in labels]
        + [show(row.get(k), form) for k, _, form in columns]
        for row in rows
    ]
    widths = [max(map(len, column)) for column in zip(heads, *lines, strict=True)]
    left = len(labels)

    def line(cells: Sequence[str]) -> str:
        parts = [
            f"{c:<{w}}" if i < left else f"{c:>{w}}"
            for i, (c, w) in enumerate(zip(cells, widths, strict=True))
        ]
        return "  ".join(parts).rstrip()

    return "\n".join([line(heads), *(line(cells) for cells in lines)])


def show(value: object, form: str) -> str:
    """A number in its format; a dash where there is none."""
    if isinstance(value, str):
        return value
    if value is None or not np.isfinite(float(value)):  # type: ignore[arg-type]
        return "-"
    return format(float(value), form)  # type: ignore[arg-type]


def write_csv(path: Path, rows: Iterable[Mapping[str, object]]) -> None:
    """Write rows; the columns are the keys in order of appearance."""
    rows = list(rows)
    keys = list(dict.fromkeys(key for row in rows for key in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, keys, restval="", lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({k: _plain(v) for k, v in row.items()})
    write_text(path, text.getvalue())


def averages(
    rows: Sequence[Mapping[str, object]], keys: Sequence[str], by: str
) -> list[dict[str, object]]:
    """Mean of the numbers over all rows with the same ``by``, in order."""
    groups: dict[object, list[Mapping[str, object]]] = {}
    for row in rows:
        groups.setdefault(row[by], []).append(row)
    out = []
    for name, members in groups.items():
        line: dict[str, object] = {by: name, "sets": len(members)}
        for key in keys:
            values = [m.get(key) for m in members]
            # One failure spoils the mean: a method is not rewarded for failing.
            line[key] = (
                float("nan")
                if any(v is None for v in values)
                else float(np.mean(values))  # type: ignore[arg-type]
            )
        out.append(line)
    return out


def _plain(value: object) -> object:
    if isinstance(value, float | np.floating):
        return "" if not np.isfinite(value) else f"{float(value):.5g}"
    return value
