#!/usr/bin/env python3
"""Build the reference of the library from its docstrings.

    python docs/api_reference.py [FOLDER]

Writes HTML pages, one a module, into ``out/docs/api`` unless told otherwise; start with
``bsface.html`` there.  The generator is pdoc (``requirements/docs.txt``).
"""

from __future__ import annotations

import importlib
import importlib.util
import pkgutil
import sys
import warnings
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "out" / "docs" / "api"


def modules() -> list[str]:
    """Dotted names for pdoc, which finds the modules inside a package by itself.

    Except in packages with ``__all__``: the modules of those are named here.
    """
    package = importlib.import_module("bsface")
    names = ["bsface"]
    for found in pkgutil.walk_packages(package.__path__, "bsface."):
        above, _, last = found.name.rpartition(".")
        public = getattr(importlib.import_module(above), "__all__", None)
        if public is not None and last not in ("__main__", *public):
            names.append(found.name)
    return names


def main(folder: str | Path = OUT) -> None:
    """Write the pages."""
    if importlib.util.find_spec("pdoc") is None:
        sys.exit(
            "The reference needs the package pdoc; install it by "
            f"`{sys.executable} -m pip install -r requirements/docs.txt`."
        )
    from pdoc import pdoc, render

    folder = Path(folder)
    # Named tuples keep annotations as text in which pdoc finds no module.
    warnings.filterwarnings("ignore", "Error parsing type annotation")
    # A library asks for the processor's name when it is imported.
    warnings.filterwarnings("ignore", "Suppressed execution")
    render.configure(docformat="numpy", show_source=True)
    pdoc(*modules(), output_directory=folder)
    pages = len(list(folder.rglob("*.html")))
    print(f"{pages} pages in {folder}; start with bsface.html")


if __name__ == "__main__":
    main(*sys.argv[1:])
