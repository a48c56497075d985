"""MatCNN's `temlib.m`: records of matrices NAME_A, NAME_B and NAME_I, and tables of functions.

A value may have a factor, as in 1/8*[1 1 1; 1 0 1; 1 1 1], or be that of another record. NAME_Aa,
NAME_Bb and NAME_Dd are weights of a nonlinear A, B or D. NAME_a, NAME_b, NAME_d are its table
[interp n x1 y1 … xn yn], for D with a code at the end: two digits name the quantities of neighbour
and cell (1 = u, 2 = x, 3 = y). A third digit before them says that the difference is a factor. The
argument is neighbour less centre.
"""

import re
from pathlib import Path
from typing import Any, cast

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import ArrayError, NotSupportedError, TemplateError
from cnnum.templating.couplings import NonlinearCoupling, Quantity
from cnnum.templating.files.entry import Entry, FileFormat, Guess
from cnnum.templating.functions import Table
from cnnum.templating.template import Template

_FIELD = r"(?<![\w.])([A-Za-z]\w*)_(A|B|I|Aa|Bb|Dd|a|b|d)"
_ASSIGNED = re.compile(
    _FIELD + r"[ \t]*(?:\(([^()\n]*)\))?\s*=\s*([^;\n\[]*)(\[[^\]]*\])?([^;\n\[]*)"
)
_CONTROL = re.compile(
    r"(?:^|[;,])[ \t]*(if|for|while|do|until|switch|try|parfor|spmd|unwind_protect|function|"
    r"classdef|return|break|continue|error|exit|quit|eval|evalin|evalc|feval|assignin|run|source|"
    r"load|clear)\b",
    re.MULTILINE,
)
"""Words of MATLAB and Octave at the start of a statement."""
_OTHERWISE = re.compile(
    _FIELD + r"[ \t]*(?:\([^()\n]*\))?[ \t]*(?:[-+*/^&|]=|\+\+|--|\{)[^;\n]*"
    r"|" + _FIELD + r"[ \t]*\.[ \t]*[A-Za-z(][^=;\n]*=[^=;\n]*"
    r"|^[ \t]*\[[^\]\n=]*\][ \t]*=[^=;\n]*",
    re.MULTILINE,
)
"""Assignments to parts of matrices, or by operators: `A(2, 2) += 1`, `A{1} = 2`, `A.b = 2`,
`[A, B] = f()`."""
_CONTINUED = re.compile(r"\.\.\.[^\n]*\n")
_NAMED = re.compile(_FIELD)
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?"
_BEFORE = re.compile(rf"({_NUMBER})\s*(?:/\s*({_NUMBER})\s*)?\*")
_AFTER = re.compile(rf"([*/])\s*({_NUMBER})")
_COMMENT = re.compile(r"[%#][^\n]*")
_LARGEST = 1e30
_SETTINGS = {
    "Boundary": "boundary",
    "TimeStep": "duration",
    "IterNum": "duration",
    "UseBiasMap": "bias",
    "BIAS": "bias",
    "UseMask": "mask",
    "MASK": "mask",
    "STATE": "initial",
}
"""Variables of a script of MatCNN, and the keys that they bear on."""
_SET = re.compile(rf"^[ \t]*(?:mCNN\.)?({'|'.join(_SETTINGS)})[ \t]*=([^;\n]*)", re.MULTILINE)
_ALWAYS = (
    Guess("boundary", "A record of MatCNN names no boundary: it is zero-flux.", always=True),
    Guess("initial", "A record of MatCNN names no initial state: it is the input.", always=True),
    Guess("duration", "A record of MatCNN names no duration: it is 5.", always=True),
)

Fields = dict[str, Floats]
Lines = dict[str, int]


