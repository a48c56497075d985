"""Values of an M-file: matrices and numbers with their factors, or the value of another record."""

import re

import numpy as np

from cnnum.arrays import Floats
from cnnum.errors import TemplateError

_FIELD = r"([A-Za-z]\w*)_(A|B|I|Aa|Bb|Dd|a|b|d)"
_ASSIGNED = re.compile(_FIELD + r"\s*=\s*([^;\n\[]*)(\[[^\]]*\])?([^;\n\[]*)")
_NAMED = re.compile(_FIELD)
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?"
_BEFORE = re.compile(rf"({_NUMBER})\s*(?:/\s*({_NUMBER})\s*)?\*")
_AFTER = re.compile(rf"([*/])\s*({_NUMBER})")
_COMMENT = re.compile(r"%[^\n]*")
_LARGEST = 1e30

Fields = dict[str, Floats]
Lines = dict[str, int]


def read_fields(content: str, file: str) -> tuple[dict[str, Fields], dict[str, Lines]]:
    """Return the fields of every record, and the lines that they stand in.

    Raises
    ------
    TemplateError
        Names the file, the line, and the expected text.
    """
    code = _COMMENT.sub("", content)
    records, lines = dict[str, Fields](), dict[str, Lines]()
    for match in _ASSIGNED.finditer(code):
        line = code.count("\n", 0, match.start()) + 1
        value = _value(match, records, file, line)
        records.setdefault(match[1], {})[match[2]] = value
        lines.setdefault(match[1], {})[match[2]] = line
    return records, lines


def _value(match: re.Match[str], records: dict[str, Fields], file: str, line: int) -> Floats:
    """Return a matrix with its factor, a number, or the value of another record."""
    before, matrix, after = match[3].strip(), match[4], match[5].strip()
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
