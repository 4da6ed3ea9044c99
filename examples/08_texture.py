#!/usr/bin/env python3
"""The skin's own colour on the surface's (u, v), the light of the photos taken out.

python examples/08_texture.py [PHOTOS [OUT]]
"""

import bsface
from _arguments import start
from bsface.drawing.pictures import write_png
from bsface.drawing.render import render_views
from bsface.images.colour import to_picture


def main(photos, out, settings=None, size=None):
    """Bake albedo and mean texture; ``size`` None takes what the photos are worth."""
    result = bsface.reconstruct(photos, settings)
    texture = bsface.bake_texture(result, size)
    print(f"{texture.size} texels a side, {texture.measured.mean():.0%} seen by photos")

    # 16 bits a channel; what no photo saw is filled smoothly and marked in the mask.
    bsface.write_texture(
        out / "albedo.png", texture.albedo, depth=16, mask=texture.measured
    )
    bsface.write_texture(out / "mean.png", texture.mean)

    # What is finer than the control net: directions, and millimetres along the normal.
    bsface.write_normals(out / "normal.png", texture.detail)
    bsface.write_displacement(out / "displacement.png", texture.detail)
    print(f"relief of {texture.detail.displacement.std():.3f} mm (standard deviation)")

    picture = to_picture(texture.mean)
    views = render_views(result.surface, result.template, colours=picture, shading=0.0)
    print("wrote", write_png(out / "textured.png", views))
    return texture


if __name__ == "__main__":
    start(main, __doc__)
