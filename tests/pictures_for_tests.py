"""Picture files of every kind that OpenCV alone does not write, for the tests."""

from __future__ import annotations

import io
import struct
import zlib

import cv2
import numpy as np
from PIL import Image


def encoded(ending: str, rgb: np.ndarray, *options: int) -> bytes:
    order = [2, 1, 0] + [3] * (rgb.shape[2] == 4) if rgb.ndim == 3 else None
    data = rgb if order is None else np.ascontiguousarray(rgb[..., order])
    done, buffer = cv2.imencode(ending, data, list(options))
    assert done
    return buffer.tobytes()


def _chunk(name: bytes, body: bytes) -> bytes:
    crc = zlib.crc32(name + body)
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", crc)


def _png(kind: int, width: int, height: int, *chunks: bytes, bits: int = 8) -> bytes:
    head = _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, kind, 0, 0, 0))
    return b"".join([b"\x89PNG\r\n\x1a\n", head, *chunks, _chunk(b"IEND", b"")])


def _rows(pixels: np.ndarray) -> bytes:
    """Compressed rows of a PNG, each with filter 0."""
    flat = pixels.reshape(len(pixels), -1)
    return zlib.compress(np.pad(flat, ((0, 0), (1, 0))).tobytes())


def bomb(width: int, height: int, bits: int = 8, kind: int = 2) -> bytes:
    """A PNG of some bytes that claims a picture of any size."""
    pixels = _chunk(b"IDAT", zlib.compress(b"\0" * 1000))
    return _png(kind, width, height, pixels, bits=bits)


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


# --- colour profiles -----------------------------------------------------------------

D65 = (0.3127, 0.3290)
PRIMARIES = {
    "sRGB": ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06)),
    "Display P3": ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060)),
    "Adobe RGB": ((0.64, 0.33), (0.21, 0.71), (0.15, 0.06)),
    "BT.2020": ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046)),
}


def rgb_to_xyz(space: str) -> np.ndarray:
    """(3, 3): linear RGB of a space to XYZ under D65."""
    xyz = [np.array([x, y, 1 - x - y]) / y for x, y in (*PRIMARIES[space], D65)]
    rgb = np.stack(xyz[:3], axis=1)
    return rgb * np.linalg.solve(rgb, xyz[3])


def icc_profile(space: str, curve: bytes, colours: bytes = b"RGB ") -> bytes:
    """An ICC profile of version 2: primaries adapted to D50 by Bradford, one curve."""
    bradford = np.array(
        [
            [0.8951, 0.2664, -0.1614],
            [-0.7502, 1.7135, 0.0367],
            [0.0389, -0.0685, 1.0296],
        ]
    )
    d65 = rgb_to_xyz(space).sum(axis=1)
    d50 = np.array([0.9642, 1.0, 0.8249])
    scale = np.diag((bradford @ d50) / (bradford @ d65))
    columns = np.linalg.solve(bradford, scale @ bradford @ rgb_to_xyz(space)).T
    tags = {b"wtpt": _xyz(d50)}
    for letter, column in zip(b"rgb", columns, strict=True):
        tags[bytes([letter]) + b"XYZ"] = _xyz(column)
        tags[bytes([letter]) + b"TRC"] = curve
    tags[b"desc"] = b"desc" + bytes(4) + struct.pack(">I", 5) + b"test\0" + bytes(78)
    tags[b"cprt"] = b"text" + bytes(4) + b"none\0"
    if colours == b"GRAY":
        tags = {b"wtpt": _xyz(d50), b"kTRC": curve}
    table, bodies, at = b"", b"", 132 + 12 * len(tags)
    for name, body in tags.items():
        body += bytes(-len(body) % 4)
        table += struct.pack(">4sII", name, at + len(bodies), len(body))
        bodies += body
    content = struct.pack(">I", len(tags)) + table + bodies
    head = struct.pack(">I4sI4s4s4s", len(content) + 128, b"", 0x02400000, b"mntr",
                       colours, b"XYZ ")  # fmt: skip
    head += bytes(12) + b"acsp" + bytes(28) + _xyz(d50)[8:] + bytes(48)
    return head + content


def _xyz(values: np.ndarray) -> bytes:
    return (
        b"XYZ " + bytes(4) + struct.pack(">3i", *np.round(values * 65536).astype(int))
    )


def power_curve(gamma: float) -> bytes:
    return b"curv" + bytes(4) + struct.pack(">IH", 1, round(gamma * 256)) + bytes(2)


def formula_curve(kind: int, *numbers: float) -> bytes:
    fixed = [round(number * 65536) for number in numbers]
    return b"para" + bytes(4) + struct.pack(f">HH{len(fixed)}i", kind, 0, *fixed)


def table_curve(values: np.ndarray) -> bytes:
    stored = np.round(values * 65535).astype(">u2").tobytes()
    return b"curv" + bytes(4) + struct.pack(">I", len(values)) + stored


SRGB_FORMULA = formula_curve(3, 2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)


def png_with_profile(png: bytes, profile: bytes) -> bytes:
    return png[:33] + _chunk(b"iCCP", b"x\0\0" + zlib.compress(profile)) + png[33:]


def jpeg_with_profile(jpeg: bytes, profile: bytes, part: int = 65000) -> bytes:
    parts = [profile[at : at + part] for at in range(0, len(profile), part)]
    segments = b""
    for number, piece in enumerate(parts, 1):
        body = b"ICC_PROFILE\0" + bytes([number, len(parts)]) + piece
        segments += b"\xff\xe2" + struct.pack(">H", len(body) + 2) + body
    return jpeg[:2] + segments + jpeg[2:]


# --- by optional packages ------------------------------------------------------------


def heic(
    rgb: np.ndarray,
    quality: int = 95,
    turn: int = 1,
    profile: bytes = b"",
    exif: bytes = b"",
) -> bytes:
    """A HEIC file as pillow-heif writes it: uint16 with 10 bits, uint8 with 8."""
    import pillow_heif

    mode = "RGB" if rgb.dtype == np.uint8 else "RGB;16"
    picture = pillow_heif.from_bytes(mode, rgb.shape[1::-1], rgb.tobytes())
    buffer = io.BytesIO()
    about = {"icc_profile": profile} if profile else {}
    turned = Image.Exif()
    turned[274] = turn
    picture.save(buffer, quality=quality, exif=exif or turned.tobytes(), **about)
    return buffer.getvalue()


def by_pillow(kind: str, rgb: np.ndarray, **options: object) -> bytes:
    """A file of a kind that Pillow writes: ``AVIF``, ``JPEG2000``, ..."""
    buffer = io.BytesIO()
    Image.fromarray(rgb).save(buffer, kind, **options)
    return buffer.getvalue()


def exif_turned(jpeg: bytes, orientation: int) -> bytes:
    tiff = b"MM\0*\0\0\0\x08" + struct.pack(">HHHIHHI", 1, 274, 3, 1, orientation, 0, 0)
    body = b"Exif\0\0" + tiff
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(body) + 2) + body + jpeg[2:]
