"""Say how much a face changes when its photos change in ways that mean nothing.

    python tools/invariance.py PHOTOS [PHOTOS ...] --photos 12

For each folder: the photos in another order and under other names, one of them twice,
turned with an EXIF tag that turns them back and stored again as JPEG, darker, with
another gamma, and mirrored (against the mirrored face). Prints the table of
docs/robustness.md: the mean distance between the two faces, in % of the eye distance,
and between their normals.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from bsface import BSplineSurface, Settings, compare, list_photos, reconstruct
from bsface.images.read import read_photo

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from pictures_for_tests import encoded, exif_turned  # noqa: E402

Pixels = np.ndarray


def stored(folder: Path, pictures: list[tuple[str, bytes]]) -> Path:
    """Files of a folder of their own."""
    folder.mkdir(parents=True)
    for name, content in pictures:
        (folder / name).write_bytes(content)
    return folder


def changes(pixels: list[Pixels]) -> dict[str, list[tuple[str, bytes]]]:
    """Folders of the same photos, changed, by what was done to them."""
    names = [f"{k:03d}.png" for k in range(len(pixels))]
    same = [encoded(".png", p) for p in pixels]
    order = np.random.default_rng(0).permutation(len(pixels))
    curve = (np.arange(256) / 255) ** (1 / 1.2)
    gamma = np.round(255 * curve).astype(np.uint8)

    def each(change: Callable[[Pixels], Pixels]) -> list[tuple[str, bytes]]:
        made = [encoded(".png", change(p)) for p in pixels]
        return list(zip(names, made, strict=True))

    turned = [
        exif_turned(encoded(".jpg", np.rot90(p), cv2.IMWRITE_JPEG_QUALITY, 98), 6)
        for p in pixels
    ]
    return {
        "as they are": list(zip(names, same, strict=True)),
        "other order and names": [
            (f"p{i:03d}.png", same[k]) for i, k in enumerate(order)
        ],
        "one photo twice": [*zip(names, same, strict=True), ("again.png", same[0])],
        "JPEG, quality 98, turned by EXIF": [
            (f"{k:03d}.jpg", data) for k, data in enumerate(turned)
        ],
        "0.7 times as bright": each(lambda p: np.round(0.7 * p).astype(np.uint8)),
        "gamma 1.2": each(lambda p: gamma[p]),
        "mirrored": each(lambda p: np.ascontiguousarray(p[:, ::-1])),
    }


def mirrored(surface: BSplineSurface) -> BSplineSurface:
    """The face as in a mirror, with the parameters of its other side."""
    return BSplineSurface(surface.control_points[::-1] * (-1.0, 1.0, 1.0))


def measure(folder: Path, count: int, settings: Settings) -> list[str]:
    """Lines of the table for one folder."""
    paths = list_photos(folder)
    chosen = [paths[k] for k in np.linspace(0, len(paths) - 1, count).astype(int)]
    pixels = [photo.bytes8() for photo in map(read_photo, chosen) if photo]
    lines, first = [], None
    with tempfile.TemporaryDirectory() as name:
        for what, pictures in changes(pixels).items():
            place = stored(Path(name) / what, pictures)
            face = reconstruct(place, settings)
            if first is None:
                first = face
                continue
            surface = face.surface
            if what == "mirrored":
                surface = mirrored(surface)
            found = compare(first.surface, surface)
            lines.append(
                f"| {folder.parent.parent.name}/{folder.parent.name} | {what} "
                f"| {face.used} of {len(face.reports)} | {found.mean_pct:.3f} "
                f"| {found.angle_mean:.2f} |"
            )
            print(lines[-1], flush=True)
    return lines


def main() -> int:
    """Run the command line; returns the exit code."""
    p = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    p.add_argument("folders", nargs="+", type=Path, metavar="PHOTOS")
    p.add_argument("--photos", type=int, default=12, help="of each (default 12)")
    p.add_argument("--method", default="joint", help="default joint")
    options = p.parse_args()
    print("| set | change | used | distance, % | normals, degrees |")
    print("| --- | --- | --- | --- | --- |", flush=True)
    for folder in options.folders:
        measure(folder, options.photos, Settings(method=options.method))
    return 0


if __name__ == "__main__":
    sys.exit(main())
