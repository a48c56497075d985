"""A repair of the PoCL wheel, for processors that are newer than its compiler.

The wheel's PoCL 3.0 holds LLVM 14, which names no processor newer than itself: AMD's family 26 is
"generic" to it. PoCL passes that name to its compiler after all options of a user, and the compiler
refuses every kernel: "unknown target CPU 'generic'". AMD's Zen 4 is "znver3" to it, the newest of
its kind that it names: without AVX-512. PoCL then asks for its vectors of 16 all the same, and the
compiler ends the process. PoCL has a remedy of its own, the variable POCL_LLVM_CPU_NAME, from
version 5.0 on; the wheel ends with 3.0.

PoCL's record of a device, at the address that PyOpenCL gives as `Device.int_ptr`, holds a pointer
to the name. The repair points it at a name that LLVM 14 knows, before the first kernel is built. It
is made for this exact build alone. It is used only after a child process has shown that the
repaired device works (`self_test.py`).
"""

import ctypes
from pathlib import Path

import pyopencl as cl

from cnnum.engines.processor import Processor, processor

BUILD = "OpenCL 3.0 PoCL 3.0-rc2  Linux, Release, RELOC, LLVM 14.0.6, SLEEF, DISTRO, POCL_DEBUG"
"""Version of the wheel's platform."""

LIBRARY = "libpocl-21062cec.so"
"""The wheel's library; the digits are a checksum of its content."""

UNKNOWN, NARROWER = "generic", "znver3"
"""Names that LLVM 14 gives to newer processors: to any, and to those of AMD with AVX-512."""

TRIPLE_AT, TRIPLE = 632, b"x86_64-unknown-linux-gnu"
"""Byte of the record that points to the compiler's target: it shows that the record is as known."""

NAME_AT = 640
"""Byte of the record that points to the processor's name."""

AVX2 = frozenset({"abm", "avx2", "bmi1", "bmi2", "f16c", "fma", "movbe", "popcnt"})
AVX512 = AVX2 | {"adx", "aes", "avx512bw", "avx512cd", "avx512dq", "avx512f", "avx512vl"}
TARGETS = {"skylake-avx512": AVX512, "haswell": AVX2}
"""Names that LLVM 14 knows, the fastest first, with the instructions that each may use.

RDSEED is not among them, for no compiler takes it unasked: Linux turns it off on Zen 5, where it is
faulty. With "haswell" such a processor would still be asked for vectors of 16, and fail.
"""

_NAMES = {name: ctypes.create_string_buffer(name.encode()) for name in (*TARGETS, UNKNOWN)}
"""Memory that records point to: it lives as long as the process."""


def remedy_for(device: cl.Device) -> str | None:
    """Return the name that a device of the wheel should have; None where its own is right."""
    if not is_wheel(device):
        return None
    return target_for(_string(device, NAME_AT).decode(), processor())


def target_for(name: str, of: Processor) -> str | None:
    """Return the name for a processor that LLVM 14 knows by one; None where that is right."""
    wider = name == NARROWER and of.flags >= AVX512
    return best_target(of) if name == UNKNOWN or wider else None


def best_target(of: Processor) -> str | None:
    """Return the fastest target whose instructions a processor has."""
    return next((name for name, needs in TARGETS.items() if needs <= of.flags), None)


def is_wheel(device: cl.Device) -> bool:
    """Return whether a device is of the exact build that the repair is made for."""
    if str(device.platform.version) != BUILD:
        return False
    try:
        maps = Path("/proc/self/maps").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    return LIBRARY in maps and _string(device, TRIPLE_AT) == TRIPLE


def rename_target(device: cl.Device, name: str) -> None:
    """Let PoCL compile for the processor of that name; only where `is_wheel` holds."""
    pointer = ctypes.addressof(_NAMES[name])
    ctypes.c_void_p.from_address(int(device.int_ptr) + NAME_AT).value = pointer


def _string(device: cl.Device, at: int) -> bytes:
    """Return the text that a pointer in the record of a device points to."""
    return ctypes.c_char_p.from_address(int(device.int_ptr) + at).value or b""
