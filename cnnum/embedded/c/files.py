"""A program as a folder of C99 files: the program, a test vector, a stream, and a Makefile."""

import json
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from os import PathLike
from pathlib import Path
from statistics import median

import numpy as np

from cnnum.embedded.c.packages import FOLDERS, MARK, Source, package_files
from cnnum.embedded.c.text import (
    PAIRS,
    WIDTHS,
    CText,
    bytes_of,
    c_text,
    element_type,
    in_order,
    literal,
    members,
    size_of,
    table_lines,
)
from cnnum.embedded.c.vector import Frames, Vector, tolerance, vector_of
from cnnum.embedded.emulator import Numbers
from cnnum.embedded.measuring import range_lines
from cnnum.embedded.program import Array, IntegerProgram, plain
from cnnum.safety.files import write_files
from cnnum.version import __version__

LARGE = 0.5
"""Relative error of an output from which it is named: half of it is lost."""


@dataclass(frozen=True, slots=True, eq=False)
class Exported:
    """The files of a program by name, and its needs.

    Attributes
    ----------
    files : mapping of str to str
    memory_bytes, input_bytes, output_bytes, table_bytes : int
    vector : Vector
    program : IntegerProgram
    facts : Facts
    errors : mapping of str to float
        Root mean square difference of each output from the same program in floating point on
        typical frames, over the root mean square of that; infinity where that is 0. Empty for
        float32.
    """

    files: Mapping[str, str]
    memory_bytes: int
    input_bytes: int
    output_bytes: int
    table_bytes: int
    vector: Vector
    program: IntegerProgram
    facts: "Facts"
    errors: Mapping[str, float] = field(default_factory=dict[str, float])

    def about(self) -> list[str]:
        """Return what the test vector shows, and how exact the outputs are, a sentence each."""
        result = self.vector.about(self.program)
        known = {name: error for name, error in self.errors.items() if isfinite(error)}
        if known:
            worst = max(known, key=lambda name: known[name])
            result.append(
                "Compared with floating point on typical frames, the root mean square error of an "
                f"output is {median(known.values()):.2g} of the output in the median, and "
                f"{known[worst]:.2g} at most ('{worst}')."
            )
        if lost := [f"'{name}'" for name, error in known.items() if error > LARGE]:
            result.append(
                f"That of {', '.join(lost)} exceeds a half: such an output jumps, has no meaning "
                "in some of the frames, or needs other ranges."
            )
        if wrong := [f"'{name}'" for name in self.errors if name not in known]:
            result.append(f"Not 0, as in floating point: {', '.join(wrong)}.")
        return result

    def write(self, folder: str | PathLike[str], *, force: bool = False) -> None:
        """Write the files into a folder, as `cnnum.safety.files.write_files` does.

        Raises
        ------
        ReportError
            If a file exists and `force` is false, or if one cannot be written.
        """
        write_files(Path(folder), self.files, force=force)

    def packaged(self, kind: str) -> "Exported":
        """Return the same program as a package of a build system, with a few more files.

        Parameters
        ----------
        kind : "cmake", "arduino", "platformio", "zephyr" or "esp-idf"

        Raises
        ------
        UnknownNameError
            If there is no such kind.
        """
        name, math, files = identifier(self.program.name), self.program.real, dict(self.files)
        rows, cols = self.program.shape
        summary = f"Program {name} on {rows} x {cols} cells, {self.facts.precision}."
        made = package_files(kind, Source(name, summary, math, files["vector.c"]))
        if at := FOLDERS.get(kind, ""):
            for file in (f"{name}.c", f"{name}.h"):
                files[at + file] = files.pop(file)
            files["Makefile"] = _makefile(name, at, math=math)
            manifest = json.loads(files[MANIFEST]) | {"source": f"{at}{name}.c"}
            files[MANIFEST] = json.dumps(manifest, indent=1, ensure_ascii=False) + "\n"
        return replace(self, files={**files, **made})


