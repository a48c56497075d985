"""Bytes written by hand from the published layouts, and the numbers that stand in them."""

import pytest

from cnnum.drivers.codecs.stream import Scan
from cnnum.drivers.codecs.wire import Asked, wire


def decoded(name: str, data: bytes, **asked: object) -> list[Scan]:
    decoder = wire(name, Asked(**asked)).decoder()  # type: ignore[arg-type]
    scans = decoder.feed(data) + decoder.flush()
    assert (decoder.bad, decoder.discarded) == (0, 0)
    return scans


def flat(scan: Scan) -> list[float]:
    return scan.values.ravel().tolist()


@pytest.mark.parametrize(
    ("name", "shape", "packet", "numbers"),
    [
        # AA 55, then one byte a taxel
        ("flexitac", (2, 3), "aa55 01 02 03 aa 55 ff", [1, 2, 3, 170, 85, 255]),
        # AA AB AC, big-endian counts, four bytes more
        ("m1616", (1, 3), "aaabac 0001 0200 ffff 00000000", [1, 512, 65_535]),
        # one byte a taxel, and nothing else
        ("velostat", (2, 2), "00 41 7f ff", [0, 65, 127, 255]),
        # AA, counter, big-endian counts, low byte of the sum
        ("m0404s", (1, 2), "aa 07 0102 0304 bb", [258, 772]),
        ("3d-vitac", (2, 3), b"0 1 2\n253 254 255\n\n".hex(), [0, 1, 2, 253, 254, 255]),
        ("anyskin-text", (1, 1), b"25.0 1.5 -2.0 300.0\r\n".hex(), [25, 1.5, -2, 300]),
    ],
)
def test_numbers_of_a_packet(
    name: str, shape: tuple[int, int], packet: str, numbers: list[float]
) -> None:
    (scan,) = decoded(name, bytes.fromhex(packet), shape=shape)
    assert flat(scan) == numbers
    assert scan.saturated == (name in {"flexitac", "velostat", "3d-vitac"})


def test_an_answer_of_paxinis_converter() -> None:
    # aa 55, length 16, device 2, 0, fb, register 1038, 6 bytes, status; two taxels; sum 0
    packet = "aa55 1000 02 00 fb 0e040000 0600 00  0a fb 05  80 7f ff  d4"
    (scan,) = decoded("paxini", bytes.fromhex(packet), shape=(1, 2), address=2)
    assert flat(scan) == pytest.approx([1.0, -0.5, 0.5, -12.8, 12.7, 25.5])
    assert (scan.unit, scan.saturated) == ("N", True)


def test_a_packet_of_paxinis_board() -> None:
    # aa 56, 0, length 13, error; resultant by its low bytes; two taxels; sum 0
    packet = "aa56 00 0d00 00  0a00 f600 1400  01 02 03  ff fe 04  d8"
    (scan,) = decoded("paxini-board", bytes.fromhex(packet), shape=(1, 2))
    assert flat(scan) == pytest.approx([0.1, 0.2, 0.3, -0.1, -0.2, 0.4])
    assert not scan.saturated
    loads = [scan.extras[f"device_{axis}"] for axis in "xyz"]
    assert loads == pytest.approx([1.0, -1.0, 2.0])


TAXELS = b"".join(n.to_bytes(2, "big") for n in range(1000, 1028))


def finger(number: int, taxels: bytes, micros: int, dynamic: str = "ff00") -> bytes:
    own = number << 2
    return (
        bytes([0x10 | own]) + taxels
        + bytes([0x20 | own]) + bytes.fromhex(dynamic)
        + bytes([0x30 | own]) + bytes.fromhex("0001 fffe 4000")
        + bytes([0x70 | own]) + micros.to_bytes(8, "big")
    )  # fmt: skip


@pytest.mark.parametrize("command", ["58", "59", "61"])
def test_a_packet_of_robotiqs_firmware_since_1_1_7(command: str) -> None:
    """Both fingers in a packet of more than 60 bytes, a time of 64 bits in µs for each."""
    data = finger(0, TAXELS, 5) + finger(1, TAXELS[::-1], 0x01_0000_0203)
    packet = bytes.fromhex(f"9a 00 {command}") + bytes([len(data)]) + data
    assert len(packet) == 156
    (first,) = decoded("robotiq-tsf85", packet)
    assert first.values.shape == (7, 4, 1)
    assert flat(first) == list(range(1000, 1028))
    assert (first.time_us, first.time_wrap) == (5, 1 << 64)
    assert first.extras["device_dynamic"] == -256.0
    axes = [first.extras[f"device_acceleration_{axis}"] for axis in "xyz"]
    assert axes == [1.0, -2.0, 16_384.0]
    (second,) = decoded("robotiq-tsf85", packet, address=2)
    assert second.time_us == 0x01_0000_0203
    assert second.values[6, 3, 0] == int.from_bytes(TAXELS[1::-1], "big")


def test_packets_of_robotiqs_firmware_before() -> None:
    """Packets of 60 bytes at most, a time of 16 bits in ms."""
    packets = "9a005806 20 0010 70 fffe", f"9a005839 10 {TAXELS.hex()}"
    later = "9a005806 20 0010 70 0001", f"9a005839 10 {TAXELS.hex()}"
    first, second = decoded("robotiq-tsf85", bytes.fromhex("".join(packets + later)))
    assert flat(first) == list(range(1000, 1028))
    assert (first.time_us, first.time_wrap) == (65_534_000, 65_536_000)
    assert second.time_us == 1000


def test_robotiqs_hub_is_asked_to_send_and_to_stop() -> None:
    known = wire("robotiq-tsf85", Asked(rate=250.0))
    assert known.greeting == bytes.fromhex("9a 00 58 01 04")
    assert known.farewell == bytes.fromhex("9a 00 58 01 00")
