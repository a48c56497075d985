"""Frames of a fixed-point program on an OpenCL device, one work item per stream.

The kernel comes from the same records and printer as C99.
"""

from collections.abc import Callable, Mapping

import numpy as np
import pyopencl as cl

from cnnum.embedded.c.files import identifier, structures
from cnnum.embedded.c.text import CText, c_text, packed, record_type, table_lines, unpacked
from cnnum.embedded.emulator import Numbers
from cnnum.embedded.program import IntegerProgram
from cnnum.engines.devices.child import build_failure, run_failure
from cnnum.engines.devices.program_cache import build_program, make_kernel
from cnnum.engines.devices.selection import choose_device
from cnnum.engines.forks import refuse_after_fork

KERNEL = "frames"

TYPES = {
    "int8_t": "char",
    "uint8_t": "uchar",
    "int16_t": "short",
    "int32_t": "int",
    "uint32_t": "uint",
    "int64_t": "long",
    "uint64_t": "ulong",
}
"""Names of C99, in the words of OpenCL C."""


def opened(device: str | None) -> tuple[str, "Callable[[IntegerProgram], DeviceFrames]", int]:
    """Return a description of the device, a function that makes a program's runner, and launches.

    Raises
    ------
    DeviceError
        If there is no such device.
    NoOpenCLError
        If none works.
    """
    chosen = choose_device(device)
    queue = cl.CommandQueue(cl.Context([chosen.handle]))
    return chosen.label, lambda program: DeviceFrames(program, queue), 1


class DeviceFrames:
    """Runs frames of a program.

    Parameters
    ----------
    program : IntegerProgram
        Of whole numbers.
    queue : CommandQueue

    Raises
    ------
    NotSupportedError
        If the device's compiler rejects the kernel.
    """

    def __init__(self, program: IntegerProgram, queue: cl.CommandQueue) -> None:
        refuse_after_fork()
        self._queue, self._parts = queue, c_text(program)
        self._inputs, self._outputs = program.of_kind("input"), program.of_kind("output")
        self.source = kernel_text(program, self._parts)
        try:
            built = build_program(queue.context, self.source, ["-w"])
            self._kernel = make_kernel(built, KERNEL)
        except cl.Error as error:
            raise build_failure(self.source, error, queue.device) from error

    def run(
        self,
        inputs: Mapping[str, Numbers],
        state: dict[str, Numbers],
        *,
        first: bool,
        batch: int = 1,
    ) -> dict[str, Numbers]:
        """Run one frame of every stream and update the state, as the emulator does.

        Parameters
        ----------
        inputs : mapping of str to (batch, cells) int
        state : mapping of str to (batch, length) int
        first : bool
        batch : int
            Number of streams, for a program that reads no channel and has no memory.

        Returns
        -------
        dict of str to (batch, length) int
            By the arrays of the outputs.

        Raises
        ------
        DeviceError
            If the device does not complete the run.
        """
        refuse_after_fork()
        batch = max([batch, *(len(part) for part in (*inputs.values(), *state.values()))])
        given = packed(self._inputs, inputs, batch)
        memory = packed(self._parts.memory, state, batch, memory=True)
        answers = np.zeros(batch, dtype=record_type(self._outputs))
        try:
            self._launch(given, answers, memory, first=first)
        except cl.Error as error:
            raise run_failure(error, self._queue) from error
        kept = unpacked([part for part in self._parts.memory if part.name in state], memory)
        state.update(kept)
        return unpacked(self._outputs, answers)

    def _launch(self, given: Numbers, answers: Numbers, memory: Numbers, *, first: bool) -> None:
        queue, flags = self._queue, cl.mem_flags
        copied = flags.COPY_HOST_PTR
        buffers = [
            cl.Buffer(queue.context, flags.READ_ONLY | copied, hostbuf=given),
            cl.Buffer(queue.context, flags.READ_WRITE | copied, hostbuf=answers),
            cl.Buffer(queue.context, flags.READ_WRITE | copied, hostbuf=memory),
        ]
        self._kernel(queue, (len(given),), None, *buffers, np.int32(first))
        cl.enqueue_copy(queue, answers, buffers[1])
        cl.enqueue_copy(queue, memory, buffers[2])
        queue.finish()


def kernel_text(program: IntegerProgram, text: CText) -> str:
    """Return the text of a kernel that runs one frame of each stream.

    Parameters
    ----------
    program : IntegerProgram
        Program in whole numbers.
    text : CText
        Its parts.
    """
    name = identifier(program.name)
    inputs, outputs = program.of_kind("input"), program.of_kind("output")
    lines = [
        *(f"typedef {known} {wanted};" for wanted, known in TYPES.items()),
        "#define INT64_C(x) x##L",
        "",
        *structures(name, text.memory, inputs, outputs),
        "",
        *(line for helper in text.helpers for line in (helper.replace("static ", "", 1), "")),
        *(line for table in text.tables for line in (*table_lines(table, "__constant"), "")),
        f"__kernel void {KERNEL}(__global const {name}_input *inputs,",
        f"    __global {name}_output *outputs, __global {name}_memory *memories, int32_t first)",
        "{",
        "    const size_t lane = get_global_id(0);",
        f"    __global const {name}_input *in = inputs + lane;",
        f"    __global {name}_output *out = outputs + lane;",
        f"    __global {name}_memory *m = memories + lane;",
        *text.body,
        "}",
    ]
    return "\n".join([*lines, ""])