@dataclass(frozen=True, slots=True)
class Facts:
    """Description of the frames of a program, for its header.

    Attributes
    ----------
    rate : float or None
        Frame rate for which the time constants hold, Hz, or None if there are none.
    unit : str
        Unit of the inputs; empty if it is not known.
    precision, method : str
    """

    rate: float | None
    unit: str
    precision: str
    method: str


MANIFEST = "export.json"
"""File that describes frame and answers to programs that read it."""

OTHERS = ("vector.c", "stream.c", "Makefile", "ranges.txt", MANIFEST)
"""Files that have the same names in every export."""


TAKEN = {
    *("vector", "stream", "board", "firmware", "stdint", "stdio", "con", "prn", "aux", "nul"),
    *(f"{port}{n}" for port in ("com", "lpt") for n in range(10)),
}
"""Names of files next to a program's own, of their headers, and of devices on Windows."""


def identifier(name: str) -> str:
    """Return the name of a program in C: of its files, its functions and its macros."""
    result = plain(name)
    if result.lower() in TAKEN or not result[0].isalpha():
        return f"program_{result}"
    return result


def in_the_way(folder: Path, program: str, package: str | None = None) -> str | None:
    """Return a file that an export would replace, though no export of this program wrote it."""
    if not is_export(folder, program):
        for place in _places(folder, program):
            if _is_there(place):
                return str(place.relative_to(folder))
    if package is not None:
        for name in package_files(package, Source(identifier(program), "", False, "")):
            place = folder / name
            if _is_there(place) and not (place.is_file() and MARK.encode() in place.read_bytes()):
                return name
    return None


def is_export(folder: Path, program: str) -> bool:
    """Return whether a folder holds an export of this program, without symlinks for files."""
    makefile, name = folder / "Makefile", identifier(program)
    if any(place.is_symlink() for place in _places(folder, program)) or not makefile.is_file():
        return False
    text = makefile.read_bytes().decode("utf-8", "replace")
    return any(_rule(name, at) in text for at in ("", *FOLDERS.values()))


def _places(folder: Path, program: str) -> list[Path]:
    name = identifier(program)
    own = [f"{at}{name}.{end}" for at in ("", *FOLDERS.values()) for end in "ch"]
    return [folder / file for file in (*own, *OTHERS)]


def _is_there(place: Path) -> bool:
    return place.is_symlink() or place.exists()


def _rule(name: str, at: str = "") -> str:
    return f"vector: vector.c {at}{name}.c {at}{name}.h\n"


