"""Reading `.tem` files of the CNN Software Library: linear, nonlinear, D, delayed, several layers.

The semantics are those that the library's own templates prove: "a-" is a of centre less neighbour,
"a0" a of the neighbour. `interp` 0 is piecewise constant, 1 piecewise linear. In the D form "x-u#"
the argument is x of the cell less u of the neighbour. "x-x#x-x" multiplies by it.
"""

import math
import re
from dataclasses import dataclass, field
from itertools import pairwise

from cnnum.errors import TemplateError
from cnnum.templating.files.tem_tokens import Token, Words

Tokens = list[Token]

_MATRICES = {
    "FEEDBACK": "A",
    "CONTROL": "B",
    "NONLIN_FEEDBACK": "A",
    "NONLIN_CONTROL": "B",
    "DELAYED_FEEDBACK": "delayed A",
    "DELAYED_CONTROL": "delayed B",
}
_LETTER = re.compile(r"[A-Za-z]")
_CELL = re.compile(r"[A-Za-z][-0]")
_D_ARGUMENT = re.compile(r"([xyu])-([xyu])#(([xyu])-([xyu]))?")
_LARGEST = 31
"""Radius of the largest neighbourhood, and number of layers."""


@dataclass(frozen=True, slots=True)
class Block:
    """One matrix of a file.

    Attributes
    ----------
    part : str
        "A", "B", "D", "delayed A" or "delayed B".
    source : int
        Layer or input that it reads, from 0.
    rows : list of list of Token
    argument : str
        Of a D form.
    """

    part: str
    source: int
    rows: list[Tokens]
    argument: str = ""


@dataclass(slots=True)
class Layer:
    """One layer of a file."""

    blocks: list[Block] = field(default_factory=list[Block])
    z: float = 0.0
    functions: dict[str, tuple[str, list[list[float]]]] = field(
        default_factory=dict[str, tuple[str, list[list[float]]]]
    )


@dataclass(slots=True)
class Part:
    """One template of a file: layers by number, and the delay."""

    layers: dict[int, Layer] = field(default_factory=dict[int, Layer])
    count: int = 1
    delay: float | None = None
    radius: int = 1
    now: int = 0

    @property
    def layer(self) -> Layer:
        """The layer that is being read."""
        return self.layers.setdefault(self.now, Layer())


def read_parts(text: Words) -> list[Part]:
    """Return the templates of a file; more than one only in a time-varying program.

    Raises
    ------
    TemplateError
        Names the file, the line, and the expected text.
    """
    parts = [Part()]
    while text.left:
        token = text.take("a keyword")
        if token.keyword == "NEW":
            parts.append(Part(radius=parts[-1].radius))
        else:
            _statement(text, token, parts[-1])
    found = [part for part in parts if part.layers]
    if not found:
        raise text.wrong(text.peek().line, "FEEDBACK, CONTROL or CURRENT", "no template")
    return found


def _statement(text: Words, token: Token, part: Part) -> None:
    word = token.keyword
    if word == "NRLAYERS":
        part.count = text.whole("the number of layers", _LARGEST)
    elif word == "LAYER":
        line, number = text.peek().line, text.whole("the number of a layer", _LARGEST)
        if number < 1:
            raise text.wrong(line, "a layer from 1 up", "0")
        part.now = number - 1
        part.layers.setdefault(part.now, Layer())
    elif word == "NEIGHBORHOOD":
        part.radius = text.whole("the radius of the neighbourhood", _LARGEST)
    elif word == "CURRENT":
        part.layer.z = text.number("the bias after CURRENT")
    elif word == "DELAY":
        part.delay = text.number("the delay after DELAY")
    elif word in ("LABEL", "TEMPLATE", "LOOP"):
        for _ in range(2 if word == "LOOP" else 1):
            text.whole(f"a whole number after {word}", 10**6)
    elif word == "NONLIN_D":
        part.layer.blocks.append(_d_block(text, part.radius))
    elif word in _MATRICES:
        part.layer.blocks.append(_block(text, word, part.now))
    elif _LETTER.fullmatch(token.text):
        part.layer.functions[token.text.lower()] = _function(text, token)
    else:
        raise text.wrong(token.line, "a keyword or a function's letter", f"'{token.text:.40}'")


