#!/usr/bin/env python3
"""What the pages do not tell yet: modules and messages without a line.

    python docs/gaps.py

Lists modules that `architecture.md` leaves out, and sentences for the user that
`troubleshooting.md` leaves out or still has although the code says them no more.  Ends
with exit code 1 if there are any.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
SOURCES = ("core", "bsface_addon")
# Functions whose arguments are, or become, sentences for the user.
SPEAKERS = {
    "ReconstructionError",
    "PhotoFailure",
    "LandmarkFileError",
    "_bad",
    "bad",
    "implausible",
    "append",
}
# In messages.py: what is said when all is well.
CHEERFUL = {
    "FOUND",
    "FACES",
    "MOVED",
    "MESH",
    "KEY",
    "WROTE",
    "COPIED",
    "CAPTURE",
    "EDITING",
    "EXPRESSIONS",
    "MAKE_KEY",
    "STAGES",
}
#: What stands for a value in a sentence that was taken from the code.
HOLE = "\0"


def modules() -> list[str]:
    """Python files that the architecture page has to name."""
    folders = (*SOURCES, "tools")
    paths = (path for folder in folders for path in (ROOT / folder).rglob("*.py"))
    names = (path.relative_to(ROOT).as_posix() for path in sorted(paths))
    return [name for name in names if not name.endswith("/__init__.py")]


def unnamed_modules() -> list[str]:
    """Those that it does not name."""
    page = (DOCS / "architecture.md").read_text("utf-8")
    return [name for name in modules() if f"`{name}`" not in page]


def literals(node: ast.AST) -> Iterator[str]:
    """String literals below a node, with `HOLE` for each value in them."""
    if isinstance(node, ast.JoinedStr):
        parts = (p.value if isinstance(p, ast.Constant) else HOLE for p in node.values)
        yield "".join(map(str, parts))
        return
    if isinstance(node, ast.Constant):
        if isinstance(node.value, str):
            yield re.sub(r"\{[^{}]*\}", HOLE, node.value)
        return
    for child in ast.iter_child_nodes(node):
        yield from literals(child)


def sentences() -> list[str]:
    """What the library and the add-on say when something is wrong."""
    found: list[str] = []
    for path in _sources():
        tree = ast.parse(path.read_text("utf-8"))
        if path.name == "messages.py":
            for node in tree.body:
                if isinstance(node, ast.Assign) and not CHEERFUL & {
                    getattr(target, "id", "") for target in node.targets
                }:
                    found += literals(node.value)
        for node in ast.walk(tree):
            if not isinstance(node, ast.Call):
                continue
            name = getattr(node.func, "id", getattr(node.func, "attr", ""))
            if name == "append" and path.name != "coverage.py":
                continue
            if name in SPEAKERS:
                found += (s for a in node.args for s in literals(a))
    # Single words are codes, icons and names.
    return [s for s in dict.fromkeys(map(_plain, found)) if s.count(" ") > 2]


def unexplained() -> list[str]:
    """Sentences without an entry on the troubleshooting page."""
    page = _plain(_page().replace("*", ""))
    return [s for s in sentences() if max(_pieces(s), key=len) not in page]


def outdated() -> list[str]:
    """Entries of that page which the code does not say."""
    said = [
        _plain(s)
        for path in _sources()
        for s in literals(ast.parse(path.read_text("utf-8")))
    ]
    spoken = {piece for s in said for piece in _pieces(s)}
    return [
        entry
        for entry in entries()
        for piece in _pieces(re.sub(r"\*[^*]*\*", HOLE, entry))
        if len(piece) > 12 and not any(piece in s for s in spoken)
    ]


def entries() -> list[str]:
    """Messages quoted on the page; values in them are set in italics."""
    return [_plain(line[2:]) for line in _page().splitlines() if line[:2] == "> "]


def _page() -> str:
    return (DOCS / "troubleshooting.md").read_text("utf-8")


def _sources() -> list[Path]:
    return sorted(p for folder in SOURCES for p in (ROOT / folder).rglob("*.py"))


def _pieces(sentence: str) -> list[str]:
    return [piece.strip(" ;:.,()'\"") for piece in sentence.split(HOLE)]


def _plain(text: str) -> str:
    return " ".join(text.replace("`", "").split())


def main() -> int:
    """Print the gaps; returns the exit code."""
    gaps = {
        "modules without a line in docs/architecture.md": unnamed_modules(),
        "messages without an entry in docs/troubleshooting.md": unexplained(),
        "entries of docs/troubleshooting.md that the code does not say": outdated(),
    }
    for title, found in gaps.items():
        print(f"{len(found)} {title}")
        for item in found:
            print("   ", item.replace(HOLE, "..."))
    return int(any(gaps.values()))


if __name__ == "__main__":
    sys.exit(main())
