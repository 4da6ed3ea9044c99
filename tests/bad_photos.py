"""Folders with every kind of bad photo: the first part of the table of bad input."""

from __future__ import annotations

import json
import os
import shutil
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from bsface import Settings
from bsface.landmarks.all_faces import faces_in
from fake_face import other_skin, person_folder
from pictures_for_tests import (
    SRGB_FORMULA,
    animated,
    bomb,
    by_pillow,
    cmyk,
    encoded,
    exif_turned,
    heic,
    icc_profile,
    palette,
    png_with_profile,
)

EXAMPLES = Path(__file__).resolve().parents[1] / "examples" / "photos"


@dataclass(frozen=True)
class PhotoRow:
    """One photo of a folder in which others are good.

    ``code`` is the status that it gets: "used" or a failure code.
    """

    title: str
    name: str
    code: str


class Folder:
    """Lays out photos of a drawn person with landmark files beside them."""

    def __init__(self, folder: Path, count: int, **drawing: Any) -> None:
        store = folder.with_name("drawn")
        person_folder(store, count=count, side=160, **drawing)
        self.folder = folder
        folder.mkdir(parents=True)
        self.stock = []
        for index in range(count):
            pixels = cv2.imread(str(store / f"{index}.png"))[..., ::-1]
            record = json.loads((store / f"{index}.json").read_text())
            self.stock.append((pixels, np.array(record["points"])))
        shutil.rmtree(store)

    def next(self) -> tuple[np.ndarray, np.ndarray]:
        """A photo that was not used yet, and its 468 landmarks."""
        return self.stock.pop()

    def save(
        self,
        name: str,
        pixels: np.ndarray | bytes,
        points: Any = None,
        *options: int,
        **record: Any,
    ) -> None:
        path = self.folder / name
        data = (
            pixels
            if isinstance(pixels, bytes)
            else encoded(path.suffix, pixels, *options)
        )
        path.write_bytes(data)
        if points is not None:
            content = {"scheme": "468", "points": np.asarray(points).tolist(), **record}
            path.with_suffix(".json").write_text(json.dumps(content))


