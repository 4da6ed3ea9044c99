"""How well the texture explains the photos, beside plain averaging.

    python benchmarks/texture.py [PHOTOS ...] [-o out/texture] [--size 1024]

Reconstructs each folder (by default the example photos), bakes the texture, draws the
textured surface into every used photo as it is seen there (its camera, light and
expression) and prints the median absolute error in 8-bit steps. The plain average is
drawn as it is, and also relit by the same lights. Writes ``texture.csv`` and, of the
first folder, ``comparison.png``: plain average (above), mean texture and albedo (below)
on the surface, and ``textures.png``: the same over (u, v).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from _table import write_csv
from _texture_check import plain_average, rerender_errors
from bsface import Reconstruction, reconstruct
from bsface.drawing.pictures import write_png
from bsface.drawing.render import render_views
from bsface.images.colour import to_picture
from bsface.texture.bake import Texture, bake_texture

EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "photos"
ROWS = {
    "plain": "plain average as it is",
    "mean": "mean texture, at each photo's exposure",
    "plain_relit": "plain average, relit by each photo's light",
    "albedo": "albedo, relit by each photo's light",
}


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("photos", nargs="*", type=Path, default=[EXAMPLE])
    options.add_argument("-o", "--output", type=Path, default=Path("out/texture"))
    options.add_argument("--size", type=int, default=1024)
    given = options.parse_args()
    rows = []
    for folder in given.photos:
        face = reconstruct(folder)
        texture = bake_texture(face, given.size)
        parts = [p for p in folder.resolve().parts if p != "images"]
        name = "/".join(parts[-2:])
        rows.append({"photos": name, **compare(face, texture)})
        write_csv(given.output / "texture.csv", rows)
        if len(rows) == 1:
            draw(given.output, face, texture)
            print(f"{given.output}/comparison.png and textures.png written")


def compare(face: Reconstruction, texture: Texture) -> dict[str, object]:
    """Median over the photos of their errors, printed and returned."""
    errors = rerender_errors(face, texture)
    found = {name: float(np.median(errors[name])) for name in ROWS}
    print(f"{len(face.photos)} photos, median of the photos' median absolute errors")
    for name, words in ROWS.items():
        change = 100 * (found[name] / found["plain"] - 1)
        print(f"{words:<44} {found[name]:6.2f}  {change:+6.1f} %")
    gain = 100 * (found["albedo"] / found["plain_relit"] - 1)
    print(
        f"albedo against the plain average in the same light {gain:+.1f} %", flush=True
    )
    return {"count": len(face.photos), **found}


def draw(out: Path, face: Reconstruction, texture: Texture) -> None:
    """Pictures of the plain average and of both textures."""
    skins = (plain_average(face, texture.size), texture.mean, texture.albedo)
    flat = [to_picture(skin) for skin in skins]
    on_face = [
        render_views(face.surface, face.template, colours=skin, shading=0.0)
        for skin in flat
    ]
    write_png(out / "comparison.png", np.concatenate(on_face))
    write_png(out / "textures.png", np.concatenate(flat, axis=1))


if __name__ == "__main__":
    main()
