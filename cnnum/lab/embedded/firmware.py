"""A program's firmware for QEMU: it runs frames, reads the core's timer, and prints by semihosting.

SysTick is that of the ARMv6-M and ARMv7-M Architecture Reference Manuals. Semihosting is that of
Arm's "Semihosting for AArch32 and AArch64".
"""

from collections.abc import Sequence

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
        Of the program's functions.
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
    return ",\n".join("{" + ",".join(str(byte) for byte in one) + "}" for one in some)
