#!/usr/bin/env python3
"""Put what the benchmarks of texture and detail printed into docs/texture.md.

    python docs/texture_page.py

Reads ``out/texture/texture.csv`` and ``out/detail/detail.csv``, rewrites the tables of
the page, and copies
``out/texture/comparison.png`` to ``docs/images/texture.jpg``.
"""

from __future__ import annotations

import cv2
from accuracy_tables import OUT, ROOT, Row, fill, markdown

PAGE = ROOT / "docs" / "texture.md"
COLUMNS = (
    ("count", "photos", ".0f"),
    ("plain", "plain average", ".1f"),
    ("mean", "mean texture", ".1f"),
    ("plain_relit", "plain average, relit", ".1f"),
    ("albedo", "albedo, relit", ".1f"),
    ("gain", "against plain", "+.0%"),
    ("same", "against plain, relit", "+.0%"),
)

DETAIL = (
    ("photos", "photos", ".0f"),
    ("flat", "normals without, degrees", ".2f"),
    ("bent", "with", ".2f"),
    ("left_flat", "left-out photos without", ".4f"),
    ("left_bent", "with", ".4f"),
    ("left_gain", "change, %", "+.2f"),
)


def main() -> None:
    """Fill the table and copy the picture."""
    fill(
        PAGE,
        {
            "texture": ("texture/texture.csv", errors),
            "detail": ("detail/detail.csv", detail),
        },
    )
    picture = cv2.imread(str(OUT / "texture" / "comparison.png"))
    if picture is not None:
        target = ROOT / "docs" / "images" / "texture.jpg"
        cv2.imwrite(str(target), picture, [cv2.IMWRITE_JPEG_QUALITY, 85])


def errors(rows: list[Row]) -> str:
    """A row a folder of photos."""
    lines = []
    for row in rows:
        albedo = float(row["albedo"])
        gain = albedo / float(row["plain"]) - 1
        same = albedo / float(row["plain_relit"]) - 1
        lines.append({**row, "gain": gain, "same": same})
    return markdown(lines, [("photos", "folder")], COLUMNS)


def detail(rows: list[Row]) -> str:
    """A row a set and number of photos."""
    return markdown(rows, [("set", "set")], DETAIL)


if __name__ == "__main__":
    main()
