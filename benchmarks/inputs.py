#!/usr/bin/env python3
"""Does the same face come out of other files of the same photos?

    python benchmarks/inputs.py                        the example photos
    python benchmarks/inputs.py --set ict-a/S1 --photos 12
    python benchmarks/inputs.py --only photos heic

The photos are written again, as the kinds of files that phones make, and each kind is
reconstructed:

photos   the folder as it is
heic     HEIC of the given quality, by pillow-heif (requirements/test.txt)
p3       PNG of 16 bits in Display P3, with that profile
mirrored every third photo mirrored, as some selfie cameras store them
lossless, mjpeg
         a clip of all photos, one frame each
minute   a clip of 60 s and 1920 x 1080 pixels in which the photos are shown one after
         the other, slowly moved, with noise: MPEG-4 as OpenCV writes it
h264, hevc
         the same minute in H.264 of 15 and in HEVC of 10 megabits a second, a key frame
         every second, as phones film; needs `--ffmpeg`, a program with libx264 and
         libx265 such as that of the package imageio-ffmpeg
         (these three only when they are asked for)

The columns: photos used, mean distance from the first row's surface and mean error
against the ground truth (both in % of the eye distance), and processor seconds of
reading and reconstructing. All on one thread, as `speed.py` measures.
"""

from __future__ import annotations

import argparse
import contextlib
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from _faces import surface_face
from _sets import EVAL, ROOT, FaceSet, load_measure, load_set, score
from _table import text_table
from bsface.compare import compare
from bsface.images.folder import list_photos
from bsface.images.video import VideoFrames, read_video
from bsface.reconstruct import reconstruct
from bsface.surface.template import load_template

sys.path.insert(0, str(ROOT / "tests"))

from pictures_for_tests import (  # noqa: E402
    SRGB_FORMULA,
    encoded,
    heic,
    icc_profile,
    png_with_profile,
    rgb_to_xyz,
)

Pictures = Sequence[np.ndarray]
MINUTE_SIZE = (1920, 1080)


def write_heic(pictures: Pictures, folder: Path, quality: int) -> None:
    for k, picture in enumerate(pictures):
        (folder / f"{k:03d}.heic").write_bytes(heic(picture, quality))


def write_p3(pictures: Pictures, folder: Path, quality: int) -> None:
    del quality
    change = np.linalg.solve(rgb_to_xyz("Display P3"), rgb_to_xyz("sRGB"))
    profile = icc_profile("Display P3", SRGB_FORMULA)
    for k, picture in enumerate(pictures):
        c = picture / 255
        linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
        c = np.clip(linear @ change.T, 0, 1)
        stored = np.where(c <= 0.0031308, 12.92 * c, 1.055 * c ** (1 / 2.4) - 0.055)
        png = encoded(".png", np.round(stored * 65535).astype(np.uint16))
        (folder / f"{k:03d}.png").write_bytes(png_with_profile(png, profile))


def write_mirrored(pictures: Pictures, folder: Path, quality: int) -> None:
    del quality
    for k, picture in enumerate(pictures):
        stored = picture[:, ::-1] if k % 3 == 1 else picture
        (folder / f"{k:03d}.png").write_bytes(encoded(".png", stored))


