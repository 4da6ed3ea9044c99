"""Format and size of a picture from its first bytes, without decoding it.

A file of a few kilobytes can claim a billion pixels; reading the claim costs
nothing, decoding it costs the machine. Only what is needed for that decision is
read: format, width, height, bytes per pixel.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from .boxes import boxes, inside
from .tiff import directory

# Numbers of TIFF's tags.
WIDTH, HEIGHT, BITS_PER_SAMPLE, SAMPLES, SAMPLE_FORMAT = 256, 257, 258, 277, 339
COMPRESSION, LOG_LUV = 259, (34676, 34677)
# Values of the format that are not numbers without sign.
_KINDS = {2: "signed", 3: "floating-point", 5: "complex", 6: "complex"}

# What OpenCV reads. Its reader of JPEG 2000 ends the process on some damaged files.
READABLE = frozenset({"JPEG", "PNG", "BMP", "TIFF", "WebP", "PNM"})
# What the optional packages read (`codecs`).
OPTIONAL = frozenset({"HEIC", "AVIF", "JPEG 2000"})


@dataclass(frozen=True)
class ImageHeader:
    """What a picture's header claims.

    Parameters
    ----------
    format : str
        ``"JPEG"``, ``"PNG"``...; those in `READABLE` and `OPTIONAL` can be decoded.
    width, height : int
        Pixels, before any EXIF turn; 0 if the format is only recognised.
    bytes_per_pixel : float
        As stored, decoded.
    samples : str
        What a sample is, such as ``"floating-point numbers of 32 bits"``; empty for
        whole numbers of up to 16 bits without sign.
    """

    format: str
    width: int = 0
    height: int = 0
    bytes_per_pixel: float = 3.0
    samples: str = ""

    @property
    def pixels(self) -> int:
        return self.width * self.height


def read_header(data: np.ndarray | bytes) -> ImageHeader | None:
    """Header of the picture in `data`; None if it is no known picture.

    Parameters
    ----------
    data : bytes or (n,) uint8 array
        The file. Any content is allowed.
    """
    view = memoryview(data).cast("B") if isinstance(data, bytes) else data.data
    head = bytes(view[:64])
    for test, read in _FORMATS:
        if test(head):
            try:
                return read(view)
            except (struct.error, IndexError, ValueError, OverflowError):
                return None
    return None


def _jpeg(view: memoryview) -> ImageHeader | None:
    at = 2
    while at + 4 <= len(view):
        if view[at] != 0xFF:
            at += 1
            continue
        marker = view[at + 1]
        if marker == 0xFF:
            at += 1
        elif marker == 0 or 0xD0 <= marker <= 0xD8 or marker == 1:
            at += 2
        elif 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            bits, height, width, channels = struct.unpack(
                ">BHHB", view[at + 4 : at + 10]
            )
            return ImageHeader("JPEG", width, height, channels * (1 + (bits > 8)))
        elif marker in (0xD9, 0xDA):
            return None
        else:
            at += 2 + struct.unpack(">H", view[at + 2 : at + 4])[0]
    return None


def _png(view: memoryview) -> ImageHeader:
    width, height, bits, kind = struct.unpack(">IIBB", view[16:26])
    channels = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}.get(kind, 4)
    return ImageHeader("PNG", width, height, channels * max(bits, 8) / 8)


def _bmp(view: memoryview) -> ImageHeader:
    (length,) = struct.unpack("<I", view[14:18])
    if length == 12:
        width, height, _, bits = struct.unpack("<HHHH", view[18:26])
    else:
        width, height, _, bits = struct.unpack("<iiHH", view[18:30])
    return ImageHeader("BMP", abs(width), abs(height), max(bits / 8, 3))


def _tiff(view: memoryview) -> ImageHeader | None:
    tags = directory(view)
    if WIDTH not in tags or HEIGHT not in tags:
        return None
    width, height = tags[WIDTH].number(), tags[HEIGHT].number()
    channels = min(tags[SAMPLES].number(), 8) if SAMPLES in tags else 1
    bits = min(tags[BITS_PER_SAMPLE].number(), 64) if BITS_PER_SAMPLE in tags else 1
    kind = tags[SAMPLE_FORMAT].number() if SAMPLE_FORMAT in tags else 1
    if COMPRESSION in tags and tags[COMPRESSION].number() in LOG_LUV:
        kind = 3
    unusual = kind in _KINDS or bits > 16
    samples = f"{_KINDS.get(kind, 'whole')} numbers of {bits} bits" if unusual else ""
    return ImageHeader("TIFF", width, height, channels * max(bits, 8) / 8, samples)


def _webp(view: memoryview) -> ImageHeader | None:
    kind = bytes(view[12:16])
    if kind == b"VP8X":
        width = int.from_bytes(view[24:27], "little") + 1
        height = int.from_bytes(view[27:30], "little") + 1
        return ImageHeader("WebP", width, height, 4)
    if kind == b"VP8L":
        bits = int.from_bytes(view[21:25], "little")
        return ImageHeader("WebP", (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1, 4)
    if kind == b"VP8 ":
        width, height = struct.unpack("<HH", view[26:30])
        return ImageHeader("WebP", width & 0x3FFF, height & 0x3FFF, 3)
    return None


def _pnm(view: memoryview) -> ImageHeader | None:
    fields: list[int] = []
    wanted = 2 if view[1] in b"14" else 3
    for line in bytes(view[2:4096]).split(b"\n"):
        for word in line.split(b"#")[0].split():
            if not word.isdigit():
                return None
            fields.append(int(word))
            if len(fields) == wanted:
                channels = 3 if view[1] in b"36" else 1
                wide = wanted == 3 and fields[2] > 255
                return ImageHeader("PNM", fields[0], fields[1], channels * (1 + wide))
    return None


def _heif(view: memoryview) -> ImageHeader | None:
    """The largest picture in the file: others are its tiles and thumbnails."""
    first = next(boxes(view), None)
    if first is None:  # its size is smaller than its own head
        return None
    brands = first[1]
    names = {bytes(brands[i : i + 4]) for i in range(0, min(len(brands), 400), 4)}
    kind = "AVIF" if names & {b"avif", b"avis"} else "HEIC"
    path = (b"meta", b"iprp", b"ipco")
    sizes = [struct.unpack(">II", box[4:12]) for box in inside(view, *path, b"ispe")]
    width, height = max(sizes, key=lambda size: size[0] * size[1], default=(0, 0))
    # Bits of each channel; 10 and 12 are decoded to 16.
    deep = any(max(box[5:9], default=8) > 8 for box in inside(view, *path, b"pixi"))
    return ImageHeader(kind, width, height, 6 if deep else 3)


def _jp2(view: memoryview) -> ImageHeader | None:
    if view[0] == 0xFF:  # the bare codestream: SIZ follows its start
        right, bottom, left, top = struct.unpack(">IIII", view[8:24])
        (count,) = struct.unpack(">H", view[40:42])
        return ImageHeader("JPEG 2000", right - left, bottom - top, min(count, 8))
    for box in inside(view, b"jp2h", b"ihdr"):
        height, width, count = struct.unpack(">IIH", box[:10])
        return ImageHeader("JPEG 2000", width, height, min(count, 8))
    return None


def _named(name: str):
    return lambda view: ImageHeader(name)


# Brands of ISO/IEC 23008-12 and AVIF, as the file's first.
_HEIF_BRANDS = (
    b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1", b"avif",
    b"avis",
)  # fmt: skip

_FORMATS = (
    (lambda h: h[:3] == b"\xff\xd8\xff", _jpeg),
    (lambda h: h[:8] == b"\x89PNG\r\n\x1a\n" and h[12:16] == b"IHDR", _png),
    (lambda h: h[:2] == b"BM", _bmp),
    (lambda h: h[4:8] == b"ftyp" and h[8:12] in _HEIF_BRANDS, _heif),
    (lambda h: h[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"), _tiff),
    (lambda h: h[:4] == b"RIFF" and h[8:12] == b"WEBP", _webp),
    (lambda h: h[:1] == b"P" and h[1:2] in b"123456" and h[2:3].isspace(), _pnm),
    (
        lambda h: h[4:12] == b"jP  \r\n\x87\n" or h[:4] == b"\xff\x4f\xff\x51",
        _jp2,
    ),
    (lambda h: h[:6] in (b"GIF87a", b"GIF89a"), _named("GIF")),
    (lambda h: h[:4] == b"8BPS", _named("Photoshop")),
    (lambda h: h[:2] == b"\xff\x0a" or h[4:8] == b"JXL ", _named("JPEG XL")),
)
