"""The packet: the byte table, the checks' published values, and there and back."""

import re
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from cnnum.drivers.serial_packet import (
    CELL_TYPES,
    HEADER,
    LAYOUTS,
    UNITS,
    Geometry,
    Packet,
    crc16,
    crc32,
    decode,
    decode_header,
    encode,
)
from cnnum.errors import CodecError

DOCS = Path(__file__).parents[2] / "docs" / "serial-protocol.md"

EXAMPLE = Packet(
    Geometry(1, 2, 3, cell=4, layout=2, unit=0),
    np.array([[[1, -2, 300], [0, 5, -600]]], dtype="<i2"),
    sequence=7,
    time_us=123_456,
    period_us=5_000,
)


@st.composite
def packets(draw: st.DrawFn) -> Packet:
    layout = draw(st.sampled_from([0, *LAYOUTS]))
    channels = len(LAYOUTS[layout]) if layout else draw(st.integers(1, 5))
    rows, cols = draw(st.integers(1, 6)), draw(st.integers(1, 6))
    cell = draw(st.sampled_from(sorted(CELL_TYPES)))
    geometry = Geometry(rows, cols, channels, cell, layout, draw(st.sampled_from(sorted(UNITS))))
    values = draw(hnp.arrays(geometry.dtype, (rows, cols, channels)))
    counts = (draw(st.integers(0, 2**bits - 1)) for bits in (32, 64, 32))
    return Packet(geometry, values, *counts, flags=draw(st.integers(0, 1)))


def same(one: Packet, other: Packet) -> bool:
    """Bit for bit: a NaN in an f32 cell counts as equal to itself."""
    facts = ("geometry", "sequence", "time_us", "period_us", "flags")
    equal = all(getattr(one, name) == getattr(other, name) for name in facts)
    return equal and one.values.tobytes() == other.values.tobytes()


@given(packets())
def test_decode_inverts_encode(packet: Packet) -> None:
    assert same(decode(encode(packet)), packet)


@given(packets(), st.data())
def test_any_one_flipped_bit_is_noticed(packet: Packet, data: st.DataObject) -> None:
    # A CRC finds every single-bit error, so this holds without exception.
    damaged = bytearray(encode(packet))
    bit = data.draw(st.integers(0, 8 * len(damaged) - 1))
    damaged[bit // 8] ^= 1 << bit % 8
    with pytest.raises(CodecError):
        decode(bytes(damaged))


def reflected(value: int, bits: int) -> int:
    return int(f"{value:0{bits}b}"[::-1], 2)


def crc_bit_by_bit(data: bytes, bits: int, polynomial: int, *, reflect: bool) -> int:
    """The definition: long division, one bit at a time."""
    top, mask = 1 << bits - 1, (1 << bits) - 1
    rest = mask
    for byte in data:
        rest ^= (reflected(byte, 8) if reflect else byte) << bits - 8
        for _ in range(8):
            rest = (rest << 1 ^ polynomial if rest & top else rest << 1) & mask
    return reflected(rest, bits) if reflect else rest


@given(st.binary(max_size=64))
def test_checks_are_the_documented_divisions(data: bytes) -> None:
    assert crc16(data) == crc_bit_by_bit(data, 16, 0x1021, reflect=False)
    assert crc32(data) == crc_bit_by_bit(data, 32, 0x04C11DB7, reflect=True) ^ 0xFFFFFFFF


def test_checks_have_their_published_values() -> None:
    assert crc16(b"123456789") == 0x29B1
    assert crc32(b"123456789") == 0xCBF43926 == zlib.crc32(b"123456789")


def test_the_documents_example_is_what_is_sent() -> None:
    block = re.search(r"```\n([0-9a-f \n]+)```", DOCS.read_text(encoding="utf-8"))
    assert block is not None
    written = bytes.fromhex(block[1])
    assert encode(EXAMPLE) == written
    assert same(decode(written), EXAMPLE)


def test_the_documents_table_is_the_layout() -> None:
    rows = re.findall(r"^\| (\d+) \| (u8|u16|u32|u64|4 bytes) ", DOCS.read_text("utf-8"), re.M)
    sizes = {"u8": 1, "u16": 2, "u32": 4, "u64": 8, "4 bytes": 4}
    at = 0
    for offset, kind in rows:
        assert int(offset) == at
        at += sizes[kind]
    assert at == HEADER.size


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"rows": 0}, "1 to 255"),
        ({"cols": 256}, "1 to 255"),
        ({"cell": 9}, "cell type must be one of"),
        ({"layout": 2, "channels": 4}, "has 3 channels, got 4"),
        ({"unit": 77}, "unit must be one of"),
        ({"rows": 255, "cols": 255, "channels": 255}, "at most"),
    ],
)
def test_a_geometry_that_cannot_be_is_refused(change: dict[str, int], sentence: str) -> None:
    with pytest.raises(CodecError, match=sentence):
        Geometry(**{"rows": 2, "cols": 2, "channels": 3, "cell": 1, **change})


def test_what_does_not_fit_is_not_sent() -> None:
    wrong_type = Packet(EXAMPLE.geometry, EXAMPLE.values.astype(np.float64), 0, 0)
    wrong_shape = Packet(EXAMPLE.geometry, EXAMPLE.values[:, :1], 0, 0)
    too_late = Packet(EXAMPLE.geometry, EXAMPLE.values, 2**32, 0)
    for packet in (wrong_type, wrong_shape, too_late):
        with pytest.raises(CodecError):
            encode(packet)


@pytest.mark.parametrize(
    ("place", "value", "sentence"),
    [(0, 0, "starts with"), (4, 2, "CRC-16"), (5, 9, "CRC-16"), (-1, 0, "CRC-32")],
)
def test_the_sentence_says_what_is_wrong(place: int, value: int, sentence: str) -> None:
    damaged = bytearray(encode(EXAMPLE))
    damaged[place] = value
    with pytest.raises(CodecError, match=sentence):
        decode(bytes(damaged))


def test_another_version_is_named() -> None:
    head = bytearray(encode(EXAMPLE)[: HEADER.size])
    head[4] = 2
    head[30:32] = crc16(bytes(head[:30])).to_bytes(2, "little")
    with pytest.raises(CodecError, match="version 2"):
        decode_header(bytes(head))


def test_a_length_that_differs_is_named() -> None:
    for data in (encode(EXAMPLE)[:-1], encode(EXAMPLE) + b"\0", b""):
        with pytest.raises(CodecError, match="bytes"):
            decode(data)
