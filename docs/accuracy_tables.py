#!/usr/bin/env python3
"""Put the numbers of the benchmarks into docs/accuracy.md.

    python docs/accuracy_tables.py

Reads the CSV files that the scripts in ``benchmarks/`` wrote into ``out/`` and rewrites
what stands between ``<!-- table NAME -->`` and ``<!-- end -->`` in the page.  A table
whose file is missing stays as it is.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "accuracy.md"
OUT = ROOT / "out"

Row = Mapping[str, str]

MEASURES = (
    ("mean", "mean %", ".2f"),
    ("median", "median %", ".2f"),
    ("rms", "RMS %", ".2f"),
    ("std", "std %", ".2f"),
    ("p90", "p90 %", ".2f"),
    ("normals", "normals °", ".1f"),
    ("used", "photos used", ".0%"),
    ("seconds", "s", ".0f"),
)


def main() -> None:
    """Fill every table whose CSV file is there."""
    fill(PAGE, TABLES)


def fill(
    page: Path, tables: Mapping[str, tuple[str, Callable[[list[Row]], str]]]
) -> None:
    """Rewrite the tables of a page: name -> file below ``out/`` and what makes it."""
    text = page.read_text("utf-8")
    for name, (file, make) in tables.items():
        path = OUT / file
        marks = re.compile(rf"(<!-- table {name} -->\n).*?(<!-- end -->)", re.DOTALL)
        if not marks.search(text):
            print(f"{page.relative_to(ROOT)} has no place for the table {name}")
        elif not path.is_file():
            print(f"{name}: {path.relative_to(ROOT)} is not there, left as it is")
        else:
            with path.open(newline="", encoding="utf-8") as handle:
                table = make(list(csv.DictReader(handle)))
            text = marks.sub(lambda m, t=table: f"{m[1]}{t}\n{m[2]}", text)
            print(f"{name}: from {path.relative_to(ROOT)}")
    page.write_text(text, "utf-8")


def markdown(
    rows: Sequence[Mapping[str, object]],
    labels: Sequence[tuple[str, str]],
    columns: Sequence[tuple[str, str, str]],
) -> str:
    """A Markdown table; missing numbers are a dash."""
    heads = [h for _, h in labels] + [h for _, h, _ in columns]
    lines = ["| " + " | ".join(heads) + " |"]
    lines.append("|" + "---|" * len(labels) + "---:|" * len(columns))
    for row in rows:
        cells = [str(row.get(k, "")) for k, _ in labels]
        cells += [number(row.get(k, ""), form) for k, _, form in columns]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def number(value: object, form: str) -> str:
    """A number of a CSV file in a format."""
    return "-" if value in ("", None) else format(float(value), form)  # type: ignore[arg-type]


def mean_of(rows: Sequence[Row], key: str) -> float | str:
    """Mean over rows; empty when one of them has no number."""
    values = [row.get(key, "") for row in rows]
    if not values or "" in values:
        return ""
    return sum(map(float, values)) / len(values)


def by_set(rows: list[Row]) -> str:
    """Mean and normal error: a row a method, a column a set."""
    sets = list(dict.fromkeys(row["set"] for row in rows))
    lines = []
    for method in dict.fromkeys(row["method"] for row in rows):
        line = {"method": method}
        for row in rows:
            if row["method"] == method:
                both = (number(row["mean"], ".2f"), number(row["normals"], ".1f"))
                line[row["set"]] = " / ".join(both)
        lines.append(line)
    return markdown(
        lines, [("method", "mean % / normals °"), *((s, s) for s in sets)], ()
    )


def by_method(rows: list[Row]) -> str:
    """Means over the sets of one expression, of mixed ones and of press photos."""
    lines = []
    for kind, ends in (("S1-S4", "1234"), ("S5", ("S5",)), ("P5", ("P5",))):
        chosen = [r for r in rows if r["set"].endswith(tuple(ends))]
        for method in dict.fromkeys(r["method"] for r in chosen):
            own = [r for r in chosen if r["method"] == method]
            line: dict[str, object] = {"kind": f"{kind} ({len(own)})", "method": method}
            line |= {k: mean_of(own, k) for k, _, _ in MEASURES}
            lines.append(line)
    return markdown(lines, [("kind", "sets"), ("method", "method")], MEASURES)


def fewer(rows: list[Row]) -> str:
    """As `by_set`: a row a number of photos."""
    return by_set([{**row, "method": row["variant"]} for row in rows])


def fewer_within(rows: list[Row]) -> str:
    """Share of the area within one standard deviation: a row a number of photos."""
    sets = list(dict.fromkeys(row["set"] for row in rows))
    lines = []
    for name in dict.fromkeys(row["variant"] for row in rows if row["within"]):
        own = [row for row in rows if row["variant"] == name]
        line: dict[str, object] = {"variant": name, "mean": mean_of(own, "within")}
        lines.append(line | {row["set"]: row["within"] for row in own})
    columns = [(name, name, ".0%") for name in [*sets, "mean"]]
    return markdown(lines, [("variant", "within 68%")], columns)


def ablation(rows: list[Row]) -> str:
    """A row an ingredient, averaged over the sets, with the change it makes."""
    lines = []
    names = dict.fromkeys(
        (r["group"], r["variant"]) for r in rows if r["group"] != "photos"
    )
    base = [r for r in rows if r["variant"] == "default"]
    for group, name in names:
        own = [r for r in rows if (r["group"], r["variant"]) == (group, name)]
        line: dict[str, object] = {"group": group, "variant": name}
        for key in ("mean", "rms", "normals", "seconds"):
            line[key] = mean_of(own, key)
        for key, change in (("mean", "change"), ("normals", "turn")):
            if "" not in (line[key], mean_of(base, key)):
                line[change] = float(line[key]) - float(mean_of(base, key))  # type: ignore[arg-type]
        lines.append(line)
    return markdown(
        lines,
        [("group", "group"), ("variant", "changed")],
        (
            ("mean", "mean %", ".2f"),
            ("change", "against default", "+.2f"),
            ("rms", "RMS %", ".2f"),
            ("normals", "normals °", ".1f"),
            ("turn", "against default", "+.1f"),
            ("seconds", "s", ".0f"),
        ),
    )


def budget(rows: list[Row]) -> str:
    """A row a replaced part: each set, and the mean with the change it makes."""
    lines = []
    sets = list(dict.fromkeys(r["set"] for r in rows))
    base = [r for r in rows if r["row"] == "default"]
    for name in dict.fromkeys(r["row"] for r in rows):
        own = [r for r in rows if r["row"] == name]
        line: dict[str, object] = {"row": name}
        for r in own:
            both = (number(r["mean"], ".2f"), number(r["normals"], ".1f"))
            line[r["set"]] = " / ".join(both)
        for key, change in (("mean", "change"), ("normals", "turn")):
            line[key] = mean_of(own, key)
            if "" not in (line[key], mean_of(base, key)):
                line[change] = float(line[key]) - float(mean_of(base, key))  # type: ignore[arg-type]
        lines.append(line)
    return markdown(
        lines,
        [("row", "mean % / normals °"), *((s, s) for s in sets)],
        (
            ("mean", "mean %", ".2f"),
            ("change", "against default", "+.2f"),
            ("normals", "normals °", ".1f"),
            ("turn", "against default", "+.1f"),
        ),
    )


def reliability(rows: list[Row]) -> str:
    """Share of the area within intervals of given probability, a row a set."""
    levels = [key for key in rows[0] if key.startswith("within ")]
    columns = [(key, key.removeprefix("within "), ".0%") for key in levels]
    lines: list[Mapping[str, object]] = [*rows]
    lines.append({"set": "mean"} | {k: mean_of(rows, k) for k in levels})
    return markdown(lines, [("set", "set")], columns)


def halves(rows: list[Row]) -> str:
    """Distances within and between people."""
    return markdown(
        rows,
        [("what", "")],
        (
            ("within", "within %", ".2f"),
            ("within_max", "largest", ".2f"),
            ("between", "between %", ".2f"),
            ("between_min", "smallest", ".2f"),
            ("ratio", "ratio", ".1f"),
            ("matched", "matched", ".0f"),
            ("people", "of", ".0f"),
        ),
    )


def held_out(rows: list[Row]) -> str:
    """Landmarks of photos that were not used."""
    columns = (
        ("face", "face %", ".2f"),
        ("template", "template %", ".2f"),
        ("mesh", "mean MediaPipe mesh %", ".2f"),
        ("photos", "photos", ".0f"),
    )
    lines = numbered(rows, "person", "press person")
    keys = [k for k, _, _ in columns[:3]]
    lines.append({"person": "mean"} | {k: mean_of(rows, k) for k in keys})
    return markdown(lines, [("person", "person")], columns)


def identity(rows: list[Row]) -> str:
    """How often outlier identities are found: a row per kind of folder."""
    columns = (
        ("photos", "photos", ".0f"),
        ("wrong", "wrong %", ".2f"),
        ("wrong_most", "most", ".0f"),
        ("wrong_folders", "folders %", ".0f"),
        ("doubts", "doubts %", ".0f"),
        ("found", "found %", ".0f"),
        ("found_or_doubt", "with doubts %", ".0f"),
    )
    labels = (("pictures", "pictures"), ("folder", "folder"))
    return markdown(rows, labels, columns)


def choice(rows: list[Row]) -> str:
    """What becomes of the photos of whole folders: a row per folder."""
    columns = (
        ("several", "several faces", ".0f"),
        ("shown", "shown", ".0f"),
        ("right", "right", ".0f"),
        ("doubted", "doubted", ".0f"),
        ("left_out", "left out", ".0f"),
        ("others", "others", ".0f"),
        ("silent", "silent", ".0f"),
    )
    named = numbered(rows, "person", "web folder")
    return markdown(named, [("person", "person")], columns)


def numbered(rows: Sequence[Row], key: str, name: str) -> list[Mapping[str, object]]:
    """The rows with numbers in the place of the names of people."""
    return [{**row, key: f"{name} {k}"} for k, row in enumerate(rows, 1)]


def reprojection(rows: list[Row]) -> str:
    """A row a person: medians against detected and against true landmarks."""
    columns = (
        ("photos", "used", ".0f"),
        ("report", "landmarks %", ".2f"),
        ("seen", "surface %", ".2f"),
        ("calm", "calm surface %", ".2f"),
        ("detector", "detector, true %", ".2f"),
        ("true", "surface, true %", ".2f"),
    )
    examples = [row for row in rows if row["name"] == "examples"]
    people = [row for row in rows if row["name"] != "examples"]
    named = [*examples, *numbered(people, "name", "press person")]
    return markdown(named, (("name", "photos of"),), columns)


def focal_lengths(rows: list[Row]) -> str:
    """A row a set and a number of photos: far and near, without and with EXIF."""
    keys = ("photos", "taken", "exif")
    alike: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        alike.setdefault(tuple(row[k] for k in keys), []).append(row)
    means = [
        {**own[0], "set": "mean"} | {k: mean_of(own, k) for k in ("mean", "normals")}
        for own in alike.values()
    ]
    lines: dict[tuple[object, object], dict[str, object]] = {}
    for row in [*rows, *means]:
        line = lines.setdefault((row["set"], row["photos"]), dict(row))
        both = (number(row["mean"], ".2f"), number(row["normals"], ".1f"))
        line[f"{row['taken']}, EXIF {row['exif']}"] = " / ".join(both)
    columns = [
        (f"{taken}, EXIF {exif}", f"{taken}, {how} EXIF")
        for taken in ("far", "near")
        for exif, how in (("no", "without"), ("yes", "with"))
    ]
    labels = [("set", "mean % / normals °"), ("photos", "photos"), *columns]
    return markdown(list(lines.values()), labels, ())


TABLES: dict[str, tuple[str, Callable[[list[Row]], str]]] = {
    "sets": ("accuracy/accuracy.csv", by_set),
    "methods": ("accuracy/accuracy.csv", by_method),
    "fewer": ("fewer/ablation.csv", fewer),
    "fewer-within": ("fewer/ablation.csv", fewer_within),
    "focal-lengths": ("near_cameras/near_cameras.csv", focal_lengths),
    "ablation": ("accuracy/ablation.csv", ablation),
    "error-budget": ("error_budget/error_budget.csv", budget),
    "reliability": ("accuracy/reliability.csv", reliability),
    "halves": ("real_photos/halves.csv", halves),
    "held-out": ("real_photos/held_out.csv", held_out),
    "reprojection": ("reprojection/reprojection.csv", reprojection),
    "identity": ("identity/identity.csv", identity),
    "choice": ("identity/choice.csv", choice),
}


if __name__ == "__main__":
    main()