def exported(
    program: IntegerProgram,
    streams: Frames,
    remarks: Sequence[str],
    facts: Facts | None = None,
    channels: Mapping[str, str] | None = None,
    *,
    shares: bool = False,
) -> Exported:
    """Return a program's files.

    Parameters
    ----------
    program : IntegerProgram
    streams : sequence of mapping of str to (batch, cells) int or float
        Frames of streams side by side, among which the test vector is chosen.
    about : sequence of str
        Lines at the head of the program's own file.
    facts : Facts, optional
        What the header says of the frames.
    channels : mapping of str to str, optional
        The arrays of all channels of a frame; those that are not read have none in the program.
    shares : bool
        Whether working arrays share their places, as `c_text` has them.
    """
    if facts is not None and not remarks:
        remarks = (
            f"Program '{program.name}' on {program.shape[0]} x {program.shape[1]} cells in "
            f"{facts.precision}, method {facts.method}.",
            f"Written by cnnum {__version__}.",
        )
    name, vector = identifier(program.name), vector_of(program, streams)
    text = c_text(program, shares=shares, c99=True)
    inputs, outputs = program.of_kind("input"), program.of_kind("output")
    header = _header(name, program, text, inputs, outputs, facts)
    source = [
        "/* " + "\n   ".join(line.replace("*/", "") for line in remarks) + " */",
        f'#include "{name}.h"',
        *(_LIBM if program.real else []),
        "",
        *([*PAIRS, ""] if any("CNNUM_PAIRS" in helper for helper in text.helpers) else []),
        *SECTIONS,
        "",
        *(line for helper in text.helpers for line in (helper, "")),
        *(line for table in text.tables for line in (*table_lines(table, TABLE), "")),
        *reset_lines(name),
        "",
        "CNNUM_CODE_SECTION",
        f"void {name}_step_in({name}_kept *restrict m, {name}_scratch *restrict w,",
        f"    const {name}_input *restrict in, {name}_output *restrict out)",
        "{",
        "    const int32_t first = m->started ? 0 : 1;",
        "    (void)first;",
        "    (void)in;",
        "    (void)w;",
        *text.body,
        "    m->started = 1;",
        "}",
        "",
        f"void {name}_step({name}_memory *m, const {name}_input *in, {name}_output *out)",
        "{",
        f"    {name}_step_in(&m->kept, &m->scratch, in, out);",
        "}",
    ]
    files = {
        f"{name}.h": header,
        f"{name}.c": "\n".join([*source, ""]),
        "vector.c": _vector(name, program, vector),
        "stream.c": _stream(name, inputs, outputs),
        "Makefile": _makefile(name, math=program.real),
        "ranges.txt": "".join(f"{line}\n" for line in range_lines(program)),
        MANIFEST: _manifest(program, f"{name}.c", facts, channels or {}),
    }
    return Exported(
        files,
        text.memory_bytes,
        bytes_of(inputs),
        bytes_of(outputs),
        size_of(text.tables),
        vector,
        program,
        facts or Facts(None, "", "", ""),
    )


SECTIONS = [
    "/* attributes of the compiler that put tables or the step into a section of their own */",
    "#ifndef CNNUM_CONST_SECTION",
    "#define CNNUM_CONST_SECTION",
    "#endif",
    "#ifndef CNNUM_CODE_SECTION",
    "#define CNNUM_CODE_SECTION",
    "#endif",
]
TABLE = "CNNUM_CONST_SECTION static const"

_LIBM = ["/* of libm */", *(f"float {name}f(float);" for name in ("sqrt", "exp", "log"))]


def reset_lines(name: str) -> list[str]:
    """Return the functions that clear what is kept, alone and with its scratch."""
    return [
        f"void {name}_reset_kept({name}_kept *m)",
        *_CLEARED,
        "",
        f"void {name}_reset({name}_memory *m)",
        *_CLEARED,
    ]


_CLEARED = [
    "{",
    "    uint8_t *bytes = (uint8_t *)m;",
    "    for (uint32_t n = 0; n < (uint32_t)sizeof *m; ++n) {",
    "        bytes[n] = 0;",
    "    }",
    "}",
]


def frame_structures(name: str, inputs: Sequence[Array], outputs: Sequence[Array]) -> list[str]:
    """Return the structures of inputs and outputs."""
    nothing = ["    uint8_t nothing;"]
    return [
        f"typedef struct {{ /* one frame: {bytes_of(inputs)} bytes */",
        *(members(inputs) or nothing),
        f"}} {name}_input;",
        "",
        f"typedef struct {{ /* its answers: {bytes_of(outputs)} bytes */",
        *(members(outputs) or nothing),
        f"}} {name}_output;",
    ]


def structures(
    name: str, memory: Sequence[Array], inputs: Sequence[Array], outputs: Sequence[Array]
) -> list[str]:
    """Return the structures of inputs, outputs and a memory that holds the scratch, too."""
    size = bytes_of(memory, memory=True)
    return [
        *frame_structures(name, inputs, outputs),
        "",
        f"typedef struct {{ /* what is kept and worked in: {size} bytes */",
        "    int32_t started;",
        "    uint32_t saturated;",
        *members(memory),
        f"}} {name}_memory;",
    ]


