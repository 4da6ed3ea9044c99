#!/usr/bin/env python3
"""Build the reference of the library from its docstrings.

    python docs/api_reference.py [FOLDER]

Writes HTML pages, one a module, into ``out/docs/api`` unless told otherwise; start with
``bsface.html`` there.  The generator is pdoc (``requirements/docs.txt``).
"""

from __future__ import annotations

import importlib.util
import sys
import warnings
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "out" / "docs" / "api"


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
    render.configure(docformat="numpy", show_source=True)
    pdoc("bsface", output_directory=folder)
    pages = len(list(folder.rglob("*.html")))
    print(f"{pages} pages in {folder}; start with bsface.html")


if __name__ == "__main__":
    main(*sys.argv[1:])
