"""Codecs: published vectors, there and back in any chunks, and noise between packets."""

import random
from pathlib import Path

import numpy as np
import pytest

from cnnum.drivers.codecs.descriptor import CHECKS
from cnnum.drivers.codecs.paxini import push, request
from cnnum.drivers.codecs.stream import Scan
from cnnum.drivers.codecs.wire import Asked, described_wire, protocol_names, wire
from cnnum.errors import CnnumError, CodecError, SceneError, UnknownNameError

from .wires import ASKED, FORMS, UNCHECKED, chunks, drawn, noise, same, spoken

PTS2 = bytes.fromhex(
    "55667788 020100 0d00 0300 1900 0400 3b00 07000000 40e2010000000000 0100 0400 0100 0400 0200"
    "0000803f 00000040 00004040 cdcccc3d cdcc4c3e 9a99993e 01000400 0200 00008040 0000a0400000c040"
    "cdcccc3e 0000003f 9a99193f 0311 aabbccdd"
)
M0404S = bytes.fromhex(
    "aa 01 0000 0064 00c8 012c 0190 01f4 0258 02bc 0320 0384 03e8 044c 04b0 0514 0578 05dc b2"
)
ANYSKIN = bytes.fromhex("0000c841 0000c03f 000000c0 00009643 0d0a")


def test_every_protocol_is_tested() -> None:
    assert set(FORMS) == set(protocol_names())


def test_the_papillarray_vector_is_read() -> None:
    (scan,) = wire("pts2").decoder().feed(PTS2)
    assert scan.values.ravel().tolist() == pytest.approx([1, 2, 3, 0.1, 0.2, 0.3], rel=1e-7)
    assert (scan.sequence, scan.time_us, scan.unit) == (7, 123_456, "N")
    loads = [scan.extras[f"device_{name}_0"] for name in ("fx", "fy", "fz", "tx", "ty", "tz")]
    assert loads == pytest.approx([4, 5, 6, 0.4, 0.5, 0.6], rel=1e-7)


def test_the_m0404s_vector_is_read_and_written() -> None:
    spoken = wire("m0404s")
    (scan,) = spoken.decoder().feed(M0404S)
    assert scan.values.ravel().tolist() == list(range(0, 1600, 100))
    assert (scan.sequence, scan.sequence_wrap) == (1, 256)
    assert spoken.encode(scan) == M0404S


def test_the_anyskin_vector_is_read() -> None:
    first, second = wire("anyskin", Asked(shape=(1, 1))).decoder().feed(2 * ANYSKIN)
    for scan in (first, second):
        assert scan.values.ravel().tolist() == [25.0, 1.5, -2.0, 300.0]


def test_the_paxini_requests_are_the_published_ones() -> None:
    assert request(1, 31) == bytes.fromhex("55aa09000100fb0e0400005d008d")
    assert push(True) == bytes.fromhex("55aa00101700010001d8")


def test_a_message_of_the_xela_server_is_read() -> None:
    data = ",".join(f"{n:04X}" for n in range(33_000, 33_048))
    line = (
        '{"message": 12, "1": {"sensor": 1, "time": 1700000000.5, "model": "uSPa44", '
        f'"taxels": 16, "data": "{data}", "calibrated": null}}}}\n'
    )
    decoder = wire("xela").decoder()
    assert decoder.feed(b'{"message": "Welcome", "version": "1.7.6"}\n') == []
    (scan,) = decoder.feed(line.encode())
    assert scan.values.ravel().tolist() == list(range(33_000, 33_048))
    assert (scan.sequence, scan.time_us, scan.unit) == (12, 1_700_000_000_500_000, "count")
    assert decoder.bad == decoder.discarded == 0


def test_four_xela_pads_become_one_array() -> None:
    sent = drawn("xela", 3)
    spoken_by = spoken("xela")
    (scan,) = spoken_by.decoder().feed(spoken_by.encode(sent))
    np.testing.assert_array_equal(scan.values, sent.values)
    (aside,) = wire("xela").decoder().feed(spoken_by.encode(sent))
    np.testing.assert_array_equal(aside.values[:, 12:], sent.values[4:, 4:])


def test_a_xela_sensor_with_too_few_numbers_is_bad() -> None:
    decoder = spoken("xela").decoder()
    line = spoken("xela").encode(drawn("xela", 1)).replace(b'"taxels": 16', b'"taxels": 15', 1)
    assert decoder.feed(line) == []
    assert decoder.bad == 1