def _memory(name: str, text: CText) -> list[str]:
    """Return the structures of what is kept and of the scratch, and of both as one."""
    return [
        f"typedef struct {{ /* what is kept: {bytes_of(text.kept, memory=True)} bytes */",
        "    int32_t started;",
        "    uint32_t saturated; /* numbers that did not fit, by CNNUM_COUNT_SATURATIONS */",
        *members(text.kept),
        f"}} {name}_kept;",
        "",
        f"typedef struct {{ /* of no use between two steps: {bytes_of(text.scratch)} bytes */",
        *(members(text.scratch) or ["    uint8_t nothing;"]),
        f"}} {name}_scratch;",
        "",
        f"typedef struct {{ /* what is kept and worked in: {text.memory_bytes} bytes */",
        f"    {name}_kept kept;",
        f"    {name}_scratch scratch;",
        f"}} {name}_memory;",
    ]


def _header(
    name: str,
    program: IntegerProgram,
    text: CText,
    inputs: Sequence[Array],
    outputs: Sequence[Array],
    facts: Facts | None,
) -> str:
    guard, (rows, cols) = f"{name.upper()}_H", program.shape
    fractions = [
        f"#define {name.upper()}_{array.name.upper()}_FRACTION {array.format.fraction}"
        for array in (*inputs, *outputs)
        if array.format is not None
    ]
    legal = [
        f"#define {name.upper()}_{array.name.upper()}_{end} {literal(array, number)}"
        for array in inputs
        if array.bounds is not None
        for end, number in zip(("LEAST", "LARGEST"), array.bounds, strict=True)
    ]
    lines = [
        f"/* Program '{program.name}' on {rows} x {cols} cells.",
        f"   Memory {text.memory_bytes} bytes, frame {bytes_of(inputs)}, answers "
        f"{bytes_of(outputs)}, tables {size_of(text.tables)}."
        + "".join(f"\n   {line}" for line in _facts(program, inputs, facts))
        + " */",
        f"#ifndef {guard}",
        f"#define {guard}",
        "",
        "#include <stdint.h>",
        "",
        "#ifdef __cplusplus",
        'extern "C" {',
        "#endif",
        "",
        f"#define {name.upper()}_ROWS {rows}",
        f"#define {name.upper()}_COLS {cols}",
        *([] if facts is None or facts.rate is None else _rate(name, facts.rate)),
        "/* a whole number q stands for q times 2^-FRACTION */",
        *fractions,
        "/* the range of an input: numbers beyond it are taken as its end */"
        if legal
        else "/* inputs are finite numbers */",
        *legal,
        "",
        *frame_structures(name, inputs, outputs),
        "",
        *_memory(name, text),
        "",
        "/* before the first frame of a stream */",
        f"void {name}_reset({name}_memory *m);",
        f"void {name}_reset_kept({name}_kept *m);",
        "",
        "/* one frame; the scratch may hold anything before, and no two of these may overlap */",
        f"void {name}_step({name}_memory *m, const {name}_input *in, {name}_output *out);",
        f"void {name}_step_in({name}_kept *m, {name}_scratch *w, const {name}_input *in,",
        f"    {name}_output *out);",
        "",
        "#ifdef __cplusplus",
        "}",
        "#endif",
        "",
        "#endif",
        "",
    ]
    return "\n".join(lines)


def _rate(name: str, rate: float) -> list[str]:
    return [
        "/* frames a second; at another rate the program is another one */",
        f"#define {name.upper()}_RATE_HZ {rate:.9g}",
    ]


def _facts(program: IntegerProgram, inputs: Sequence[Array], facts: Facts | None) -> list[str]:
    """Return what the header says of inputs, rate and saturation, in words."""
    if facts is None:
        return []
    lines = list[str]()
    if facts.rate is not None:
        lines.append(f"Its constants of time are for {facts.rate:.9g} frames a second.")
    unit = f", {facts.unit}" if facts.unit else ""
    for array in inputs:
        if array.bounds is None or array.format is None:
            lines.append(f"{array.name}{unit}: any finite number.")
            continue
        least, largest = (np.ldexp(float(end), -array.format.fraction) for end in array.bounds)
        lines.append(f"{array.name}{unit}: {least:.6g} to {largest:.6g}; beyond that it saturates.")
    if not program.real:
        lines.append(f"{range_lines(program)[1]} (ranges.txt)")
    lines.append(f"{facts.precision}, method {facts.method}, by cnnum {__version__}.")
    return [part for line in lines for part in textwrap.wrap(line, 90)]