def read_fields(
    content: str, file: str
) -> tuple[dict[str, Fields], dict[str, Lines], tuple[Guess, ...]]:
    """Return the fields of every record, the lines that they stand in, and what was guessed.

    Raises
    ------
    TemplateError
        Names the file, the line, and the expected text.
    """
    code = _CONTINUED.sub("\f", _COMMENT.sub("", _without_blocks(content)))
    for match in _CONTROL.finditer(code):
        line = _line(code, match.start())
        raise TemplateError(
            f"'{file}', line {line}: expected only assignments of matrices, got '{match[1]}': "
            "what such code computes is not known without running it."
        )
    if (other := _OTHERWISE.search(code)) is not None:
        raise TemplateError(
            f"'{file}', line {_line(code, other.start())}: expected NAME_A = [matrix], or "
            f"NAME_A(row, column) = number, got '{other[0].strip():.60}'."
        )
    guesses = [
        Guess(
            _SETTINGS[match[1]],
            f"'{file}', line {_line(code, match.start(1))}: '{match[1]} ={match[2].rstrip():.40}' "
            "is for a run, and not read: a record is its weights alone.",
        )
        for match in _SET.finditer(code)
    ]
    records, lines = dict[str, Fields](), dict[str, Lines]()
    for match in _ASSIGNED.finditer(code):
        line = _line(code, match.start())
        if match[3] is not None:
            _set_element(match, records, file, line)
            continue
        value = _value(match, records, file, line)
        if match[2] == "I" and value.size > 1:
            said = f"{value.size} numbers stand for a bias, and the first is taken"
            guesses.append(Guess("z", f"'{file}', line {line}: {said}."))
        records.setdefault(match[1], {})[match[2]] = value
        lines.setdefault(match[1], {})[match[2]] = line
    return records, lines, tuple(guesses)


def _line(code: str, at: int) -> int:
    """Return the line of a place; a form feed stands where a line went on."""
    return code.count("\n", 0, at) + code.count("\f", 0, at) + 1


def _without_blocks(content: str) -> str:
    """Empty the lines of block comments, which nest, so that the other lines keep their numbers."""
    lines, depth = list[str](), 0
    for line in content.split("\n"):
        mark = line.strip()
        depth += mark in ("%{", "#{")
        lines.append("" if depth else line)
        depth -= bool(depth) and mark in ("%}", "#}")
    return "\n".join(lines)


def _set_element(match: re.Match[str], records: dict[str, Fields], file: str, line: int) -> None:
    """Set one element of a matrix above: NAME_A(row, column) = number, counted from 1."""
    whole = f"'{file}', line {line}: expected NAME_{match[2]}(row, column) = number, counted from 1"
    known = records.get(match[1], {}).get(match[2])
    places = [part.strip() for part in match[3].split(",")]
    if known is None or len(places) != known.ndim or not all(p.isdigit() for p in places):
        raise TemplateError(f"{whole}, of a matrix above, got '({match[3]:.40})'.")
    place = tuple(int(part) - 1 for part in places)
    value = _matrix(match[4].strip(), file, line) if match[5] is None else np.empty(0)
    inside = all(0 <= at < size for at, size in zip(place, known.shape, strict=True))
    if value.size != 1 or not inside:
        raise TemplateError(f"{whole}, in a matrix of {known.shape}, got '{match[0]:.60}'.")
    changed = known.copy()
    changed[place] = value.item()
    records[match[1]][match[2]] = changed


def _value(match: re.Match[str], records: dict[str, Fields], file: str, line: int) -> Floats:
    """Return a matrix with its factor, a number, or the value of another record."""
    before, matrix, after = match[4].strip(), match[5], match[6].strip()
    if matrix is not None:
        return _factor(before, after, file, line) * _matrix(matrix, file, line)
    other = _NAMED.fullmatch(before)
    if other is None:
        return _matrix(before, file, line)
    if other[2] not in records.get(other[1], {}):
        raise TemplateError(f"'{file}', line {line}: expected a value above, got '{before}'.")
    return records[other[1]][other[2]]


