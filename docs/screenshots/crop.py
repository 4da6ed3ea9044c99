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
FEW = 30
LARGE = 200_000  # bytes; a larger file gets fewer colours
COLOURS = 256
LARGEST = 1000
# Part of the 3D view that the face fills after the first run.
FACE = (420, 65, 882, 835)


def without_rest(picture):
    """The picture without the empty part under its last line of content."""
    grey = np.asarray(picture.convert("L"))[:, : picture.width - 40].astype(int)
    # A row of the view behind has at most thin lines of the grid.
    odd = np.abs(grey - np.median(grey, axis=1, keepdims=True)) > 6
    busy = np.flatnonzero(odd.sum(1) > FEW)
    end = min(busy.max() + 14, picture.height) if len(busy) else picture.height
    return picture.crop((0, 0, picture.width, end))


def save(picture, name):
    """Write a picture, with few colours where it would be large."""
    picture.thumbnail((LARGEST, LARGEST), Image.Resampling.LANCZOS)
    path = IMAGES / f"{name}.png"
    picture.save(path, optimize=True)
    if path.stat().st_size > LARGE:
        picture.quantize(COLOURS, kmeans=2).save(path, optimize=True)
    kilobytes = path.stat().st_size / 1000
    print(f"{path.name} {picture.width} x {picture.height}, {kilobytes:.0f} KB")


def main():
    folder = Path(sys.argv[1])
    IMAGES.mkdir(exist_ok=True)
    maps = []
    for line in (folder / "blender.log").read_text("utf-8").splitlines():
        if not line.startswith("SHOOT "):
            continue
        _, name, *numbers = line.split()
        left, top, width, height = map(int, numbers)
        picture = Image.open(folder / f"{name}.png").convert("RGB")
        picture = picture.crop((left, top, left + width, top + height))
        if width < 500:
            picture = without_rest(picture)
        if name.startswith("map_"):
            # The face alone; all maps stand side by side in one picture.
            maps.append(picture.crop(FACE).resize((160, 266), Image.Resampling.LANCZOS))
            continue
        save(picture, name)
    if maps:
        strip = Image.new("RGB", (160 * len(maps), 266))
        for number, picture in enumerate(maps):
            strip.paste(picture, (160 * number, 0))
        save(strip, "artist_maps")


if __name__ == "__main__":
    main()
