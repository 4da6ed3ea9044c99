"""The doors by which bad input comes in, each told as the one sentence it says.

The command line, the library, and Blender's operators (in a Python with the module
bpy) run the same row of `bad_input.job_rows`.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bad_input import JobRow
from bsface import ReconstructionError, Settings, __main__, load_template, reconstruct
from bsface.formats import export


@dataclass(frozen=True)
class Said:
    """What the command line did."""

    exit: int
    printed: str
    errors: str
    left: frozenset[str]  #: files in the folder of the output afterwards


def run(words: list[str], folder: Path) -> Said:
    """Run the command line in this process."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = __main__.main(words)
    left = frozenset(os.listdir(folder)) if folder.is_dir() else frozenset()
    return Said(code, out.getvalue(), err.getvalue(), left)


def message(row: JobRow, said: Said) -> str:
    """The sentence of a call: the last line, or the note that the row is about."""
    lines = said.errors.strip().splitlines()
    found = next((x for x in lines if row.exit == 0 and row.words in x), lines[-1])
    return found.removeprefix("bsface: ").removeprefix("note: ")


def sets(words: list[str]) -> dict[str, Any]:
    """The values of the words ``--set=NAME=VALUE``, read as the command line does."""
    values = {}
    for pair in _after(words, "--set"):
        name, _, text = pair.partition("=")
        with contextlib.suppress(ValueError):
            text = json.loads(f"[{text}]" if "," in text else text)
        values[name] = text
    return values


def _after(words: list[str], option: str) -> list[str]:
    return [w.removeprefix(f"{option}=") for w in words if w.startswith(f"{option}=")]


def library(row: JobRow, words: list[str]) -> str:
    """What Python says: the exception, or the warning that the row is about."""
    paths = _after(words, "--template")
    try:
        settings = Settings.from_dict(sets(words))
        template = load_template(paths[0]) if paths else None
        ignore = _after(words, "--ignore")
        face = reconstruct(words[0], settings, template=template, ignore=ignore)
        export(words[2], face)
    except (ReconstructionError, ValueError) as error:
        return str(error)
    return next(w for w in face.warnings if row.words in w)


def make_face(words: list[str]) -> None:
    """A face in Blender's scene from the photos of the words."""
    import bpy

    bpy.context.scene.bsface.texture_size = "512"
    bpy.ops.bsface.reconstruct(
        directory=words[0],
        settings=json.dumps(sets(words)),
        ignore="|".join(_after(words, "--ignore")),
    )


def operator(row: JobRow, words: list[str]) -> str:
    """What Blender says: the error of the operator, or the hint in the panel.

    A row about the output is met by ``bsface.export`` and wants a face (`make_face`),
    all others by ``bsface.reconstruct``.
    """
    import bpy

    try:
        with row.hold():
            if row.blender == "export":
                bpy.ops.bsface.export(filepath=words[2])
            else:
                make_face(words)
    except RuntimeError as error:
        return str(error).strip().removeprefix("Error: ")
    hints = bpy.context.scene.bsface.hints.splitlines()
    return next(line for line in hints if row.words in line)