def _factor(before: str, after: str, file: str, line: int) -> float:
    """Return the number that a matrix is multiplied by."""
    ahead, behind = _BEFORE.fullmatch(before), _AFTER.fullmatch(after)
    factors = [float(ahead[1]), 1.0 / _divisor(ahead[2])] if ahead else [1.0]
    if behind:
        number = float(behind[2])
        factors.append(number if behind[1] == "*" else 1.0 / _divisor(behind[2]))
    known = (not before or ahead) and (not after or behind)
    if not known or not np.isfinite(np.prod(factors)):
        raise TemplateError(
            f"'{file}', line {line}: expected a matrix with a factor such as 1/8*[1 2 1], got "
            f"'{before}[…]{after}'."
        )
    return float(np.prod(factors))


def _divisor(text: str | None) -> float:
    return (float(text) or np.nan) if text else 1.0


def _matrix(text: str, file: str, line: int) -> Floats:
    rows = [row for row in re.split(r"[;\n]", text.strip("[] \t")) if row.strip()]
    try:
        values = [[float(v) for v in row.replace(",", " ").split()] for row in rows]
    except ValueError as error:
        raise TemplateError(
            f"'{file}', line {line}: expected numbers, got {str(error).split(': ')[-1]}."
        ) from None
    if not rows:
        raise TemplateError(
            f"'{file}', line {line}: expected a number, or a matrix from '[' to ']', got neither."
        )
    if not all(abs(value) < _LARGEST for row in values for value in row):
        raise TemplateError(f"'{file}', line {line}: expected finite numbers, got {text:.40}.")
    if len({len(row) for row in values}) != 1:
        raise TemplateError(
            f"'{file}', line {line}: expected rows of equal length, got {[len(r) for r in values]}."
        )
    return np.array(values)


_DIGITS: dict[str, Quantity] = {"1": "u", "2": "x", "3": "y"}
_PAIRS = {"A": ("y", "y"), "B": ("u", "u")}
_ORDER = ("A", "B", "I", "Aa", "a", "Bb", "b", "Dd", "d")


def read_all(content: str, file: str) -> tuple[Entry, ...]:
    """Return every template of an M-file.

    Raises
    ------
    TemplateError
        Names the file, the line, and the expected text.
    """
    records, lines, guesses = read_fields(content, file)
    if not records:
        raise TemplateError(
            f"'{file}', line 1: expected a matrix such as 'EDGE_A = [0 0 0; 0 1 0; 0 0 0];', "
            "got none in the whole file."
        )
    return tuple(
        Entry(_template(name, parts, file, lines[name]), guesses=(*guesses, *_ALWAYS))
        for name, parts in records.items()
    )


def _template(name: str, parts: Fields, file: str, lines: Lines) -> Template:
    place = f"'{file}', line {min(lines.values())}"
    try:
        nonlinear = list[NonlinearCoupling]()
        for kind in "ABD":
            if kind + kind.lower() in parts:
                place = f"'{file}', line {lines.get(kind.lower(), lines[kind + kind.lower()])}"
                nonlinear.append(_coupling(kind, parts))
        place = f"'{file}', line {min(lines.values())}"
        reads = "B" in parts or any("u" in (c.neighbour, c.centre) for c in nonlinear)
        given: dict[str, Any] = {"B": parts.get("B", np.zeros((3, 3)))} if reads else {}
        return Template(
            name,
            parts.get("A", np.zeros((3, 3))),
            z=float(parts["I"].ravel()[0]) if "I" in parts else 0.0,
            nonlinear=nonlinear,
            boundary="zero-flux",
            initial="input",
            duration=5.0,
            source=f"imported from {Path(file).name}, a file of MatCNN",
            **given,
        )
    except (TemplateError, ArrayError) as error:
        raise TemplateError(f"{place}: {error}") from None


