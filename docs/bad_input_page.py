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
import bad_input_doors as doors  # noqa: E402
import bad_photos  # noqa: E402
from blender.checkout import load, package  # noqa: E402
from bsface import Settings, reconstruct  # noqa: E402
from permissions import as_ordinary_user  # noqa: E402

HEAD = """# Bad input

What bsface does with input that it cannot use. A photo that is of no use is left out,
its row in the report says why, and the rest of the folder is used. A call that cannot
be carried out ends with one sentence and an exit code, and writes nothing; an output
that was there before stays, and so does Blender's scene.

This page is written by `python docs/bad_input_page.py`, which runs every row by the
command line, by Python and by Blender's operators. The tests
`tests/core/test_bad_input.py` and `tests/blender/test_bad_input.py` run them too and
compare every sentence with this page. What happens when a run is killed, or fed with
damaged files: [robustness.md](robustness.md).
"""
CALLS = """## Calls

"The same": word for word what the command line says. An empty cell: there is no such
door. A warning (exit code 0) is told when the face is done; in Blender it stands in the
panel.
"""
PHOTOS = """## Photos in a folder

Status and reason are the same in the report, in the JSON of the command line and in
Blender's photo list.
"""


def photo_table(folder: Path, rows: list[bad_photos.PhotoRow], detector: bool) -> str:
    """One run over a folder; a line for each photo."""
    found = reconstruct(folder, Settings(**bad_input.SETTINGS, detector=detector))
    told = {row.name: row for row in found.reports}
    lines = [
        doors.line(
            folder.parent, row.title, told[row.name].status, told[row.name].reason
        )
        for row in rows
    ]
    return table(("the photo", "status in the report", "reason"), lines)


def job_table(folder: Path) -> str:
    """One run of each door for each row."""
    lines = []
    for number, row in enumerate(bad_input.job_rows()):
        cells = [row.title]
        places = [folder / f"{number}-{door}" for door in "cpb"]
        for place in places:
            place.mkdir()
        os.chdir(places[0])
        words = row.make(places[0])
        with row.hold("bsface"):
            said = doors.run(words, places[0] / "out")
        told = doors.cell(places[0], doors.message(row, said))
        cells += [str(said.exit), told, "", ""]
        if row.library:
            words = row.make(places[1])
            with row.hold("bsface"):
                found = doors.library(row, words)
            cells[doors.PYTHON] = doors.same(doors.cell(places[1], found), told)
        if row.blender:
            found = in_blender(row, places[2])
            cells[doors.BLENDER] = doors.same(doors.cell(places[2], found), told)
        lines.append(f"| {' | '.join(cells)} |")
    head = ("the call", "exit code", "command line", "Python", "Blender")
    return table(head, lines)


def in_blender(row: bad_input.JobRow, place: Path) -> str:
    """What the operator says, in a file with nothing in it."""
    import bpy

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    words = row.make(place)
    if row.blender == "export":
        doors.make_face(words)
    return doors.operator(row, words, package())


def table(head: tuple[str, ...], lines: list[str]) -> str:
    """A Markdown table; equal lines once."""
    rule = "|" + " --- |" * len(head)
    return "\n".join([f"| {' | '.join(head)} |", rule, *dict.fromkeys(lines)]) + "\n"


def main() -> int:
    """Write the page."""
    load("bsface_addon").register()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        parts = [HEAD, PHOTOS]
        for title, make, detector in (
            ("", bad_photos.photo_rows, False),
            ("## Photos that the detector looks at\n", bad_photos.detector_rows, True),
            ("## Folders of two people\n", bad_photos.two_faces_rows, True),
        ):
            place = folder / make.__name__ / "photos"
            with as_ordinary_user():  # one photo may not be read
                rows = make(place)
                parts += [title] * bool(title) + [photo_table(place, rows, detector)]
        parts += [CALLS, job_table(folder)]
        os.chdir(ROOT)
    page = ROOT / "docs" / "bad_input.md"
    page.write_text("\n".join(parts), "utf-8")
    print(f"{page} written")
    sys.stdout.flush()
    os._exit(0)  # bpy has hung at the interpreter's end


if __name__ == "__main__":
    main()
