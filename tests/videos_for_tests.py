"""Clips for the tests: of pictures by OpenCV, then changed in their boxes."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

CODECS = {".mp4": "mp4v", ".mov": "mp4v", ".m4v": "mp4v", ".mkv": "mp4v"}
CODECS |= {".avi": "MJPG", ".webm": "VP80"}
# Where an MP4 of one track holds what is changed here.
SAMPLES = (b"moov", b"trak", b"mdia", b"minf", b"stbl")


def write_clip(path: Path, frames: Sequence[np.ndarray], rate: float = 10) -> Path:
    """A clip of (h, w, 3) uint8 RGB pictures of one size."""
    h, w = frames[0].shape[:2]
    code = cv2.VideoWriter_fourcc(*CODECS[path.suffix.lower()])
    writer = cv2.VideoWriter(str(path), code, rate, (w, h))
    assert writer.isOpened()
    for frame in frames:
        writer.write(np.ascontiguousarray(frame[..., ::-1]))
    writer.release()
    return path


def write_changing_clip(
    path: Path, frames: Sequence[np.ndarray], claimed: int | None = None
) -> Path:
    """A Motion JPEG AVI of (h, w, 3) uint8 RGB pictures of any size, 10 a second.

    It may claim to have another number of them.
    """

    def chunk(name: bytes, body: bytes) -> bytes:
        return name + struct.pack("<I", len(body)) + body + bytes(len(body) % 2)

    h, w = frames[0].shape[:2]
    stored = [cv2.imencode(".jpg", frame[..., ::-1])[1].tobytes() for frame in frames]
    count = len(stored) if claimed is None else claimed
    main = struct.pack("<14I", 100_000, *[0] * 3, count, 0, 1, 0, w, h, *[0] * 4)
    times = (0, 1, 10, 0, count, 1 << 20, 10_000, 0)
    stream = b"vidsMJPG" + struct.pack("<IHH8I4H", 0, 0, 0, *times, 0, 0, w, h)
    kind = struct.pack("<IiiHH4s5I", 40, w, h, 1, 24, b"MJPG", w * h * 3, *[0] * 4)
    about = b"strl" + chunk(b"strh", stream) + chunk(b"strf", kind)
    head = b"hdrl" + chunk(b"avih", main) + chunk(b"LIST", about)
    movie = b"movi" + b"".join(chunk(b"00dc", frame) for frame in stored)
    body = b"AVI " + chunk(b"LIST", head) + chunk(b"LIST", movie)
    path.write_bytes(chunk(b"RIFF", body))
    return path


def turned_clip(path: Path) -> None:
    """Let an MP4 ask to be turned by a quarter, clockwise."""
    data = bytearray(path.read_bytes())
    # After tkhd: version and flags, two times, number, 0, duration, 8 zeros, layer,
    # group, volume, 0; then the matrix.
    at = data.index(b"tkhd") + 44
    width = struct.unpack(">i", data[at + 36 : at + 40])[0]
    data[at : at + 36] = struct.pack(
        ">9i", 0, 1 << 16, 0, -(1 << 16), 0, 0, width, 0, 1 << 30
    )
    path.write_bytes(data)


def with_times(path: Path, steps: Sequence[int]) -> None:
    """Show each frame of an MP4 for so many of the file's units of time."""
    runs = b"".join(struct.pack(">II", 1, step) for step in steps)
    body = struct.pack(">II", 0, len(steps)) + runs
    path.write_bytes(_replaced(path.read_bytes(), (*SAMPLES, b"stts"), lambda _: body))


def with_colour(path: Path, primaries: int, transfer: int, matrix: int) -> None:
    """Let an MP4 say which colours it has (ITU-T H.273)."""
    codes = (primaries, transfer, matrix)
    _describe(path, struct.pack(">I4s4sHHHB", 19, b"colr", b"nclx", *codes, 0))


def with_pixel_aspect(path: Path, wide: int, high: int) -> None:
    """Let an MP4 say that its pixels are not square (ISO/IEC 14496-12, 12.1.4)."""
    _describe(path, struct.pack(">I4sII", 16, b"pasp", wide, high))


def with_metadata(
    path: Path,
    said: Sequence[tuple[str, int, bytes]],
    *,
    level: str = "track",
    plain: bool = False,
) -> None:
    """Give an MP4 metadata: names, types and values, of its track or of the file.

    ``plain`` writes them as QuickTime does, without version and flags.
    """

    def box(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I4s", len(body) + 8, kind) + body

    handler = box(b"hdlr", struct.pack(">II4s12xx", 0, 0, b"mdta"))
    names = [box(b"mdta", name.encode()) for name, _, _ in said]
    keys = box(b"keys", struct.pack(">II", 0, len(names)) + b"".join(names))
    items = [
        box(
            struct.pack(">I", number), box(b"data", struct.pack(">II", kind, 0) + value)
        )
        for number, (_, kind, value) in enumerate(said, start=1)
    ]
    body = handler + keys + box(b"ilst", b"".join(items))
    added = box(b"meta", body if plain else bytes(4) + body)
    place = (b"moov", b"trak") if level == "track" else (b"moov",)
    path.write_bytes(_replaced(path.read_bytes(), place, lambda old: old + added))


def _describe(path: Path, box: bytes) -> None:
    """Add a box to what an MP4 says of its pictures."""

    def longer(body: bytes) -> bytes:
        size, kind = struct.unpack(">I4s", body[8:16])
        entry = struct.pack(">I4s", size + len(box), kind) + body[16 : 8 + size]
        return body[:8] + entry + box

    path.write_bytes(_replaced(path.read_bytes(), (*SAMPLES, b"stsd"), longer))


def _replaced(data: bytes, path: tuple[bytes, ...], change) -> bytes:
    """A file of boxes with another content in the box at a path."""
    parts, at = [], 0
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at : at + 8])
        body = data[at + 8 : at + size]
        if kind == path[0]:
            body = change(body) if len(path) == 1 else _replaced(body, path[1:], change)
        parts.append(struct.pack(">I4s", len(body) + 8, kind) + body)
        at += size
    return b"".join(parts)
