"""A program as OpenCL C, from the same records and printer as C99, one work item per frame."""

from cnnum.embedded.c.files import identifier, structures
from cnnum.embedded.c.text import CText, table_lines
from cnnum.embedded.program import IntegerProgram

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