def _part(array: Array, name: str) -> dict[str, object]:
    least, largest = array.bounds or (None, None)
    return {
        "name": name,
        "member": array.name,
        "map": array.length > 0,
        "type": element_type(array),
        "fraction": None if array.format is None else array.format.fraction,
        "least": least,
        "largest": largest,
    }


def _manifest(
    program: IntegerProgram, source: str, facts: Facts | None, channels: Mapping[str, str]
) -> str:
    """Return what the header says, as JSON: members stand in the order of their structures."""
    known = facts or Facts(None, "", "float32" if program.real else "", "")
    names = {array: name for name, array in (*channels.items(), *program.outputs.items())}
    parts = dict[str, object]()
    for kind in ("input", "output"):
        parts[f"{kind}s"] = [
            _part(part, names.get(part.name, part.name)) for part in in_order(program.of_kind(kind))
        ]
    manifest: dict[str, object] = {
        "program": program.name,
        "source": source,
        "shape": list(program.shape),
        "channels": list(channels),
        "rate": known.rate,
        "unit": known.unit,
        "precision": known.precision,
        "method": known.method,
        "version": __version__,
        **parts,
    }
    return json.dumps(manifest, indent=1, ensure_ascii=False) + "\n"


def _vector(name: str, program: IntegerProgram, vector: Vector) -> str:
    """Return a main program that runs frames and compares the answers."""
    inputs, outputs = program.of_kind("input"), program.of_kind("output")
    count, begins = len(vector.frames), [str(int(begin)) for begin in vector.begins]
    lines = [
        f"/* {count} frames of {sum(vector.begins)} streams and the answers of the emulator: 0 is",
        f"   returned if all are {'near' if program.real else 'the same to the bit'}.",
        *(f"   {line}" for line in _wrapped(vector.about(program))),
        "*/",
        f'#include "{name}.h"',
        "",
    ]
    for array in inputs:
        lines += _rows(f"{array.name}_given", array, [frame[array.name] for frame in vector.frames])
    for output in outputs:
        lines += _rows(
            f"{output.name}_wanted", output, [answer[output.name] for answer in vector.answers]
        )
    lines += [
        "/* before which frames the memory is cleared */",
        f"static const uint8_t begins[{count}] = {{{', '.join(begins)}}};",
        "",
        *_kept(name),
        *(_FAR if any(output.format is None and not output.logic for output in outputs) else []),
        "",
        *_MAIN,
        "    int wrong = 0;",
        f"    for (int n = 0; n < {count}; ++n) {{",
        "        if (begins[n]) {",
        f"            {name}_reset(&memory);",
        "        }",
        *_each(inputs, lambda _: "input.{n}{i} = {n}_given[n]{at};"),
        f"        {name}_step(&memory, &input, &output);",
        *_each(outputs, lambda part: _compared(part, vector)),
        "    }",
        "    return wrong != 0;",
        "}",
        "",
    ]
    return "\n".join(lines)


def _wrapped(sentences: Sequence[str]) -> list[str]:
    return textwrap.wrap(" ".join(sentences), 90, break_long_words=False)


def _compared(array: Array, vector: Vector) -> str:
    if array.format is not None or array.logic:
        return "wrong += output.{n}{i} != {n}_wanted[n]{at};"
    off = literal(array, tolerance([answer[array.name] for answer in vector.answers]))
    return f"wrong += far(output.{{n}}{{i}}, {{n}}_wanted[n]{{at}}, {off});"