def photo_rows(folder: Path) -> list[PhotoRow]:
    """A folder with every kind of bad photo, and some good ones."""
    lay = Folder(folder, 42)
    rows: list[PhotoRow] = []

    def add(title: str, name: str, code: str, *content: Any, **record: Any) -> None:
        lay.save(name, *content, **record)
        rows.append(PhotoRow(title, name, code))

    side = 160
    for index in range(3):
        add("a good photo", f"good {index}.png", "used", *lay.next())

    # pictures that are read, however they are stored
    pixels, points = lay.next()
    add("16 bits", "deep.png", "used", pixels.astype(np.uint16) * 257, points)
    pixels, points = lay.next()
    grey = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
    add("grey", "grey.png", "used", grey, points)
    pixels, points = lay.next()
    alpha = np.dstack([pixels, np.full(pixels.shape[:2], 99, np.uint8)])
    add("with alpha", "alpha.png", "used", alpha, points)
    pixels, points = lay.next()
    # stored lying, seen upright: the landmarks speak of the picture as it is seen
    jpeg = encoded(".jpg", np.rot90(pixels), cv2.IMWRITE_JPEG_QUALITY, 95)
    add("turned by EXIF", "turned.jpg", "used", exif_turned(jpeg, 6), points)
    pixels, points = lay.next()
    long = "Фото 写真 é 😀 " + "x" * 90 + ".png"
    add("long name in several scripts", long, "used", pixels, points)
    pixels, points = lay.next()
    jpeg = encoded(".jpg", pixels, cv2.IMWRITE_JPEG_QUALITY, 95)
    add("JPEG named .png", "wrong ending.png", "used", jpeg, points)

    pixels, points = lay.next()
    add("CMYK", "cmyk.jpg", "used", cmyk(pixels), points)
    pixels, points = lay.next()
    add("palette", "palette.png", "used", palette(pixels), points)
    pixels, points = lay.next()
    frames = animated([pixels, np.zeros_like(pixels)])
    add("animated", "moving.png", "used", frames, points)

    pixels, points = lay.next()
    profile = png_with_profile(
        encoded(".png", pixels), icc_profile("Display P3", SRGB_FORMULA)
    )
    add("Display P3", "p3.png", "used", profile, points)
    pixels, points = lay.next()
    add("HEIC, turned", "phone.heic", "used", heic(np.rot90(pixels), turn=6), points)
    pixels, points = lay.next()
    add("AVIF", "web.avif", "used", by_pillow("AVIF", pixels), points)
    pixels, points = lay.next()
    add("JPEG 2000", "scan.jp2", "used", by_pillow("JPEG2000", pixels), points)

    # files that are no pictures
    jpeg, png = (encoded(k, lay.next()[0]) for k in (".jpg", ".png"))
    add("text renamed .jpg", "text.jpg", "unreadable", b"Dear photo,\nyours")
    add("zero bytes", "empty.jpg", "unreadable", b"")
    add("JPEG cut short", "short.jpg", "unreadable", jpeg[: len(jpeg) // 2])
    add("PNG cut short", "short.png", "unreadable", png[: len(png) // 2])
    dot = np.zeros((1, 1, 3), np.uint8)
    add("1 x 1 pixel", "dot.png", "unreadable", dot)
    add("30,000 x 30,000 pixels", "huge.png", "too_large", bomb(30000, 30000))
    add("GIF", "moving.gif", "unreadable", b"GIF89a" + struct.pack("<HH", 99, 99))
    head = b"\0\0\0\x18ftypheic" + b"\0" * 50
    add("HEIC cut short", "short.heic", "unreadable", head)
    add("raw", "raw.cr2", "unreadable", b"II*\0\x10\0\0\0CR" + b"\0" * 99)
    (folder / "loop.jpg").symlink_to(folder / "loop.jpg")
    rows.append(PhotoRow("symbolic link to itself", "loop.jpg", "unreadable"))
    add("no permission to read", "locked.jpg", "unreadable", jpeg)
    (folder / "locked.jpg").chmod(0)
    (folder / "gone.jpg").symlink_to(folder / "moved away.jpg")
    rows.append(PhotoRow("symbolic link to nothing", "gone.jpg", "unreadable"))
    if hasattr(os, "mkfifo"):
        os.mkfifo(folder / "pipe.jpg")
        rows.append(PhotoRow("named pipe", "pipe.jpg", "unreadable"))

    # pictures of no use
    pixels, points = lay.next()
    add("a photo", "once.png", "used", pixels, points)
    add("the same photo again", "twice.png", "duplicate", pixels, points)
    pixels, points = lay.next()
    dark = (pixels * 0.02).astype(np.uint8)
    add("nearly black", "night.png", "dark", dark, points)
    pixels, points = lay.next()
    white = np.full_like(pixels, 255)
    add("nearly white", "snow.png", "bright", white, points)
    pixels, points = lay.next()
    soft = cv2.GaussianBlur(pixels, (0, 0), 8)
    add("out of focus", "soft.png", "blurred", soft, points)
    pixels, points = lay.next()
    small = np.full_like(pixels, 90)
    small[60:100, 60:100] = cv2.resize(pixels, (40, 40), interpolation=cv2.INTER_AREA)
    add("small face", "far.png", "small_face", small, points / 4 + 60)
    add("no landmark file, detector off", "bare.png", "no_face", lay.next()[0])

    longest = "n" * 251 + ".png"
    add("255 bytes, no name for what lies beside", longest, "no_face", lay.next()[0])
    pixels, points = lay.next()
    add("all of the face masked", "black.png", "unreadable", pixels, points)
    lay.save("black.mask.png", np.zeros_like(pixels))

    # landmark files
    def marks(
        title: str,
        change: Callable[[np.ndarray], Any],
        code: str = "implausible",
        **record: Any,
    ) -> None:
        pixels, points = lay.next()
        add(title, f"marks {len(rows)}.png", code, pixels, change(points), **record)

    marks("landmarks: wrong count", lambda p: p[:-1])
    marks("landmarks: NaN", lambda p: np.where(np.arange(468)[:, None] == 5, np.nan, p))
    marks("landmarks: huge numbers", lambda p: p * 1e9)
    marks("landmarks: x and y swapped", lambda p: p[:, ::-1])
    marks("landmarks: upside down", lambda p: side - 1 - p)
    marks("landmarks: mirrored", lambda p: p * (-1, 1) + (side - 1, 0))
    marks("landmarks: all at one place", lambda p: p * 0 + 80)
    marks("landmarks: beside the picture", lambda p: p + 5000)
    marks("landmarks: of another picture size", lambda p: p, image_size=[10, 10])
    marks("landmarks: unknown scheme", lambda p: p, scheme="500")
    marks("landmarks: text for numbers", lambda p: [["a", "b"]] * 468)
    marks("landmarks: weights below zero", lambda p: p, weights=[-1] * 468)
    pixels, points = lay.next()
    add("landmarks: .pts of another program", "pts.png", "implausible", pixels)
    (folder / "pts.pts").write_text("version: 1\nn_points: 68\n{\n1 2\n}\n")
    pixels, points = lay.next()
    add("landmarks: broken JSON", "json.png", "implausible", pixels)
    (folder / "json.json").write_text('{"scheme": "468", "points": [[')
    # a picture that is fine; so small and so made up, it raises no more than a doubt
    stranger = Folder(folder.with_name("stranger"), 1, seed=5, skin=other_skin)
    add("somebody else, hardly different", "else.png", "used", *stranger.next())
    return rows


# --- photos that the detector looks at -----------------------------------------------


def detector_rows(folder: Path) -> list[PhotoRow]:
    """Photos without landmark files; needs the model files."""
    folder.mkdir(parents=True)
    pictures = [picture(k) for k in (0, 5, 11, 20, 2)]
    rows = []

    def add(title: str, name: str, code: str, pixels: np.ndarray) -> None:
        cv2.imwrite(str(folder / name), pixels)
        rows.append(PhotoRow(title, name, code))

    for k in range(3):
        add("a good photo", f"good {k}.png", "used", pictures[k])
    wall = np.full((300, 300, 3), 140, np.uint8)
    add("no face", "wall.png", "no_face", wall)
    add("all black", "black.png", "no_face", wall * 0)
    add("all white", "white.png", "no_face", wall * 0 + 255)
    add("two faces", "two.png", "used", np.hstack([pictures[3], pictures[4]]))
    add("upside down", "fallen.png", "used", pictures[4][::-1, ::-1])
    glasses = covered(picture(8), glasses=True)
    add("sunglasses in one photo", "sun.png", "used", glasses)
    add("a mask over nose and mouth", "mask.png", "used", covered(picture(14), True))
    veiled = covered(pictures[2], mask=True, glasses=True)
    add("mask and sunglasses", "veil.png", "no_face", veiled)
    return rows


def two_faces_rows(folder: Path) -> list[PhotoRow]:
    """Two faces in every photo."""
    folder.mkdir(parents=True)
    rows = []
    for name, pair in (("a.png", (0, 5)), ("b.png", (11, 20)), ("c.png", (2, 8))):
        cv2.imwrite(str(folder / name), np.hstack([picture(k) for k in pair]))
        rows.append(PhotoRow(f"two faces in all photos: {name}", name, "used"))
    return rows


def picture(number: int) -> np.ndarray:
    """An example photo, BGR."""
    return cv2.imread(str(EXAMPLES / f"{number:03d}.jpg"))


def covered(
    pixels: np.ndarray, mask: bool = False, glasses: bool = False
) -> np.ndarray:
    """The photo with a mask or sunglasses painted where its landmarks are."""
    pixels = pixels.copy()
    rgb = np.ascontiguousarray(pixels[..., ::-1])
    (found,) = faces_in(rgb, "photo", Settings(landmarks="68"))
    marks = found.points
    patches = []
    if mask:  # the jaw up to the bridge of the nose
        patches.append((np.vstack([marks[2:15], marks[28:29]]), (200, 160, 120)))
    for eye in (marks[36:42], marks[42:48]) if glasses else ():
        glass = eye.mean(0) + (eye - eye.mean(0)) * (2, 4)
        patches.append((glass, (15, 15, 15)))
    for points, colour in patches:
        hull = cv2.convexHull(np.round(points).astype(np.int32))
        cv2.fillConvexPoly(pixels, hull, colour, cv2.LINE_AA)
    return pixels
