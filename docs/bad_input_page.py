"""Write docs/bad_input.md: what bsface says to each row of the table of bad input.

    python docs/bad_input_page.py

The rows are those of the tests (tests/bad_input.py); the tests fail when the page
shows other sentences than the program says.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

import bad_input  # noqa: E402
from bsface import Settings, reconstruct  # noqa: E402

HEAD = """# Bad input

What bsface does with input that it cannot use. A photo that is of no use is left out,
its row in the report says why, and the rest of the folder is used. A call that cannot
be carried out ends with one sentence and an exit code, and writes nothing; an output
that was there before stays.

This page is written by `python docs/bad_input_page.py`, which runs every row; the test
`tests/core/test_bad_input.py` runs them through the library and the command line and
compares the sentences with this page.
"""


def photo_table(folder: Path, rows: list[bad_input.PhotoRow], detector: bool) -> str:
    """One run over a folder; a line for each photo."""
    found = reconstruct(folder, Settings(**bad_input.SETTINGS, detector=detector))
    told = {row.name: row for row in found.reports}
    lines = [
        bad_input.table_line(
            folder.parent, row.title, told[row.name].status, told[row.name].reason
        )
        for row in rows
    ]
    return table(("the photo", "status in the report", "reason"), lines)


def job_table(folder: Path) -> str:
    """One run of the command line for each row."""
    lines = []
    for number, row in enumerate(bad_input.job_rows()):
        place = folder / str(number)
        place.mkdir()
        os.chdir(place)
        words = row.make(place)
        with row.hold():
            said = bad_input.run(words, place / "out")
        lines.append(
            bad_input.table_line(
                place, row.title, said.exit, bad_input.message(row, said)
            )
        )
    return table(("the call", "exit code", "what it says"), lines)


def table(head: tuple[str, ...], lines: list[str]) -> str:
    """A Markdown table; equal lines once."""
    rule = "|" + " --- |" * len(head)
    return "\n".join([f"| {' | '.join(head)} |", rule, *dict.fromkeys(lines)]) + "\n"


def main() -> int:
    """Write the page."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        parts = [HEAD, "## Photos in a folder\n"]
        for title, make, detector in (
            ("", bad_input.photo_rows, False),
            ("## Photos that the detector looks at\n", bad_input.detector_rows, True),
        ):
            place = folder / f"detector {detector}" / "photos"
            rows = make(place)
            parts += [title] * bool(title) + [photo_table(place, rows, detector)]
        parts += ["## Calls\n", job_table(folder)]
        os.chdir(ROOT)
    page = ROOT / "docs" / "bad_input.md"
    page.write_text("\n".join(parts), "utf-8")
    print(f"{page} written")
    return 0


if __name__ == "__main__":
    sys.exit(main())
