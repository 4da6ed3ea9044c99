#!/usr/bin/env python3
"""How two faces differ, point by point of the same (u, v).

python examples/07_compare_faces.py [PHOTOS [OUT]]
"""

import bsface
from _arguments import start
from bsface.compare import comparison_picture
from bsface.drawing.pictures import write_png


def main(photos, out, settings=None):
    """Compare faces from two disjoint halves of the photos, and with the average."""
    paths = bsface.list_photos(photos)
    first = bsface.reconstruct(paths[0::2], settings)
    second = bsface.reconstruct(paths[1::2], settings)
    halves = bsface.compare(first.surface, second.surface, first.template)
    print("the two halves:", halves.summary())

    average = bsface.load_template()
    # The average head has another size: bring it to that of the result.
    against = bsface.compare(first.surface, average.surface, average, keep_size=False)
    print("the average face:", against.summary())

    picture = comparison_picture(halves, first.surface, first.template)
    print("wrote", write_png(out / "halves.png", picture))
    return halves, against


if __name__ == "__main__":
    start(main, __doc__)