def minute(pictures: Pictures) -> Iterator[np.ndarray]:
    """1800 frames in OpenCV's order of colours, 30 a second."""
    size, count = MINUTE_SIZE, 1800
    noise = np.random.default_rng(0).normal(0, 2, (2, *size[::-1], 3))
    noise = noise.round().astype(np.int16)
    for number in range(count):
        picture = pictures[number * len(pictures) // count][..., ::-1]
        h, w = picture.shape[:2]
        scale = size[1] / h * (1 + 0.03 * np.sin(number / 40))
        x = (size[0] - scale * w) / 2 + 15 * np.sin(number / 23)
        move = np.array([[scale, 0, x], [0, scale, 10 * np.cos(number / 31)]])
        frame = cv2.warpAffine(picture, move, size, borderValue=(90, 100, 110))
        frame = np.clip(frame.astype(np.int16) + noise[number % 2], 0, 255)
        yield frame.astype(np.uint8)


def write_minute(pictures: Pictures, folder: Path, quality: int) -> None:
    del quality
    code = cv2.VideoWriter_fourcc(*"mp4v")
    writer = cv2.VideoWriter(str(folder / "minute.mp4"), code, 30.0, MINUTE_SIZE)
    assert writer.isOpened()
    for frame in minute(pictures):
        writer.write(frame)
    writer.release()


def write_minute_by(
    ffmpeg: str, encoder: Sequence[str], pictures: Pictures, folder: Path
) -> None:
    """The minute, encoded by an FFmpeg of the user's."""
    size = "x".join(map(str, MINUTE_SIZE))
    raw = ["-f", "rawvideo", "-pix_fmt", "bgr24", "-s", size, "-r", "30", "-i", "-"]
    coded = [*encoder, "-pix_fmt", "yuv420p", str(folder / "minute.mp4")]
    command = [ffmpeg, "-loglevel", "error", *raw, *coded]
    with subprocess.Popen(command, stdin=subprocess.PIPE) as program:
        assert program.stdin is not None
        for frame in minute(pictures):
            program.stdin.write(frame.tobytes())
        program.stdin.close()
    assert program.returncode == 0


def clip_writer(code: str, name: str) -> Callable[[Pictures, Path, int], None]:
    def write(pictures: Pictures, folder: Path, quality: int) -> None:
        h, w = pictures[0].shape[:2]
        # Only OpenCV's own writer of MJPEG takes a quality.
        own = code == "MJPG"
        writer = cv2.VideoWriter(
            str(folder / name),
            cv2.CAP_OPENCV_MJPEG if own else cv2.CAP_FFMPEG,
            cv2.VideoWriter_fourcc(*code),
            10.0,
            (w, h),
            [cv2.VIDEOWRITER_PROP_QUALITY, quality] if own else [],
        )
        assert writer.isOpened()
        for picture in pictures:
            writer.write(np.ascontiguousarray(picture[..., ::-1]))
        writer.release()

    return write


def frames_of(clip: Path) -> list[np.ndarray]:
    """Pixels of the frames that are chosen of a video."""
    found = read_video(clip)
    assert isinstance(found, VideoFrames), found
    return [photo.pixels for photo in found.photos()]


KINDS: dict[str, Callable[[Pictures, Path, int], None]] = {
    "heic": write_heic,
    "p3": write_p3,
    "lossless": clip_writer("FFV1", "clip.mkv"),
    "mjpeg": clip_writer("MJPG", "clip.avi"),
    "mirrored": write_mirrored,
    "minute": write_minute,
}
#: Options of FFmpeg.
ENCODERS = {
    "h264": "-c:v libx264 -preset veryfast -b:v 15M -g 30",
    "hevc": "-c:v libx265 -preset ultrafast -b:v 10M -tag:v hvc1 -x265-params "
    "keyint=30:log-level=error",
}
#: Measured unless others are asked for.
USUAL = ("heic", "p3", "lossless", "mjpeg", "mirrored")


def main() -> None:
    """Run the command line."""
    p = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    p.add_argument("--data", type=Path, default=EVAL, help="sets with ground truth")
    p.add_argument("--set", default="mh-c/S1", help="default: the example photos")
    p.add_argument("--photos", type=int, metavar="N", help="only N of them")
    p.add_argument("--quality", type=int, default=95, help="of HEIC and MJPEG")
    p.add_argument("--only", nargs="+", choices=["photos", *KINDS, *ENCODERS])
    p.add_argument("--ffmpeg", default="ffmpeg", help="the program, for h264 and hevc")
    options = p.parse_args()
    cv2.setNumThreads(1)
    given: FaceSet | None = None
    folder = ROOT / "examples" / "photos"
    wanted = options.data / options.set
    if options.set != p.get_default("set") and not wanted.is_dir():
        p.error(f"{wanted} is no folder; name that of the sets with --data.")
    if wanted.is_dir():
        given = load_set(options.data, options.set)
        folder = given.photos
    paths = list_photos(folder)
    if options.photos:
        paths = paths[:: max(len(paths) // options.photos, 1)][: options.photos]
    pictures = [cv2.imread(str(path))[..., ::-1] for path in paths]
    rows, first = [], None
    for kind in options.only or ["photos", *USUAL]:
        with contextlib.ExitStack() as stack:
            source: Path | list = list(paths)
            if kind != "photos":
                place = stack.enter_context(tempfile.TemporaryDirectory())
                source = Path(place)
                if kind in ENCODERS:
                    encoder = ENCODERS[kind].split()
                    write_minute_by(options.ffmpeg, encoder, pictures, source)
                else:
                    KINDS[kind](pictures, source, options.quality)
            start = time.process_time()
            if isinstance(source, Path):
                for clip in source.glob("clip.*"):
                    source = frames_of(clip)
            found = reconstruct(source)
            seconds = time.process_time() - start
        first = first or found
        error = float("nan")
        if given is not None:
            face = surface_face(found.surface, load_template())
            error = score(load_measure(options.data), face, given).mean
        used = len(found.photos)
        away = compare(first.surface, found.surface).mean_pct
        rows.append(
            {"kind": kind, "used": used, "away": away, "error": error, "time": seconds}
        )
        print(f"{kind}: {away:.3f} % from the first, {seconds:.0f} s", flush=True)
    columns = [
        ("used", "used", ".0f"),
        ("away", "from the first %", ".3f"),
        ("error", "error %", ".3f"),
        ("time", "seconds", ".0f"),
    ]
    print(text_table(rows, columns, [("kind", "files")]))


if __name__ == "__main__":
    main()