def _kept(name: str) -> list[str]:
    """Return the static variables of a main program."""
    return [f"static {name}_{part} {part};" for part in ("memory", "input", "output")]


_MAIN = ["int main(void)", "{"]
_FAR = [
    "",
    "/* whether a number is farther than that from the wanted one; NaN is */",
    "static int far(float a, float b, float most)",
    "{",
    "    const float off = a > b ? a - b : b - a;",
    "    return !(off <= most);",
    "}",
]


def _rows(name: str, array: Array, rows: Sequence[Numbers]) -> list[str]:
    length = max(1, array.length)
    lines = [f"static const {element_type(array)} {name}[{len(rows)}][{length}] = {{"]
    for row in rows:
        texts = [
            literal(array, number) for number in np.broadcast_to(row, (1, length)).ravel().tolist()
        ]
        lines.append(f"    {{{', '.join(texts)}}},")
    return [*lines, "};", ""]


def _each(arrays: Sequence[Array], text: Callable[[Array], str]) -> list[str]:
    lines = list[str]()
    for array in arrays:
        if array.length:
            lines.append(f"        for (int i = 0; i < {array.length}; ++i) {{")
            lines.append(f"            {text(array).format(n=array.name, i='[i]', at='[i]')}")
            lines.append("        }")
        else:
            lines.append(f"        {text(array).format(n=array.name, i='', at='[0]')}")
    return lines


def _stream(name: str, inputs: Sequence[Array], outputs: Sequence[Array]) -> str:
    """Return a main program that reads frames from standard input and writes their answers."""

    def in_order_of_bytes(structure: str, arrays: Sequence[Array]) -> list[str]:
        return [
            f"        little(&{structure}.{array.name}, {WIDTHS[element_type(array)]}, "
            f"{max(1, array.length)});"
            for array in arrays
            if WIDTHS[element_type(array)] > 1
        ]

    before, after = in_order_of_bytes("input", inputs), in_order_of_bytes("output", outputs)
    return "\n".join(
        [
            "/* reads frames as their structure lies in memory, and writes their answers; numbers",
            "   are little-endian on every core */",
            f'#include "{name}.h"',
            "",
            "#include <stdio.h>",
            "",
            *_kept(name),
            "",
            *([*_LITTLE, ""] if before or after else []),
            *_MAIN,
            f"    {name}_reset(&memory);",
            "    while (fread(&input, sizeof input, 1, stdin) == 1) {",
            *before,
            f"        {name}_step(&memory, &input, &output);",
            *after,
            "        if (fwrite(&output, sizeof output, 1, stdout) != 1) {",
            "            return 1;",
            "        }",
            "    }",
            "    return 0;",
            "}",
            "",
        ]
    )


_LITTLE = [
    "/* turns numbers of the core's order of bytes into little-endian ones, and back */",
    "static void little(void *numbers, int width, int count)",
    "{",
    "    const uint16_t first = 1;",
    "    uint8_t *byte = numbers;",
    "    if (*(const uint8_t *)&first == 1) {",
    "        return;",
    "    }",
    "    for (; count > 0; --count, byte += width) {",
    "        for (int n = 0; n < width / 2; ++n) {",
    "            const uint8_t other = byte[n];",
    "            byte[n] = byte[width - 1 - n];",
    "            byte[width - 1 - n] = other;",
    "        }",
    "    }",
    "}",
]


def _makefile(name: str, at: str = "", *, math: bool) -> str:
    libraries, include = " -lm" if math else "", f"-I{at} " if at else ""
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
            _rule(name, at).rstrip(),
            f"\t$(CC) $(CFLAGS) {include}-o $@ vector.c {at}{name}.c{libraries}",
            "",
            f"stream: stream.c {at}{name}.c {at}{name}.h",
            f"\t$(CC) $(CFLAGS) {include}-o $@ stream.c {at}{name}.c{libraries}",
            "",
            "clean:",
            "\trm -f vector stream",
            "",
            ".PHONY: check clean",
            "",
        ]
    )
