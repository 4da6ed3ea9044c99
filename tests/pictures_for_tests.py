"""Picture files of every kind that OpenCV alone does not write, for the tests."""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np


def encoded(ending: str, rgb: np.ndarray, *options: int) -> bytes:
    order = [2, 1, 0] + [3] * (rgb.shape[2] == 4) if rgb.ndim == 3 else None
    data = rgb if order is None else np.ascontiguousarray(rgb[..., order])
    done, buffer = cv2.imencode(ending, data, list(options))
    assert done
    return buffer.tobytes()


def _chunk(name: bytes, body: bytes) -> bytes:
    crc = zlib.crc32(name + body)
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", crc)


def _png(kind: int, width: int, height: int, *chunks: bytes) -> bytes:
    head = _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, kind, 0, 0, 0))
    return b"".join([b"\x89PNG\r\n\x1a\n", head, *chunks, _chunk(b"IEND", b"")])


def _rows(pixels: np.ndarray) -> bytes:
    """Compressed rows of a PNG, each with filter 0."""
    flat = pixels.reshape(len(pixels), -1)
    return zlib.compress(np.pad(flat, ((0, 0), (1, 0))).tobytes())


def bomb(width: int, height: int) -> bytes:
    """A PNG of some bytes that claims a picture of any size."""
    return _png(2, width, height, _chunk(b"IDAT", zlib.compress(b"\0" * 1000)))


def palette(rgb: np.ndarray) -> bytes:
    """A PNG with the nearest of 240 colours."""
    steps = np.array([7, 5, 4])
    levels = np.round(rgb / 255 * steps).astype(np.uint8)
    index = (levels[..., 0] * 6 + levels[..., 1]) * 5 + levels[..., 2]
    r, g, b = np.meshgrid(*(np.linspace(0, 255, s + 1) for s in steps), indexing="ij")
    colours = np.stack([r, g, b], -1).round().astype(np.uint8)
    h, w = index.shape
    plte, idat = _chunk(b"PLTE", colours.tobytes()), _chunk(b"IDAT", _rows(index))
    return _png(3, w, h, plte, idat)


def animated(frames: list[np.ndarray]) -> bytes:
    """An animated PNG of frames of one size."""
    h, w = frames[0].shape[:2]
    parts = [_chunk(b"acTL", struct.pack(">II", len(frames), 0))]
    number = 0
    for k, frame in enumerate(frames):
        about = struct.pack(">IIIIIHHBB", number, w, h, 0, 0, 1, 10, 0, 0)
        parts.append(_chunk(b"fcTL", about))
        number += 1
        data = _rows(frame)
        if k == 0:
            parts.append(_chunk(b"IDAT", data))
        else:
            parts.append(_chunk(b"fdAT", struct.pack(">I", number) + data))
            number += 1
    return _png(2, w, h, *parts)


def cmyk(rgb: np.ndarray) -> bytes:
    """A CMYK JPEG as Adobe writes it: inverted, here with no black.

    Each ink is a grey JPEG; the four become one file with a scan each.
    """
    full = np.full(rgb.shape[:2], 255, np.uint8)
    inks = [encoded(".jpg", c) for c in (*np.moveaxis(rgb, -1, 0), full)]
    adobe = b"\xff\xee\0\x0eAdobe\0\x64\0\0\0\0\0"
    parts, tables, scans = [b"\xff\xd8", adobe], [], []
    for number, ink in enumerate(inks, 1):
        at = 2
        while ink[at + 1] != 0xDA:
            size = struct.unpack(">H", ink[at + 2 : at + 4])[0] + 2
            if number == 1 and ink[at + 1] in (0xDB, 0xC4):
                tables.append(ink[at : at + size])
            at += size
        size = struct.unpack(">H", ink[at + 2 : at + 4])[0] + 2
        head = b"\xff\xda\0\x08\x01" + bytes([number, 0]) + b"\0\x3f\0"
        scans += [head, ink[at + size : -2]]
    h, w = full.shape
    frame = b"\xff\xc0" + struct.pack(">HBHHB", 20, 8, h, w, 4)
    frame += b"".join(bytes([k, 0x11, 0]) for k in (1, 2, 3, 4))
    return b"".join([*parts, *tables, frame, *scans, b"\xff\xd9"])


def exif_turned(jpeg: bytes, orientation: int) -> bytes:
    tiff = b"MM\0*\0\0\0\x08" + struct.pack(">HHHIHHI", 1, 274, 3, 1, orientation, 0, 0)
    body = b"Exif\0\0" + tiff
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(body) + 2) + body + jpeg[2:]
