"""What the examples read from the command line: a folder of photos, one for results."""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

import bsface

PHOTOS = Path(__file__).resolve().parent / "photos"
OUT = Path(__file__).resolve().parents[1] / "out" / "examples"


def start(main: Callable[[Path, Path], object], description: str) -> None:
    """Run the example; what cannot be done ends in a sentence."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "photos",
        nargs="?",
        type=Path,
        default=PHOTOS,
        help="folder with photos of one person (default: examples/photos)",
    )
    parser.add_argument(
        "out",
        nargs="?",
        type=Path,
        default=OUT,
        help="folder for the results (default: out/examples)",
    )
    arguments = parser.parse_args()
    try:
        main(arguments.photos, arguments.out)
    except bsface.ReconstructionError as error:
        sys.exit(str(error))
