"""The same C built by GCC for Arm and run by QEMU: a second compiler and a second count.

Both are optional tools of the machine. QEMU's clock moves on by 1 ns per instruction
(`-icount shift=0`), and the core's own timer reads it: counts are known to `TICK` instructions.
"""

import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cnnum.arrays import Floats
from cnnum.embedded.c.files import identifier
from cnnum.embedded.c.text import packed
from cnnum.embedded.emulator import cleared
from cnnum.embedded.making import Made
from cnnum.errors import DeviceError, NotSupportedError
from cnnum.lab.embedded.cortex_m import CORES
from cnnum.safety.files import write_whole

TEXT = r"""
#include <stddef.h>
#include <stdint.h>
#include "@name.h"

#define FRAMES @frames
static const uint8_t frames[FRAMES][sizeof(@name_input)] __attribute__((aligned(4))) = {
@inputs
};
static const uint8_t answers[FRAMES][sizeof(@name_output)] __attribute__((aligned(4))) = {
@outputs
};
static @name_memory memory;
static @name_input input;
static @name_output output;

/* the compiler may ask for these; volatile keeps it from calling them in themselves */
void *memset(void *to, int value, size_t count);
void *memcpy(void *to, const void *from, size_t count);
void *memset(void *to, int value, size_t count) {
    volatile uint8_t *byte = to;
    while (count--) *byte++ = (uint8_t)value;
    return to;
}
void *memcpy(void *to, const void *from, size_t count) {
    volatile uint8_t *byte = to;
    const uint8_t *source = from;
    while (count--) *byte++ = *source++;
    return to;
}

static void call_host(int operation, const void *argument) {
    register int r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
}

static char *hexadecimal(char *at, uint32_t number) {
    for (int shift = 28; shift >= 0; shift -= 4) *at++ = "0123456789abcdef"[(number >> shift) & 15];
    return at;
}

#define SYSTICK ((volatile uint32_t *)0xE000E010)

void start(void);
void start(void) {
    SYSTICK[1] = 0xFFFFFF;
    @name_reset(&memory);
    for (int n = 0; n < FRAMES; n++) {
        char line[20], *at;
        int wrong = 0;
        memcpy(&input, frames[n], sizeof input);
        memset(&output, 0, sizeof output);
        SYSTICK[0] = 0;
        SYSTICK[2] = 0;
        SYSTICK[0] = 5;
        uint32_t before = SYSTICK[2];
        @name_step(&memory, &input, &output);
        uint32_t ticks = (before - SYSTICK[2]) & 0xFFFFFF;
        for (size_t i = 0; i < sizeof output; i++)
            wrong |= ((const uint8_t *)&output)[i] != answers[n][i];
        at = hexadecimal(line, ticks);
        *at++ = ' ';
        at = hexadecimal(at, (uint32_t)wrong);
        *at++ = '\n';
        *at = 0;
        call_host(4, line);
    }
    call_host(0x18, (const void *)0x20026);
    for (;;) {}
}

static void fault(void) {
    call_host(4, "fault\n");
    call_host(0x18, (const void *)0x20023);
    for (;;) {}
}

__attribute__((section(".vectors"), used)) const uintptr_t vectors[4] = {
    @stack, (uintptr_t)start, (uintptr_t)fault, (uintptr_t)fault,
};
"""


def firmware(name: str, inputs: Sequence[bytes], outputs: Sequence[bytes], stack: int) -> str:
    """Return the text of the firmware.

    Parameters
    ----------
    name : str
        Name of the program's functions.
    inputs, outputs : sequence of bytes
        The structures of each frame and of its answer.
    stack : int
        Address at which the stack begins.
    """
    values = {
        "@name": name,
        "@frames": str(len(inputs)),
        "@inputs": _rows(inputs),
        "@outputs": _rows(outputs),
        "@stack": hex(stack),
    }
    text = TEXT.lstrip()
    for key, value in values.items():
        text = text.replace(key, value)
    return text


def _rows(some: Sequence[bytes]) -> str:
    return ",\n".join("{" + ",".join(str(byte) for byte in row) + "}" for row in some)


COMPILER, SIZE, EMULATOR = "arm-none-eabi-gcc", "arm-none-eabi-size", "qemu-system-arm"

MACHINES = {"m0": ("microbit", 62.5), "m4": ("mps2-an386", 40.0), "m7": ("mps2-an500", 40.0)}
"""QEMU's machine of a core, and the nanoseconds of a tick of its timer."""