def test_the_converters_error_of_length_on_a_good_answer_is_read() -> None:
    known = spoken("paxini")
    packet = bytearray(known.encode(drawn("paxini", 1)))
    packet[13], packet[-1] = 1, (packet[-1] - 1) & 0xFF
    assert len(known.decoder().feed(bytes(packet))) == 1


def test_between_static_taxels_the_dynamic_peak_is_kept() -> None:
    known = spoken("robotiq-tsf85")
    dynamic = [bytes.fromhex(f"9a 00 58 03 20 {value}") for value in ("0010", "ff00", "0005")]
    decoder = known.decoder()
    static = bytes.fromhex("9a 00 58 39 10") + bytes(56)
    got = decoder.feed(b"".join(dynamic) + static)
    (scan,) = got + decoder.flush()
    assert scan.extras == {"device_dynamic": 5.0, "device_dynamic_peak": 256.0}


@pytest.mark.parametrize("name", FORMS)
@pytest.mark.parametrize("size", [1, 7, 8192])
def test_decode_inverts_encode_in_any_chunks(name: str, size: int) -> None:
    known = spoken(name)
    decoder, sent, got = known.decoder(), [drawn(name, n) for n in range(6)], []
    if name == "velostat":  # an answer ends where nothing more comes
        got = [scan for one in sent for part in chunks(known.encode(one), size)
               for scan in decoder.feed(part)]  # fmt: skip
    else:
        got = [s for c in chunks(b"".join(map(known.encode, sent)), size) for s in decoder.feed(c)]
    got += decoder.flush()
    assert len(got) == 6
    assert all(map(same, sent, got))
    assert (decoder.bad, decoder.discarded, decoder.resyncs) == (0, 0, 0)
    if sent[5].sequence_wrap and got[5].sequence is not None:
        assert [scan.sequence for scan in got] == list(range(6))


@pytest.mark.parametrize("name", [name for name in FORMS if name not in UNCHECKED])
@pytest.mark.parametrize("size", [1, 7, 8192])
def test_noise_between_packets_costs_none(name: str, size: int) -> None:
    known, rng = spoken(name), random.Random(4)
    sent = [drawn(name, n) for n in range(12)]
    data = b"".join(noise(rng, name) + known.encode(scan) for scan in sent)
    decoder = known.decoder()
    got = [scan for part in chunks(data, size) for scan in decoder.feed(part)] + decoder.flush()
    assert len(got) == 12
    assert all(map(same, sent, got))
    assert decoder.resyncs >= 1


@pytest.mark.parametrize("name", sorted(UNCHECKED - {"velostat"}))
def test_without_a_check_noise_costs_the_packet_before_it_at_most(name: str) -> None:
    known, rng, kept = spoken(name), random.Random(5), 0
    decoder = known.decoder()
    for burst in range(10):
        sent = [drawn(name, 4 * burst + n) for n in range(4)]
        data = noise(rng, name) + b"".join(map(known.encode, sent))
        got = decoder.feed(data)
        kept += sum(any(same(one, other) for other in got) for one in sent)
    assert kept + len(decoder.flush()) >= 30


