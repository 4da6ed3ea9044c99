#!/usr/bin/env python3
"""Put the numbers of ``benchmarks/speed.py`` into docs/speed.md.

    python docs/speed_tables.py

Reads ``out/speed/speed.csv`` and rewrites what stands between ``<!-- table NAME -->``
and ``<!-- end -->`` in the page.
"""

from __future__ import annotations

from accuracy_tables import ROOT, Row, fill, markdown

PAGE = ROOT / "docs" / "speed.md"
STAGES = ("landmarks", "motion", "refine", "output")
JOB = (
    *((stage, f"{stage} s", ".1f") for stage in STAGES),
    ("all", "all s", ".1f"),
    ("ratio", "all / landmarks", ".1f"),
    ("each", "s a photo", ".2f"),
    ("megabytes", "peak MB", ".0f"),
)


def main() -> None:
    """Fill the tables of the page."""
    fill(PAGE, {name: ("speed/speed.csv", make) for name, make in TABLES.items()})


def jobs(rows: list[Row], part: str) -> list[dict[str, object]]:
    """One line a job: seconds of its stages, their sum and ratios, peak of memory."""
    lines: dict[tuple[str, str], dict[str, object]] = {}
    for row in rows:
        if row["part"] != part:
            continue
        size = row.get("megapixels", "")
        line = lines.setdefault(
            (row["photos"], size),
            {"photos": row["photos"], "size": "as they are" if size == "0" else size},
        )
        if row["stage"] == "peak":
            line["megabytes"] = row["megabytes"]
        else:
            line[row["stage"]] = float(row["cpu"])
    for line in lines.values():
        seconds = {s: float(str(line[s])) for s in STAGES}
        total = sum(seconds.values())
        line["all"] = total
        line["ratio"] = total / seconds["landmarks"]
        line["each"] = total / float(str(line["photos"]))
    return list(lines.values())


def photos(rows: list[Row]) -> str:
    """More and more photos."""
    return markdown(jobs(rows, "photos"), [("photos", "photos")], JOB)


def pixels(rows: list[Row]) -> str:
    """Larger and larger photos."""
    labels = [("photos", "photos"), ("size", "megapixels")]
    return markdown(jobs(rows, "pixels"), labels, JOB)


def nets(rows: list[Row]) -> str:
    """Larger and larger nets."""
    lines = [
        {"net": f"{row['net']} x {row['net']}", "cpu": row["cpu"]}
        for row in rows
        if row["part"] == "nets"
    ]
    return markdown(lines, [("net", "net")], [("cpu", "motion and refine, s", ".1f")])


def profile(rows: list[Row]) -> str:
    """The costliest functions."""
    own = [row for row in rows if row["part"] == "profile"]
    total = sum(float(row["cpu"]) for row in own)
    lines = [{**row, "share": float(row["cpu"]) / total} for row in own]
    columns = (
        ("calls", "calls", ".0f"),
        ("cpu", "s", ".2f"),
        ("share", "share", ".0%"),
    )
    return markdown(lines, [("stage", "function")], columns)


def formula(rows: list[Row]) -> str:
    """Sparse solve and dense formula."""
    own = {row["stage"]: row for row in rows if row["part"] == "formula"}
    ours, dense = own["sparse solve"], own["dense formula"]
    lines = [
        {
            "what": f"{ours['net']} x {ours['net']}, {ours['points']} normals",
            "ours": ours["cpu"],
            "dense": dense["cpu"],
            "ratio": float(dense["cpu"]) / float(ours["cpu"]),
            "mm": own["difference"]["mm"],
        }
    ]
    columns = (
        ("ours", "sparse, s", ".2f"),
        ("dense", "as printed, s", ".1f"),
        ("ratio", "ratio", ".0f"),
        ("mm", "largest difference, mm", ".0e"),
    )
    return markdown(lines, [("what", "net")], columns)


def start(rows: list[Row]) -> str:
    """Time to import the library, less that of an empty program."""
    cpu = {row["stage"]: float(row["cpu"]) for row in rows if row["part"] == "import"}
    lines = [
        {"what": f"import {name}", "cpu": cpu[name] - cpu["empty"]}
        for name in ("bsface", "numpy")
    ]
    return markdown(lines, [("what", "")], [("cpu", "s", ".2f")])


TABLES = {
    "photos": photos,
    "pixels": pixels,
    "nets": nets,
    "profile": profile,
    "formula": formula,
    "import": start,
}


if __name__ == "__main__":
    main()
