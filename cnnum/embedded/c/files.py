"""A program as a folder of C99 files: the program, a test vector, a stream, and a Makefile."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cnnum.embedded.c.layout import bytes_of
from cnnum.embedded.c.program import (
    c_text,
    element_type,
    literal,
    members,
    size_of,
    table_lines,
)
from cnnum.embedded.emulator import Emulator, Numbers, cleared
from cnnum.embedded.program import Array, IntegerProgram
from cnnum.embedded.ranges import range_lines
from cnnum.safety.files import write_files


@dataclass(frozen=True, slots=True, eq=False)
class Exported:
    """The files of a program by name, and its needs.

    Attributes
    ----------
    files : mapping of str to str
    memory_bytes, input_bytes, output_bytes, table_bytes : int
    """

    files: Mapping[str, str]
    memory_bytes: int
    input_bytes: int
    output_bytes: int
    table_bytes: int

    def write(self, folder: Path, *, force: bool = False) -> None:
        """Write the files into a folder, all or none.

        Raises
        ------
        ReportError
            If one is there that `force` does not say to replace, or cannot be written.
        """
        write_files(folder, self.files, force=force)


OTHERS = ("vector.c", "stream.c", "Makefile", "ranges.txt")
"""Files that have the same names in every export."""


def identifier(name: str) -> str:
    """Return a name that C allows."""
    return re.sub(r"\W", "_", name)


def in_the_way(folder: Path, program: str) -> str | None:
    """Return a file that an export would replace, though no export of this program wrote it."""
    name = identifier(program)
    there = [one for one in (f"{name}.c", f"{name}.h", *OTHERS) if (folder / one).exists()]
    makefile = folder / "Makefile"
    own = makefile.is_file() and _rule(name) in makefile.read_bytes().decode("utf-8", "replace")
    return there[0] if there and not own else None


def _rule(name: str) -> str:
    return f"vector: vector.c {name}.c {name}.h\n"


def exported(
    program: IntegerProgram, frames: Sequence[Mapping[str, Numbers]], about: Sequence[str]
) -> Exported:
    """Return a program's files.

    Parameters
    ----------
    program : IntegerProgram
    frames : sequence of mapping of str to (1, cells) int or float
        Inputs of the test vector, one stream.
    about : sequence of str
        Lines at the head of the program's own file.
    """
    name = identifier(program.name)
    text = c_text(program)
    inputs, outputs = program.of_kind("input"), program.of_kind("output")
    header = _header(name, program, text.memory, inputs, outputs, text.tables)
    source = [
        "/* " + "\n   ".join(line.replace("*/", "") for line in about) + " */",
        f'#include "{name}.h"',
        *(_LIBM if _real(program) else []),
        "",
        *(line for one in text.helpers for line in (one, "")),
        *(line for one in text.tables for line in (*table_lines(one, "static const"), "")),
        *reset_lines(name),
        "",
        f"void {name}_step({name}_memory *m, const {name}_input *in, {name}_output *out)",
        "{",
        "    const int32_t first = m->started ? 0 : 1;",
        "    (void)first;",
        *text.body,
        "    m->started = 1;",
        "}",
    ]
    files = {
        f"{name}.h": header,
        f"{name}.c": "\n".join([*source, ""]),
        "vector.c": _vector(name, program, frames),
        "stream.c": _stream(name),
        "Makefile": _makefile(name, math=_real(program)),
        "ranges.txt": "".join(f"{line}\n" for line in range_lines(program)),
    }
    return Exported(
        files,
        bytes_of(text.memory, memory=True),
        bytes_of(inputs),
        bytes_of(outputs),
        size_of(text.tables),
    )


_LIBM = ["/* of libm */", *(f"float {name}f(float);" for name in ("sqrt", "exp", "log"))]


def _real(program: IntegerProgram) -> bool:
    return any(one.format is None and not one.logic for one in program.of_kind("output")) or any(
        one.format is None and not one.logic for one in program.of_kind("input")
    )


def reset_lines(name: str, place: str = "") -> list[str]:
    """Return the function that clears the memory."""
    return [
        f"void {name}_reset({place}{name}_memory *m)",
        "{",
        f"    {place}uint8_t *bytes = ({place}uint8_t *)m;",
        "    for (uint32_t n = 0; n < (uint32_t)sizeof *m; ++n) {",
        "        bytes[n] = 0;",
        "    }",
        "}",
    ]


def structures(
    name: str, memory: Sequence[Array], inputs: Sequence[Array], outputs: Sequence[Array]
) -> list[str]:
    """Return the structures of inputs, outputs and memory."""
    nothing, kept = ["    uint8_t nothing;"], bytes_of(memory, memory=True)
    return [
        f"typedef struct {{ /* one frame: {bytes_of(inputs)} bytes */",
        *(members(inputs) or nothing),
        f"}} {name}_input;",
        "",
        f"typedef struct {{ /* its answers: {bytes_of(outputs)} bytes */",
        *(members(outputs) or nothing),
        f"}} {name}_output;",
        "",
        f"typedef struct {{ /* what is kept and worked in: {kept} bytes */",
        "    int32_t started;",
        *members(memory),
        f"}} {name}_memory;",
    ]


def _header(
    name: str,
    program: IntegerProgram,
    memory: Sequence[Array],
    inputs: Sequence[Array],
    outputs: Sequence[Array],
    tables: Sequence[Array],
) -> str:
    guard, (rows, cols) = f"{name.upper()}_H", program.shape
    fractions = [
        f"#define {name.upper()}_{one.name.upper()}_FRACTION {one.format.fraction}"
        for one in (*inputs, *outputs)
        if one.format is not None
    ]
    lines = [
        f"/* Program '{program.name}' on {rows} x {cols} cells.",
        f"   Memory {bytes_of(memory, memory=True)} bytes, frame {bytes_of(inputs)}, answers "
        f"{bytes_of(outputs)}, tables {size_of(tables)}. */",
        f"#ifndef {guard}",
        f"#define {guard}",
        "",
        "#include <stdint.h>",
        "",
        f"#define {name.upper()}_ROWS {rows}",
        f"#define {name.upper()}_COLS {cols}",
        "/* a whole number q stands for q times 2^-FRACTION */",
        *fractions,
        "",
        *structures(name, memory, inputs, outputs),
        "",
        "/* before the first frame of a stream */",
        f"void {name}_reset({name}_memory *m);",
        "",
        "/* one frame */",
        f"void {name}_step({name}_memory *m, const {name}_input *in, {name}_output *out);",
        "",
        "#endif",
        "",
    ]
    return "\n".join(lines)


def _vector(name: str, program: IntegerProgram, frames: Sequence[Mapping[str, Numbers]]) -> str:
    """Return a main program that runs frames and compares the answers."""
    inputs, outputs = program.of_kind("input"), program.of_kind("output")
    state, answers = cleared(program, 1), list[Mapping[str, Numbers]]()
    single = _real(program)
    for number, frame in enumerate(frames):
        answers.append(Emulator(program, single=single).run(frame, state, first=number == 0))
    lines = [
        f"/* {len(frames)} frames and the answers of the emulator: 0 is returned if all are",
        f"   {'near' if single else 'the same to the bit'}. */",
        f'#include "{name}.h"',
        "",
    ]
    for one in inputs:
        lines += _rows(f"given_{one.name}", one, [frame[one.name] for frame in frames])
    for one in outputs:
        lines += _rows(f"wanted_{one.name}", one, [answer[one.name] for answer in answers])
    lines += [
        *_kept(name),
        *(_NEAR if single else []),
        "",
        *_MAIN,
        "    int wrong = 0;",
        f"    {name}_reset(&memory);",
        f"    for (int n = 0; n < {len(frames)}; ++n) {{",
        *_each(inputs, "input.{n}{i} = given_{n}[n][i];"),
        f"        {name}_step(&memory, &input, &output);",
        *_each(outputs, _COMPARED[single]),
        "    }",
        "    return wrong != 0;",
        "}",
        "",
    ]
    return "\n".join(lines)


def _kept(name: str) -> list[str]:
    """Return the static variables of a main program."""
    return [f"static {name}_{one} {one};" for one in ("memory", "input", "output")]


_MAIN = ["int main(void)", "{"]
_NEAR = [
    "",
    "static int far(float a, float b)",
    "{",
    "    const float off = a > b ? a - b : b - a, size = b < 0.0f ? -b : b;",
    "    return off > 1e-3f * (size + 1.0f);",
    "}",
]
_COMPARED = {
    False: "wrong += output.{n}{i} != wanted_{n}[n][i];",
    True: "wrong += far((float)output.{n}{i}, (float)wanted_{n}[n][i]);",
}


def _rows(name: str, array: Array, rows: Sequence[Numbers]) -> list[str]:
    length = max(1, array.length)
    lines = [f"static const {element_type(array)} {name}[{len(rows)}][{length}] = {{"]
    for row in rows:
        texts = [literal(array, one) for one in np.broadcast_to(row, (1, length)).ravel().tolist()]
        lines.append(f"    {{{', '.join(texts)}}},")
    return [*lines, "};", ""]


def _each(arrays: Sequence[Array], text: str) -> list[str]:
    lines = list[str]()
    for one in arrays:
        if one.length:
            lines.append(f"        for (int i = 0; i < {one.length}; ++i) {{")
            lines.append(f"            {text.format(n=one.name, i='[i]')}")
            lines.append("        }")
        else:
            lines.append(f"        {text.format(n=one.name, i='').replace('[n][i]', '[n][0]')}")
    return lines


def _stream(name: str) -> str:
    """Return a main program that reads frames from standard input and writes their answers."""
    return "\n".join(
        [
            "/* reads frames as they lie in memory, and writes their answers */",
            f'#include "{name}.h"',
            "",
            "#include <stdio.h>",
            "",
            *_kept(name),
            "",
            *_MAIN,
            f"    {name}_reset(&memory);",
            "    while (fread(&input, sizeof input, 1, stdin) == 1) {",
            f"        {name}_step(&memory, &input, &output);",
            "        if (fwrite(&output, sizeof output, 1, stdout) != 1) {",
            "            return 1;",
            "        }",
            "    }",
            "    return 0;",
            "}",
            "",
        ]
    )


def _makefile(name: str, *, math: bool) -> str:
    libraries = " -lm" if math else ""
    return "\n".join(
        [
            "# `make check` compiles the program, and compares it with the test vector",
            "CC ?= cc",
            "CFLAGS ?= -O2 -ffp-contract=off",
            "override CFLAGS += -std=c99 -Wall -Wextra -Wconversion -Werror",
            "",
            "check: vector",
            "\t@./vector || { echo 'The answers differ from the test vector.' >&2; exit 1; }",
            f"\t@echo 'The test vector of {name} passes.'",
            "",
            _rule(name).rstrip(),
            f"\t$(CC) $(CFLAGS) -o $@ vector.c {name}.c{libraries}",
            "",
            f"stream: stream.c {name}.c {name}.h",
            f"\t$(CC) $(CFLAGS) -o $@ stream.c {name}.c{libraries}",
            "",
            "clean:",
            "\trm -f vector stream",
            "",
            ".PHONY: check clean",
            "",
        ]
    )