STACK_TOP = {"m0": 0x20004000, "m4": 0x20100000, "m7": 0x20100000}

FLAGS = (
    "-O2", "-std=c99", "-ffp-contract=off", "-ffunction-sections", "-fdata-sections",
    "-mthumb", "-ffreestanding", "-nostdlib", "-nostartfiles",
)  # fmt: skip
PLACES = (
    "-Wl,-e,start", "-Wl,-u,vectors", "-Wl,--gc-sections", "-Wl,--build-id=none",
    "-Wl,--section-start=.vectors=0", "-Wl,-Ttext=0x100", "-Wl,-Tdata=0x20000000",
)  # fmt: skip
SECONDS = 120.0


@dataclass(frozen=True, slots=True)
class GnuCounted:
    """The cost of frames by GCC and QEMU.

    Attributes
    ----------
    core : str
    instructions : tuple of int
        Of each frame, to the tick.
    flash_bytes : int
        Code and tables of the program alone.
    wrong : int
        Frames whose answers differ from the emulator's in any bit.
    """

    core: str
    instructions: tuple[int, ...]
    flash_bytes: int
    wrong: int


def missing_gnu_tools() -> tuple[str, ...]:
    """Return which of the tools the machine lacks."""
    return tuple(name for name in (COMPILER, SIZE, EMULATOR) if shutil.which(name) is None)


def gnu_counted(made: Made, frames: Floats, core: str) -> GnuCounted:
    """Return the cost of frames of one stream.

    Parameters
    ----------
    made : Made
        In whole numbers.
    frames : (frames, rows, cols, channels) float
    core : str

    Raises
    ------
    NotSupportedError
        If the program is of reals, which would need a library of mathematics.
    DeviceError
        If the compiler refuses the program, or QEMU does not end.
    """
    if not made.precision.integer:
        raise NotSupportedError(
            "GCC for Arm builds programs in whole numbers here: take precision 'q15'."
        )
    name = identifier(made.program.name)
    machine, tick = MACHINES[core]
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        made.export(frames[:1]).write(place)
        write_whole(place / "firmware.c", firmware(name, *_vectors(made, frames), STACK_TOP[core]))
        cpu = f"-mcpu={CORES[core].replace('_', '-')}"
        _run([COMPILER, cpu, *FLAGS, "-c", f"{name}.c"], place)
        _run([COMPILER, cpu, *FLAGS, *PLACES, "-o", "firmware.elf", "firmware.c", f"{name}.o",
              "-lgcc"], place)  # fmt: skip
        sizes = _run([SIZE, f"{name}.o"], place).split("\n")[1].split()
        said = _run(
            [EMULATOR, "-M", machine, "-nographic", "-monitor", "none", "-serial", "none",
             "-icount", "shift=0", "-semihosting-config", "enable=on,target=native",
             "-kernel", "firmware.elf"],
            place,
        )  # fmt: skip
    rows = [
        [int(number, 16) for number in line.split()] for line in said.splitlines() if line.strip()
    ]
    if len(rows) != len(frames):
        raise DeviceError(f"QEMU's {machine} gave {len(rows)} of {len(frames)} frames.")
    counts = tuple(round(ticks * tick) for ticks, _ in rows)
    return GnuCounted(core, counts, int(sizes[0]), sum(wrong for _, wrong in rows))


def _vectors(made: Made, frames: Floats) -> tuple[list[bytes], list[bytes]]:
    """Return the bytes of each frame and of its answer."""
    program, state = made.program, cleared(made.program, 1)
    inputs, outputs = program.of_kind("input"), program.of_kind("output")
    given, wanted = list[bytes](), list[bytes]()
    for number, frame in enumerate(frames):
        numbers = made.inputs(frame[np.newaxis])
        given.append(packed(inputs, numbers, 1).tobytes())
        answer = made.emulator().run(numbers, state, first=number == 0)
        wanted.append(packed(outputs, answer, 1).tobytes())
    return given, wanted


def _run(command: Sequence[str], place: Path) -> str:
    try:
        done = subprocess.run(
            command, cwd=place, capture_output=True, text=True, check=False, timeout=SECONDS
        )
    except subprocess.TimeoutExpired:
        raise DeviceError(f"'{command[0]}' has not ended after {SECONDS:g} s.") from None
    if done.returncode:
        raise DeviceError(f"'{command[0]}' failed: {done.stderr:.400}")
    # the console of semihosting is standard error
    return done.stdout + done.stderr
