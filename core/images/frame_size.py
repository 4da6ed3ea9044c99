"""The sizes that the coded frames of a video state, read without decoding them.

OpenCV hands out every frame at the size of the first one. A frame of another size,
which browsers record when a window or a connection changes, would be cut or mixed with
the one before; so the key frames are asked first. Known are H.264 (ITU-T H.264,
7.3.2.1), HEVC (ITU-T H.265, 7.3.2.2), VP8 (RFC 6386, 9.1), VP9 (its bitstream
specification, 6.2; profiles 0 to 2) and Motion JPEG.
"""

from __future__ import annotations

import struct
from pathlib import Path

import cv2

from ..progress import CheckCancelled, never_cancelled
from .capture import opened
from .header import read_header

Size = tuple[int, int]

_HEVC = ("hevc", "hvc1", "hev1")
# H.264's profiles whose parameters begin with the kind of colours (7.3.2.1.1).
_HIGH = (100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134, 135)


def size_change(
    path: Path, check_cancelled: CheckCancelled = never_cancelled
) -> tuple[float, Size, Size] | None:
    """When a key frame first has another size: seconds, size before, size after.

    None if all have one size, or a codec does not tell.

    Parameters
    ----------
    path : pathlib.Path
        A video.
    check_cancelled : callable, optional
        Called for every coded frame; may raise `Cancelled`.
    """
    with opened(path, coded=True) as video:
        number = int(video.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF
        hevc = struct.pack("<I", number).decode("latin-1").lower() in _HEVC
        before: Size | None = None
        while video.grab():
            check_cancelled()
            found, packet = video.retrieve()
            if not found or packet is None:
                continue
            size = stated_size(packet.tobytes(), hevc=hevc)
            if size is not None and before not in (None, size):
                return video.get(cv2.CAP_PROP_POS_MSEC) / 1000, before, size
            before = size or before
    return None


def stated_size(packet: bytes, *, hevc: bool = False) -> Size | None:
    """Width and height that a coded frame states; None if it states none.

    H.264 and HEVC state them in whole blocks, before the edge is cut off.

    Parameters
    ----------
    packet : bytes
        H.264 and HEVC with start codes (Annex B). Any content is allowed.
    hevc : bool
        Whether start codes are those of HEVC.
    """
    if packet[:2] == b"\xff\xd8":
        header = read_header(packet)
        return None if header is None else (header.width, header.height)
    if packet[3:6] == b"\x9d\x01\x2a" and not packet[0] & 1 and len(packet) >= 10:
        width, height = struct.unpack("<HH", packet[6:10])
        return width & 0x3FFF, height & 0x3FFF
    try:
        if packet[1:4] == b"\x49\x83\x42":
            return _vp9(packet)
        if packet[:3] == b"\0\0\1" or packet[:4] == b"\0\0\0\1":
            return _parameter_set(packet, hevc)
    except IndexError:  # cut off
        pass
    return None


class _Bits:
    """Bits of a byte string, the highest of each byte first."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = 0

    def number(self, count: int) -> int:
        """An unsigned number of so many bits."""
        end = self.at + count
        if end > 8 * len(self.data):
            raise IndexError
        last = -(-end // 8)
        whole = int.from_bytes(self.data[self.at // 8 : last], "big")
        self.at = end
        return whole >> (8 * last - end) & ((1 << count) - 1)

    def golomb(self) -> int:
        """ue(v): an unsigned exponential Golomb code."""
        zeros = 0
        while not self.number(1):
            zeros += 1
        return (1 << zeros) - 1 + self.number(zeros)

    def signed(self) -> int:
        """se(v)."""
        code = self.golomb()
        return (code + 1) // 2 if code % 2 else -(code // 2)


def _vp9(packet: bytes) -> Size:
    """Of the uncompressed header of a key frame."""
    bits = _Bits(packet)
    bits.number(2)
    profile = bits.number(2)  # in reverse order of its bits; 3 has a longer head
    bits.at = 32
    if profile == 0b01:
        bits.number(1)  # bits of a sample
    rgb = bits.number(3) == 7
    if not rgb:
        bits.number(1)  # range
    if profile == 0b10:
        bits.number(1 if rgb else 3)  # subsampling
    return bits.number(16) + 1, bits.number(16) + 1


def _parameter_set(packet: bytes, hevc: bool) -> Size | None:
    """Of the first sequence parameter set of a packet."""
    for unit in packet.split(b"\0\0\1")[1:]:
        if not unit:
            continue
        # Zeros are followed by a 3 where they would look like a start code.
        if hevc and unit[0] >> 1 & 0x3F == 33:
            return _hevc(_Bits(unit[2:200].replace(b"\0\0\3", b"\0\0")))
        if not hevc and unit[0] & 0x1F == 7:
            return _h264(_Bits(unit[1:400].replace(b"\0\0\3", b"\0\0")))
    return None


def _hevc(bits: _Bits) -> Size:
    bits.number(4)
    layers = bits.number(3)
    bits.number(1 + 88 + 8)  # nesting; profile, tier and level
    present = [(bits.number(1), bits.number(1)) for _ in range(8 if layers else 0)]
    for profile, level in present[:layers]:
        bits.number(88 * profile + 8 * level)
    bits.golomb()  # which set
    if bits.golomb() == 3:  # kind of colours
        bits.number(1)
    return bits.golomb(), bits.golomb()


def _h264(bits: _Bits) -> Size:
    profile = bits.number(8)
    bits.number(16)
    bits.golomb()  # which set
    if profile in _HIGH:
        colours = bits.golomb()
        if colours == 3:
            bits.number(1)
        bits.golomb()  # depth of brightness
        bits.golomb()  # and of colours
        bits.number(1)  # lossless
        if bits.number(1):
            for k in range(12 if colours == 3 else 8):
                if bits.number(1):
                    _pass_over_scaling(bits, 16 if k < 6 else 64)
    bits.golomb()
    order = bits.golomb()
    if order == 0:
        bits.golomb()
    elif order == 1:
        bits.number(1)
        bits.golomb()
        bits.golomb()
        for _ in range(bits.golomb()):
            bits.golomb()
    bits.golomb()
    bits.number(1)
    width, height = bits.golomb() + 1, bits.golomb() + 1
    return 16 * width, 16 * height * (2 - bits.number(1))


def _pass_over_scaling(bits: _Bits, count: int) -> None:
    """A list of scalings (7.3.2.1.1.1): differences, until one gives zero."""
    last = following = 8
    for _ in range(count):
        if following:
            following = (last + bits.signed()) % 256
        last = following or last