def _block(text: Words, word: str, own: int) -> Block:
    source = own if "FEEDBACK" in word else 0
    if text.peek().keyword == "FROM":
        text.take("FROM")
        source = text.whole("a layer after FROM", _LARGEST) - 1
    cells = Tokens()
    while text.left and _is_cell(text.peek()):
        cells.append(text.take("a weight"))
    return Block(_MATRICES[word], max(source, 0), _square(text, cells, word))


def _is_cell(token: Token) -> bool:
    if _CELL.fullmatch(token.text):
        return True
    try:
        return math.isfinite(float(token.text))
    except ValueError:
        return False


def _d_block(text: Words, radius: int) -> Block:
    token = text.take("the argument of a D form, as in 'x-u#'")
    argument = token.text.lower()
    if not _D_ARGUMENT.fullmatch(argument):
        raise text.wrong(token.line, "an argument such as 'x-u#' or 'x-x#x-x'", f"'{token.text}'")
    count = (2 * radius + 1) ** 2
    cells = [_d_cell(text, count) for _ in range(count)]
    return Block("D", 0, _square(text, cells, "NONLIN_D"), argument)


def _d_cell(text: Words, count: int) -> Token:
    token = text.take(f"{count} weights or letters of NONLIN_D")
    if not (_LETTER.fullmatch(token.text) or _is_cell(token)):
        raise text.wrong(token.line, "a weight or a letter of NONLIN_D", f"'{token.text:.40}'")
    return token


def _square(text: Words, cells: Tokens, word: str) -> list[Tokens]:
    """Return the rows of a matrix, which may be larger than its file says.

    Some files have "0 0" where "0.0" is meant, which makes one number too many.
    """
    side = math.isqrt(len(cells))
    if len(cells) == side**2 + 1 and side % 2:
        cells = _joined(cells, side)
    if len(cells) != side**2 or side % 2 == 0:
        line = cells[-1].line if cells else text.peek().line
        raise text.wrong(line, f"a square matrix of odd size after {word}", f"{len(cells)} numbers")
    return [cells[n : n + side] for n in range(0, len(cells), side)]


def _joined(cells: Tokens, side: int) -> Tokens:
    lines = [token.line for token in cells]
    for n, (one, other) in enumerate(pairwise(cells)):
        crowded = one.line == other.line and lines.count(one.line) == side + 1
        if crowded and one.text == other.text == "0":
            return cells[:n] + cells[n + 1 :]
    return cells


def _function(text: Words, letter: Token) -> tuple[str, list[list[float]]]:
    name = f"function '{letter.text}'"
    kind = text.whole(f"the interpolation of {name}, 0 or 1", 1)
    count = text.whole(f"the number of points of {name}", 1000)
    if count < 1:
        raise text.wrong(letter.line, f"at least one point of {name}", "0")
    points = [[text.number(f"a point of {name}") for _ in range(2)] for _ in range(count)]
    return ("linear" if kind else "constant", points)


def argument_of(text: Words, argument: str) -> tuple[str, str, bool]:
    """Return centre, neighbour and whether the difference is a factor, of a D form.

    Raises
    ------
    TemplateError
        If the factor is another difference than the argument.
    """
    match = _D_ARGUMENT.fullmatch(argument)
    assert match is not None
    if match[3] and match[3] != f"{match[1]}-{match[2]}":
        raise TemplateError(
            f"'{text.file}': the factor of the D form '{argument}' must be its own argument."
        )
    return match[1], match[2], bool(match[3])
