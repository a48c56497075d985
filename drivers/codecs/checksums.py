"""Checks over the bytes of a packet, by the names that a descriptor gives them."""

import binascii
import zlib
from collections.abc import Callable, Mapping

Check = tuple[int, Callable[[bytes], int]]
"""Bytes of a check, and its value over the bytes before it."""


def crc16_modbus(data: bytes) -> int:
    """Return the CRC-16/MODBUS: 0x8005 reflected, start 0xFFFF; 0x4B37 of ``123456789``."""
    rest = 0xFFFF
    for byte in data:
        rest ^= byte
        for _ in range(8):
            rest = rest >> 1 ^ 0xA001 if rest & 1 else rest >> 1
    return rest


def crc8(data: bytes) -> int:
    """Return the CRC-8/SMBUS: polynomial 0x07, start 0; 0xF4 of ``123456789``."""
    rest = 0
    for byte in data:
        rest ^= byte
        for _ in range(8):
            rest = (rest << 1 ^ 0x07 if rest & 0x80 else rest << 1) & 0xFF
    return rest


def xor8(data: bytes) -> int:
    """Return the exclusive-or of all bytes."""
    rest = 0
    for byte in data:
        rest ^= byte
    return rest


CHECKS: Mapping[str, Check] = {
    "sum8": (1, lambda data: sum(data) & 0xFF),
    "sum16": (2, lambda data: sum(data) & 0xFFFF),
    "lrc8": (1, lambda data: -sum(data) & 0xFF),
    "xor8": (1, xor8),
    "crc8": (1, crc8),
    "crc16-modbus": (2, crc16_modbus),
    "crc16-ccitt": (2, lambda data: binascii.crc_hqx(data, 0xFFFF)),
    "crc32": (4, zlib.crc32),
}
"""By name; `lrc8` makes the sum of all bytes 0."""