def _coupling(kind: str, parts: Fields) -> NonlinearCoupling:
    letter = kind.lower()
    if letter not in parts:
        raise TemplateError(f"The weights {kind}{letter} need a table '{letter}', got none.")
    values = parts[letter].ravel()
    count = int(values[1]) if len(values) > 1 else 0
    if len(values) - 2 * count not in (2, 3) or count < 1:
        raise TemplateError(f"The table '{letter}' must be [interp n x1 y1 … xn yn], got {values}.")
    points = values[2 : 2 + 2 * count].reshape(-1, 2).copy()
    if not values[0] and count > 1 and points[-1, 0] <= points[-2, 0]:
        # nothing depends on where the last step ends; one file lost the sign there
        points[-1, 0] = abs(points[-1, 0])
    function = Table.of("linear" if values[0] else "constant", points.tolist())
    neighbour, centre = _PAIRS.get(kind, ("u", "x"))
    factor = False
    if kind == "D":
        code = f"{int(values[-1]):d}" if len(values) % 2 else ""
        if not re.fullmatch("1?[123][123]", code):
            raise TemplateError(f"The code of a D table must be like 12 or 122, got '{code}'.")
        neighbour, centre, factor = _DIGITS[code[-2]], _DIGITS[code[-1]], len(code) == 3
    return NonlinearCoupling(
        parts[kind + letter],
        function,
        cast(Quantity, neighbour),
        cast(Quantity, centre),
        times_argument=factor,
        reversed_sign=True,
    )


def _read(content: str, file: str) -> Entry:
    result = read_all(content, file)
    if len(result) > 1:
        names = ", ".join(entry.template.name for entry in result[:5])
        raise TemplateError(
            f"'{file}' holds {len(result)} templates ({names}, …), expected one: read it with "
            "`load_templates`."
        )
    return next(iter(result))


def _write(entry: Entry) -> str:
    template = entry.template
    _refuse(template)
    name = re.sub(r"\W", "_", template.name)
    fields = {"A": _text(template.A[0, 0]), "I": repr(float(template.z[0]))}
    if template.inputs:
        fields["B"] = _text(template.B[0, 0])
    for coupling in template.nonlinear:
        kind = _kind(coupling)
        fields[kind + kind.lower()] = _text(coupling.weights)
        fields[kind.lower()] = _table(coupling, kind)
    lines = [f"{name}_{key} = {fields[key]};" for key in _ORDER if key in fields]
    return "\n".join([f"% {name}", *lines, ""])


def _kind(coupling: NonlinearCoupling) -> str:
    pair = (coupling.neighbour, coupling.centre)
    plain = {pair: kind for kind, pair in _PAIRS.items()}.get(cast(Any, pair), "D")
    return "D" if coupling.times_argument else plain


def _text(matrix: Floats) -> str:
    return "[" + "; ".join(" ".join(repr(v) for v in row) for row in matrix.tolist()) + "]"


def _table(coupling: NonlinearCoupling, kind: str) -> str:
    table = coupling.table
    points = [number for point in table.points for number in point]
    words = [int(table.interpolation == "linear"), len(table.points), *points]
    if kind == "D":
        digits = {quantity: digit for digit, quantity in _DIGITS.items()}
        code = digits[coupling.neighbour] + digits[coupling.centre or "x"]
        words.append(int("1" + code if coupling.times_argument else code))
    return "[" + " ".join(repr(word) for word in words) + "]"


def _refuse(template: Template) -> None:
    kinds = [_kind(coupling) for coupling in template.nonlinear]
    wrong = {
        "several layers or inputs": template.layers > 1 or template.inputs > 1,
        "a delay": template.delayed is not None,
        "gains in time": bool(template.gains),
        "a time constant other than 1": bool((template.tau != 1.0).any()),
        f"the output '{template.output.name}'": template.output.name != "standard",
        "two nonlinear couplings of a kind": len(set(kinds)) < len(kinds),
        "a function of centre less neighbour": not all(
            c.reversed_sign and c.centre is not None for c in template.nonlinear
        ),
    }
    for what, present in wrong.items():
        if present:
            raise NotSupportedError(
                f"Template '{template.name}' has {what}, which a MatCNN record cannot "
                "express: save it as .toml."
            )


MATCNN = FileFormat(".m", _read, _write)
"""A template as a record of MatCNN; boundary, start and duration are MatCNN's defaults."""
