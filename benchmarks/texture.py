"""How well the texture explains the photos, beside plain averaging.

    python benchmarks/texture.py [PHOTOS] [-o out/texture] [--size 1024]

Reconstructs the folder (by default the example photos), bakes the texture, draws the
textured surface into every used photo and prints the median absolute error in 8-bit
steps. Writes ``comparison.png``: plain average (above) and mean texture (below) on the
surface, and ``textures.png``: plain average, mean texture, albedo over (u, v).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from bsface import reconstruct
from bsface.output.colour import to_picture
from bsface.output.pictures import write_png
from bsface.output.render import render_views
from bsface.output.texture import bake_texture
from bsface.output.texture_check import plain_average, rerender_errors

EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "photos"
ROWS = {
    "plain": "plain average as it is",
    "mean": "mean texture, at each photo's exposure",
    "plain_relit": "plain average, relit by each photo's light",
    "albedo": "albedo, relit by each photo's light",
}


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("photos", nargs="?", default=str(EXAMPLE))
    options.add_argument("-o", "--output", default="out/texture")
    options.add_argument("--size", type=int, default=1024)
    given = options.parse_args()
    face = reconstruct(given.photos)
    texture = bake_texture(face, given.size)
    errors = rerender_errors(face, texture)
    first = np.median(errors["plain"])
    print(f"{len(face.photos)} photos, median of the photos' median absolute errors")
    for name, words in ROWS.items():
        value = np.median(errors[name])
        print(f"{words:<44} {value:6.2f}  {100 * (value / first - 1):+6.1f} %")
    gain = np.median(errors["albedo"]) / np.median(errors["plain_relit"]) - 1
    print(f"albedo against the plain average in the same light {100 * gain:+.1f} %")

    plain = plain_average(face, given.size)
    out = Path(given.output)
    on_face = [
        render_views(face.surface, face.template, colours=to_picture(skin), shading=0.0)
        for skin in (plain, texture.mean)
    ]
    write_png(out / "comparison.png", np.concatenate(on_face))
    flat = [to_picture(skin) for skin in (plain, texture.mean, texture.albedo)]
    write_png(out / "textures.png", np.concatenate(flat, axis=1))
    print(f"{out}/comparison.png and textures.png written")


if __name__ == "__main__":
    main()
