#!/usr/bin/env python3
"""Cut the pictures of docs/artist_guide.md out of pictures of the whole screen.

    python docs/screenshots/crop.py FOLDER

FOLDER holds the ``name.png`` files that were taken while `drive.py` ran, and
``blender.log``, its output. Writes docs/images/; needs Pillow.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image

IMAGES = Path(__file__).resolve().parents[1] / "images"
COLOURS = 192
LARGEST = 1200


def without_rest(picture):
    """The picture without the empty part under its last line of content."""
    pixels = np.asarray(picture)[:, : picture.width - 40].astype(int)
    busy = np.flatnonzero(np.ptp(pixels, axis=1).max(1) > 12)
    end = min(busy.max() + 14, picture.height) if len(busy) else picture.height
    return picture.crop((0, 0, picture.width, end))


def main():
    folder = Path(sys.argv[1])
    IMAGES.mkdir(exist_ok=True)
    for line in (folder / "blender.log").read_text("utf-8").splitlines():
        if not line.startswith("SHOOT "):
            continue
        _, name, *numbers = line.split()
        left, top, width, height = map(int, numbers)
        picture = Image.open(folder / f"{name}.png").convert("RGB")
        picture = picture.crop((left, top, left + width, top + height))
        if width < 500:
            picture = without_rest(picture)
        picture.thumbnail((LARGEST, LARGEST), Image.Resampling.LANCZOS)
        few = picture.quantize(COLOURS, dither=Image.Dither.NONE)
        path = IMAGES / f"{name}.png"
        few.save(path, optimize=True)
        print(
            f"{path.name} {picture.width} x {picture.height}, "
            f"{path.stat().st_size / 1000:.0f} KB"
        )


if __name__ == "__main__":
    main()
