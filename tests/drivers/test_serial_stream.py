"""The stream: any chunks, any damage, and nothing lost that is not counted."""

import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cnnum.drivers.codecs.wire import scan_of
from cnnum.drivers.serial_packet import HEADER, MARKER, Geometry, Packet, StreamDecoder, encode
from cnnum.drivers.timing import FrameClock

SHAPE = Geometry(2, 3, 3, cell=3, layout=2)
SIZE = SHAPE.packet


def packet(sequence: int, payload: bytes = b"") -> Packet:
    rng = np.random.default_rng(sequence)
    cells = rng.integers(0, 65536, (2, 3, 3), dtype=np.uint16).astype("<u2")
    if payload:
        cells = np.frombuffer(payload.ljust(SHAPE.payload, b"\0"), "<u2").reshape(2, 3, 3)
    return Packet(SHAPE, cells, sequence % 2**32, 5000 * sequence, 5000)


def stream(count: int, first: int = 0) -> bytes:
    return b"".join(encode(packet(first + n)) for n in range(count))


def decode_all(data: bytes, chunk: int, decoder: StreamDecoder) -> list[bytes]:
    parts = [data[at : at + chunk] for at in range(0, len(data), chunk)]
    found = [p for part in parts for p in decoder.feed(part)]
    return [encode(p) for p in [*found, *decoder.flush()]]


@pytest.mark.parametrize("chunk", [1, 7, 8192])
def test_any_chunks_give_the_same_packets(chunk: int) -> None:
    decoder = StreamDecoder()
    assert b"".join(decode_all(stream(20), chunk, decoder)) == stream(20)
    assert (decoder.good, decoder.bad, decoder.discarded, decoder.resyncs) == (20, 0, 0, 0)


@pytest.mark.parametrize("chunk", [1, 7, 8192])
def test_a_marker_in_the_payload_does_no_harm(chunk: int) -> None:
    inside = encode(packet(3, MARKER + b"\1\2\3\3" + MARKER))
    decoder = StreamDecoder()
    assert decode_all(inside * 5, chunk, decoder) == [inside] * 5
    assert decoder.discarded == 0


@pytest.mark.parametrize("cut", [1, HEADER.size - 1, HEADER.size, HEADER.size + 1, SIZE - 1])
@pytest.mark.parametrize("chunk", [1, 7, 8192])
def test_a_cut_packet_costs_itself_only(cut: int, chunk: int) -> None:
    decoder = StreamDecoder()
    data = stream(3) + encode(packet(3))[:cut] + stream(4, first=4)
    assert b"".join(decode_all(data, chunk, decoder)) == stream(3) + stream(4, first=4)
    assert (decoder.discarded, decoder.resyncs) == (cut, 1)
    assert decoder.bad == (cut >= HEADER.size)


@pytest.mark.parametrize("chunk", [1, 7, 8192])
def test_a_packet_inside_a_failed_one_is_found(chunk: int) -> None:
    # The payload of the damaged packet holds the beginning of a whole one: bytes were lost.
    decoder = StreamDecoder()
    damaged = encode(packet(1))[: HEADER.size + 3]
    data = damaged + stream(2, first=2)
    assert b"".join(decode_all(data, chunk, decoder)) == stream(2, first=2)
    assert decoder.bad == 1


def test_another_geometry_is_not_believed() -> None:
    other = Geometry(1, 1, 1, cell=1)
    stranger = encode(Packet(other, np.zeros((1, 1, 1), "<u1"), 0, 0))
    decoder = StreamDecoder()
    assert (
        b"".join(decode_all(stream(1) + stranger + stream(1), 7, decoder)) == stream(2)[:SIZE] * 2
    )
    assert decoder.discarded == len(stranger)


damages = st.lists(
    st.tuples(
        st.sampled_from(["flip", "cut", "insert"]), st.integers(0, 10**6), st.binary(max_size=40)
    ),
    max_size=8,
)


def damage(data: bytes, damages: list[tuple[str, int, bytes]]) -> bytes:
    hurt = bytearray(data)
    for kind, place, junk in damages:
        at = place % max(1, len(hurt))
        if kind == "insert":
            hurt[at:at] = junk
        elif kind == "cut":
            del hurt[at : at + len(junk)]
        else:
            for n, byte in enumerate(junk[: len(hurt) - at]):
                hurt[at + n] ^= byte
    return bytes(hurt)


@given(damages, st.sampled_from([1, 7, 64, 8192]))
def test_damage_gives_no_wrong_packet_and_is_always_overcome(
    hurts: list[tuple[str, int, bytes]], chunk: int
) -> None:
    sent = [encode(packet(n)) for n in range(12)]
    tail = [encode(packet(n)) for n in range(12, 17)]
    data = damage(b"".join(sent), hurts) + b"".join(tail)
    decoder = StreamDecoder(SHAPE)
    found = decode_all(data, chunk, decoder)
    assert set(found) <= set(sent + tail)
    assert found[-len(tail) :] == tail
    # every byte is either in a packet handed on or counted as discarded
    assert len(found) * SIZE + decoder.discarded == len(data)
    assert decoder.pending == 0


@given(damages)
def test_the_chunks_do_not_matter_for_what_is_found(hurts: list[tuple[str, int, bytes]]) -> None:
    data = damage(stream(10), hurts)
    decoders = [StreamDecoder(SHAPE) for _ in range(3)]
    found = [decode_all(data, c, d) for c, d in zip((1, 7, 8192), decoders, strict=True)]
    assert found[0] == found[1] == found[2]
    counts = [(d.good, d.bad, d.discarded, d.resyncs) for d in decoders]
    assert counts[0] == counts[1] == counts[2]


@given(st.integers(0, 2**32 - 1), st.lists(st.booleans(), min_size=2, max_size=40))
def test_handed_on_and_dropped_add_up_over_the_wrap(first: int, kept: list[bool]) -> None:
    kept = [True, *kept, True]
    clock = FrameClock()
    sent = [packet(n) for n, keep in enumerate(kept) if keep]
    numbered = [
        Packet(p.geometry, p.values, (first + p.sequence) % 2**32, p.time_us, 5000) for p in sent
    ]
    frames = [clock.frame(scan_of(p)) for p in numbered]
    assert len(frames) + clock.dropped == len(kept)
    assert (clock.repeated, clock.gaps) == (0, 0)
    assert [f.sequence - frames[0].sequence for f in frames] == [p.sequence for p in sent]
    np.testing.assert_allclose([f.time for f in frames], [p.time_us * 1e-6 for p in sent], atol=0)


def test_repeats_and_restarts_are_distinguished() -> None:
    clock = FrameClock()
    sequence = [10, 11, 11, 14, 2, 3]
    frames = [
        clock.frame(scan_of(Packet(SHAPE, packet(0).values, n, 5000 * n, 5000))) for n in sequence
    ]
    assert [int(f.quality) for f in frames] == [0, 0, 2, 1, 1, 0]
    assert [f.sequence for f in frames] == [10, 11, 11, 14, 15, 16]
    assert (clock.dropped, clock.repeated, clock.gaps) == (2, 1, 1)
    times = [f.time for f in frames]
    # after the restart the clock goes on by one period of 5 ms
    np.testing.assert_allclose(times, [0, 0.005, 0.005, 0.02, 0.025, 0.03], rtol=1e-12)


def test_noise_alone_gives_nothing_and_is_given_up() -> None:
    noise = random.Random(5).randbytes(20_000)
    decoder = StreamDecoder()
    assert decode_all(noise, 64, decoder) == []
    assert decoder.discarded == len(noise)
