"""Byte-level mutations of valid files, as a hypothesis strategy."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence

from hypothesis import strategies as st

# Where parsers break: limits of the integers, and what stands for numbers in text.
WORDS = (
    [n.to_bytes(k, order) for n in (0, 1, 127, 128, 255) for k in (1, 2, 4)
     for order in ("big", "little")]
    + [b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"\x80\0\0\0", b"\0\0\0\x80"]
    + [b"NaN", b"Infinity", b"-1", b"1e999", b"null", b"true", b"[]", b"{}", b'""']
    + [b"[" * 3000, b"9" * 5000, b"\xff\xfe", b"\xc3\x28", b"\xed\xa0\x80", b"\n"]
)  # fmt: skip


@st.composite
def mutated(draw: st.DrawFn, seeds: Sequence[bytes], most: int = 8) -> bytes:
    """One of the seeds after up to ``most`` edits; now and then no seed at all."""
    if draw(st.integers(0, 19)) == 0:
        return draw(st.binary(max_size=300))
    data = bytearray(draw(st.sampled_from(seeds)))
    for _ in range(draw(st.integers(0, most))):
        # Headers stand first, directories last; most of the rest is pixels or numbers.
        size = len(data)
        at = draw(
            st.one_of(
                st.integers(0, min(size, 64)),
                st.integers(max(size - 64, 0), size),
                st.integers(0, size),
            )
        )
        length = draw(st.integers(1, 16))
        edit = draw(st.integers(0, 5))
        if edit == 0 and at < size:
            data[at] ^= 1 << draw(st.integers(0, 7))
        elif edit == 1:
            word = draw(st.sampled_from(WORDS))
            data[at : at + len(word)] = word
        elif edit == 2:
            data[at:at] = draw(st.one_of(st.sampled_from(WORDS), st.binary(max_size=9)))
        elif edit == 3:
            del data[at : at + length]
        elif edit == 4:
            data[at:at] = data[at : at + 4 * length]
        elif edit == 5 and draw(st.booleans()):
            del data[at:]
    return bytes(data)


def inside_zip(seeds: Sequence[bytes]) -> st.SearchStrategy[bytes]:
    """Archives whose members are mutated, so that checksums do not refuse them all."""
    members = [_members(seed) for seed in seeds]

    @st.composite
    def strategy(draw: st.DrawFn) -> bytes:
        files = dict(draw(st.sampled_from(members)))
        for name in draw(st.lists(st.sampled_from(sorted(files)), max_size=3)):
            files[name] = draw(mutated([files[name]], most=4))
        if draw(st.integers(0, 9)) == 0:
            files.pop(draw(st.sampled_from(sorted(files))))
        if draw(st.integers(0, 9)) == 0:  # one array in place of another
            files[draw(st.sampled_from(sorted(files)))] = draw(
                st.sampled_from(list(files.values()))
            )
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w") as archive:
            for name, content in files.items():
                archive.writestr(name, content)
        return buffer.getvalue()

    return st.one_of(strategy(), mutated(seeds))


def _members(data: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}