@pytest.mark.parametrize("name", [name for name in FORMS if name != "velostat"])
def test_a_cut_packet_costs_itself_only(name: str) -> None:
    known = spoken(name)
    sent = [drawn(name, n) for n in range(8)]
    cut = known.encode(sent[3])[: len(known.encode(sent[3])) // 2]
    if name in {"xela", "anyskin-text"}:
        cut += b"\n"  # lines: a cut one that runs into the next spoils it too
    elif name == "3d-vitac":
        cut += b"\n\n"
    parts = [cut if n == 3 else known.encode(scan) for n, scan in enumerate(sent)]
    decoder = known.decoder()
    got = decoder.feed(b"".join(parts)) + decoder.flush()
    for scan in (*sent[:3], *sent[4:]):
        assert any(same(scan, other) for other in got), scan.sequence
    assert decoder.discarded >= len(cut)


def test_an_end_marker_in_the_numbers_does_no_harm() -> None:
    known = spoken("pts2")
    sent = drawn("pts2", 1)
    values = np.array(sent.values)
    values[1, 2] = np.frombuffer(bytes.fromhex("aabbccdd" * 6), "<f4")
    scan = Scan(values, sent.channels, "N", 1, 2000)
    got = known.decoder().feed(known.encode(scan) * 3)
    assert len(got) == 3
    assert all(same(scan, other) for other in got)


def test_a_header_in_the_taxels_does_no_harm() -> None:
    known = spoken("flexitac")
    scan = Scan(np.tile([0xAA, 0x55], 192).reshape(12, 32, 1).astype(float), ("normal",), "count")
    decoder = known.decoder()
    got = [one for part in chunks(known.encode(scan) * 5, 7) for one in decoder.feed(part)]
    assert len(got) + len(decoder.flush()) == 5
    assert decoder.discarded == 0


@pytest.mark.parametrize("begun", range(1, 5))
def test_a_header_that_is_cut_by_a_chunk_keeps_its_packet(begun: int) -> None:
    """A damaged packet that chance makes pass with the next one's first bytes gives way to it."""
    known = spoken("paxini-board")
    good = [known.encode(drawn("paxini-board", n, seed=7)) for n in range(4)]
    damaged = bytearray(good[0][:-begun])
    damaged[20] = (damaged[20] - sum(damaged) - sum(good[1][:begun])) % 256
    decoder, stream = known.decoder(), b"".join(good[1:])
    got = decoder.feed(bytes(damaged)) + decoder.feed(stream[:begun])
    got += decoder.feed(stream[begun:]) + decoder.flush()
    alone = [decoder.feed(packet) + decoder.flush() for packet in good[1:]]
    came = [scan.values.tobytes() for scan in got]
    assert came == [scan.values.tobytes() for (scan,) in alone]


def test_a_descriptor_of_your_own_is_read(tmp_path: Path) -> None:
    path = tmp_path / "mat.toml"
    path.write_text(
        'name = "mat"\nshape = [2, 3]\nchannels = ["x", "y", "z"]\nplanes = true\n'
        'header = "5a 01"\n'
        'cell = "i16"\nbyte_order = "big"\ncounter = "u16"\ntime = "u32"\ntime_unit = "ms"\n'
        'check = "crc16-modbus"\nscale = 0.5\nunit = "N"\ntail = "0a"\n'
    )
    known = described_wire(path, Asked())
    values = np.arange(18.0).reshape(2, 3, 3) / 2
    data = known.encode(Scan(values, ("shear_x", "shear_y", "normal"), "N", 513, 77_000))
    assert data[:8] == bytes.fromhex("5a01 0201 0000004d")
    assert data[8:14] == bytes.fromhex("0000 0003 0006")  # all taxels of x come first
    (scan,) = known.decoder().feed(data)
    np.testing.assert_array_equal(scan.values, values)
    assert (scan.sequence, scan.time_us, scan.unit) == (513, 77_000, "N")


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ('header = "xy"', "'header' must be bytes in hexadecimal"),
        ('check = "md5"', "'check' must be 'none' or one of"),
        ("shape = [0, 4]", "'shape' must be rows and columns"),
        ('colour = "red"', "Unknown option 'colour'"),
        ('name = "x"', "'header' must be given"),
    ],
)
def test_a_wrong_descriptor_is_named(tmp_path: Path, line: str, sentence: str) -> None:
    path = tmp_path / "wrong.toml"
    lines = {"name": 'name = "m"', "shape": "shape = [4, 4]", "header": 'header = "aa"'}
    key = line.split(" =")[0]
    if sentence.startswith("'header' must be given"):
        del lines["header"]
    path.write_text("\n".join({**lines, key: line}.values()))
    with pytest.raises(SceneError, match=r"wrong\.toml") as caught:
        described_wire(path, Asked())
    assert sentence in str(caught.value)


def test_what_a_protocol_cannot_carry_is_refused() -> None:
    for name in sorted(set(FORMS) - {"open", "pts2"}):
        with pytest.raises(CodecError):
            spoken(name).encode(Scan(np.zeros((2, 9, 2)), ("a", "b"), "N"))


def test_unknown_names_and_rates_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'xela'"):
        wire("xella")
    with pytest.raises(SceneError, match="one of"):
        wire("pts2", Asked(rate=333))
    with pytest.raises(CnnumError, match="'address' must be a finger"):
        wire("robotiq-tsf85", Asked(address=9))
    assert wire("pts2", Asked(rate=500, bias=True)).greeting == b"f500\n"
    assert {name for name in FORMS if spoken(name).request} == ASKED


def test_checks_have_their_published_values() -> None:
    known = {"crc8": 0xF4, "crc16-modbus": 0x4B37, "crc16-ccitt": 0x29B1, "crc32": 0xCBF43926}
    for name, value in known.items():
        assert CHECKS[name][1](b"123456789") == value
    assert (sum(b"123456789") + CHECKS["lrc8"][1](b"123456789")) % 256 == 0
