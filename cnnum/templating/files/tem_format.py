"""`.tem` files as templates, and templates as `.tem` files."""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import PurePath
from string import ascii_lowercase
from typing import Any, cast

import numpy as np

from cnnum.arrays import Floats, frozen
from cnnum.errors import ArrayError, CnnumError, NotSupportedError, TemplateError
from cnnum.templating.couplings import DelayedCoupling, NonlinearCoupling, Quantity
from cnnum.templating.files.entry import About, Entry, FileFormat, Guess
from cnnum.templating.functions import Table
from cnnum.templating.template import Initial, Template

KEYWORDS = frozenset(
    [
        *("NRLAYERS", "LAYER", "NEIGHBORHOOD", "CURRENT", "DELAY", "FROM", "NONLIN_D"),
        *("FEEDBACK", "CONTROL", "NONLIN_FEEDBACK", "NONLIN_CONTROL"),
        *("DELAYED_FEEDBACK", "DELAYED_CONTROL", "LABEL", "TEMPLATE", "NEW", "LOOP"),
    ]
)
_SETTING = re.compile(
    r"(Input|Ini\s*State|Boundary|Bias\s*Map|Fixed\s*State\s*Map)\s*:\s*([^,]*)", re.IGNORECASE
)
_HEADER = re.compile(r"%\s*(Function|TemLibName|CNNModel|Setting)\s*:\s*(.*)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Token:
    """A word and its line, from 1."""

    text: str
    line: int

    @property
    def keyword(self) -> str:
        """The keyword that it is, in capitals, or ""."""
        word = self.text.upper()
        return word if word in KEYWORDS else ""


@dataclass(slots=True)
class Words:
    """The words of a file, read in sequence.

    Attributes
    ----------
    file : str
        For error messages.
    tokens : list of Token
    header : dict
        Values in the comments, by lower-case key: function, temlibname, cnnmodel, and of the
        setting input, inistate, boundary, biasmap, fixedstatemap.
    guesses : list of Guess
        What was guessed so far.
    """

    file: str
    tokens: list[Token]
    header: dict[str, str] = field(default_factory=dict[str, str])
    at: int = 0
    guesses: list[Guess] = field(default_factory=list[Guess])

    def guess(self, key: str, line: int, said: str) -> None:
        """Note a guess about a key; `said` is a clause."""
        where = f"'{self.file}', line {line}: " if line else f"'{self.file}': "
        self.guesses.append(Guess(key, f"{where}{said}."))

    @property
    def left(self) -> bool:
        """Whether there are words left."""
        return self.at < len(self.tokens)

    def peek(self) -> Token:
        """Return the next word, an empty one at the end."""
        last = self.tokens[-1].line if self.tokens else 1
        return self.tokens[self.at] if self.left else Token("", last)

    def take(self, expected: str) -> Token:
        """Return the next word and go on.

        Raises
        ------
        TemplateError
            If there is none; names the expected one.
        """
        token = self.peek()
        if not self.left:
            raise self.wrong(token.line, expected, "the end of the file")
        self.at += 1
        return token

    def number(self, expected: str) -> float:
        """Return the next word as a number.

        Raises
        ------
        TemplateError
            If it is none.
        """
        token = self.take(expected)
        try:
            value = float(token.text)
        except ValueError:
            raise self.wrong(token.line, expected, f"'{token.text:.40}'") from None
        if not abs(value) < 1e30:
            raise self.wrong(token.line, expected, f"'{token.text:.40}'")
        return value

    def whole(self, expected: str, most: int) -> int:
        """Return the next word as a whole number from 0 up to `most`.

        Raises
        ------
        TemplateError
            If it is none.
        """
        line, value = self.peek().line, self.number(expected)
        if value != int(value) or not 0 <= value <= most:
            raise self.wrong(line, f"{expected}, a whole number from 0 to {most}", f"{value:g}")
        return int(value)

    def wrong(self, line: int, expected: str, got: str) -> TemplateError:
        """Return the error for unexpected content in a line."""
        return TemplateError(f"'{self.file}', line {line}: expected {expected}, got {got}.")


def words(content: str, file: str) -> Words:
    """Return the words of a file without its comments, whose settings are kept."""
    header = dict[str, str]()
    tokens = list[Token]()
    for number, line in enumerate(content.replace("\x1a", "").splitlines(), 1):
        code, sign, comment = line.partition("%")
        if sign:
            header |= _settings(sign + comment)
        if code.strip().lower().startswith("comment"):
            continue
        tokens += _of_line(code, number)
    return Words(file, tokens, header)


def _of_line(code: str, number: int) -> Iterator[Token]:
    tokens = [Token(word, number) for word in code.replace(":", " ").split()]
    # the number of a layer may be followed by its name in words
    keep = 2 if tokens and tokens[0].keyword == "LAYER" else len(tokens)
    yield from tokens[:keep]


def _settings(comment: str) -> dict[str, str]:
    match = _HEADER.match(comment)
    if match is None:
        return _named(comment)
    key, value = match[1].lower(), match[2].strip()
    if key != "setting":
        return {key: value}
    return _named(value)


def _named(text: str) -> dict[str, str]:
    result: list[tuple[str, str]] = _SETTING.findall(text)
    return {"".join(name.split()).lower(): value.strip() for name, value in result}


class _Letters:
    """Letters of functions, one for each table that is written."""

    def __init__(self) -> None:
        self.tables = dict[Table, str]()

    def of(self, template: str, table: Table) -> str:
        """Return the letter of a table."""
        if table not in self.tables:
            if len(self.tables) == len(ascii_lowercase):
                raise _unsaid(template, "more than 26 functions")
            self.tables[table] = ascii_lowercase[len(self.tables)]
        return self.tables[table]

    def lines(self) -> Iterator[str]:
        """Yield the tables."""
        for table, letter in self.tables.items():
            points = " ".join(f"{v!r} {f!r}" for v, f in table.points)
            kind = int(table.interpolation == "linear")
            yield f"{letter} {kind} {len(table.points)} {points}"


def entry_to_tem(entry: Entry) -> str:
    """Return the text of a `.tem` file.

    Raises
    ------
    NotSupportedError
        If the template has parts that the format has no words for.
    """
    template = entry.template
    _refuse(template)
    lines = [*_header(entry), f"NEIGHBORHOOD {template.radius}"]
    letters, many = _Letters(), template.layers > 1
    if many:
        lines.append(f"NRLAYERS {template.layers}")
    if template.delayed is not None:
        lines.append(f"DELAY {template.delayed.delay!r}")
    for layer in range(template.layers):
        lines += [f"LAYER {layer + 1}"] if many else []
        lines += _layer(template, layer, letters)
    return "\r\n".join([*lines, *letters.lines(), ""])


def _header(entry: Entry) -> list[str]:
    template = entry.template
    edge = template.boundary
    said = f"Fixed({edge.constant!r})" if edge.constant is not None else "Zero-flux"
    start = "P" if template.initial == "input" else f"Arbitrary({template.initial!r})"
    kind = "DT-CNN" if template.output.discrete else "CT-CNN"
    layers = "Single-layer" if template.layers == 1 else f"Multi-layer({template.layers})"
    about = " ".join(template.description.split())
    return [
        f"%Function: {about}",
        f"%TemLibName: {template.name}",
        f"%CNNModel: {layers}, {kind}{', Delayed' if template.delayed else ''}",
        f"%Setting: Input:{'P' if template.inputs else '-'}, IniState:{start}, Boundary:{said}",
    ]


def _layer(template: Template, layer: int, letters: _Letters) -> Iterator[str]:
    side = 2 * template.radius + 1
    for source in range(template.layers):
        yield from _matrix("FEEDBACK", source, template.A[layer, source], side)
    for source in range(template.inputs):
        yield from _matrix("CONTROL", source, template.B[layer, source], side)
    if template.delayed is not None:
        for source in range(template.layers):
            kernel = template.delayed.A[layer, source]
            yield from _matrix("DELAYED_FEEDBACK", source, kernel, side)
        for source in range(template.inputs):
            kernel = template.delayed.B[layer, source]
            yield from _matrix("DELAYED_CONTROL", source, kernel, side)
    for coupling in template.nonlinear:
        if coupling.to == layer:
            yield from _nonlinear(template, coupling, side, letters)
    yield f"CURRENT {float(template.z[layer])!r}"


def _matrix(word: str, source: int, kernel: Floats, side: int) -> Iterator[str]:
    # B is written even where it is 0: it says that there is an input
    if kernel.any() or word == "CONTROL":
        yield f"{word} FROM {source + 1}"
        for row in np.pad(kernel, (side - len(kernel)) // 2).tolist():
            yield " ".join(repr(weight) for weight in row)


def _nonlinear(
    template: Template, coupling: NonlinearCoupling, side: int, letters: _Letters
) -> Iterator[str]:
    word = {("y", "y"): "NONLIN_FEEDBACK", ("u", "u"): "NONLIN_CONTROL"}.get(
        (coupling.neighbour, coupling.centre or coupling.neighbour)
    )
    if word is None or coupling.times_argument:
        difference = f"{coupling.centre}-{coupling.neighbour}"
        yield "NONLIN_D"
        yield f"{difference}#{difference if coupling.times_argument else ''}"
        sign = ""
    else:
        yield f"{word} FROM {coupling.source + 1}"
        sign = "0" if coupling.centre is None else "-"
    weights = np.pad(coupling.weights, (side - len(coupling.weights)) // 2)
    for row in weights.tolist():
        cells = [(_scaled(coupling, w) if w else None) for w in row]
        yield " ".join(
            "0" if table is None else letters.of(template.name, table) + sign for table in cells
        )


def _scaled(coupling: NonlinearCoupling, weight: float) -> Table:
    """Return the function times the weight, of centre less neighbour."""
    table = coupling.table
    points = [(v, weight * f) for v, f in table.points]
    if coupling.reversed_sign:
        flip = -1.0 if coupling.times_argument else 1.0
        points = [(-v, flip * f) for v, f in reversed(points)]
    return Table(table.interpolation, tuple(points))


def _refuse(template: Template) -> None:
    """Check that the format can express all features of a template."""
    steps = [c for c in template.nonlinear if c.reversed_sign]
    wrong = {
        "a time constant other than 1": bool((template.tau != 1.0).any()),
        "gains in time": bool(template.gains),
        "a periodic boundary": template.boundary.pad_mode == "wrap",
        "an input boundary of its own": template.input_boundary != template.boundary,
        f"the output '{template.output.name}'": template.output.name not in ("standard", "sign"),
        "a stepped function of neighbour less centre": any(
            c.table.interpolation == "constant" for c in steps
        ),
        "a coupling of x without a centre": any(
            c.neighbour == "x" and c.centre is None for c in template.nonlinear
        ),
        "a nonlinear coupling whose centre lies in another layer": any(
            c.centre is not None
            and c.centre_source
            != (c.source if (c.centre == "u") == (c.neighbour == "u") else _own(c))
            for c in template.nonlinear
        ),
        "a D form between different layers or inputs": any(
            _is_d(c) and (c.source if c.neighbour == "u" else c.source - c.to) != 0
            for c in template.nonlinear
        ),
    }
    for what, present in wrong.items():
        if present:
            raise _unsaid(template.name, what)


def _own(coupling: NonlinearCoupling) -> int:
    return 0 if coupling.centre == "u" else coupling.to


def _is_d(coupling: NonlinearCoupling) -> bool:
    same = (coupling.centre or coupling.neighbour) == coupling.neighbour
    return coupling.times_argument or not same or coupling.neighbour == "x"


def _unsaid(template: str, what: str) -> NotSupportedError:
    return NotSupportedError(
        f"Template '{template}' has {what}, which a .tem file cannot express: save it as .toml."
    )


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
        Argument of a D form.
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
    said: set[tuple[int, str]] = field(default_factory=set[tuple[int, str]])

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
    result = [part for part in parts if part.layers]
    if not result:
        raise text.wrong(text.peek().line, "FEEDBACK, CONTROL or CURRENT", "no template")
    return result


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
        part.layer.z = _once(text, token, part, "z", text.number("the bias after CURRENT"))
    elif word == "DELAY":
        part.delay = text.number("the delay after DELAY")
    elif word in ("LABEL", "TEMPLATE", "LOOP"):
        for _ in range(2 if word == "LOOP" else 1):
            text.whole(f"a whole number after {word}", 10**6)
        if word == "LOOP":
            said = "the LOOP is not run: each template of the program becomes one of its own"
            text.guess("duration", token.line, said)
    elif word == "NONLIN_D":
        part.layer.blocks.append(_d_block(text, part.radius))
    elif word in _MATRICES:
        part.layer.blocks.append(_block(text, word, part.now))
    elif _LETTER.fullmatch(token.text):
        letter = token.text.lower()
        if letter in part.layer.functions:
            said = f"the function '{letter}' has two tables, and the last one is taken"
            text.guess("nonlinear", token.line, said)
        part.layer.functions[letter] = _function(text, token)
    else:
        raise text.wrong(token.line, "a keyword or a function's letter", f"'{token.text:.40}'")


def _once(text: Words, token: Token, part: Part, key: str, value: float) -> float:
    """Return a value, and note where another one stood before."""
    number = part.now + 1
    if (number, key) in part.said:
        said = f"layer {number} has two values of {token.keyword}, and the last one is taken"
        text.guess(key, token.line, said)
    part.said.add((number, key))
    return value


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
        cells = _joined(text, cells, side)
    if len(cells) != side**2 or side % 2 == 0:
        line = cells[-1].line if cells else text.peek().line
        raise text.wrong(line, f"a square matrix of odd size after {word}", f"{len(cells)} numbers")
    return [cells[n : n + side] for n in range(0, len(cells), side)]


def _joined(text: Words, cells: Tokens, side: int) -> Tokens:
    lines = [token.line for token in cells]
    for n, (cell, other) in enumerate(pairwise(cells)):
        crowded = cell.line == other.line and lines.count(cell.line) == side + 1
        if crowded and cell.text == other.text == "0":
            said = f"{len(cells)} numbers stand for {side**2}: '0 0' is taken for one 0"
            text.guess("A, B", cell.line, said)
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


_SIZE = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d{1,2})?"
_NUMBER = re.compile(_SIZE, re.IGNORECASE)
_FIXED = re.compile(rf"Fixed\s*\(\s*({_SIZE})\s*\)", re.IGNORECASE)
_PICTURE = re.compile(r"P\d*\b", re.IGNORECASE)
_GIVEN = re.compile(rf"Arbitrary\s*\(\s*({_SIZE})\s*\)", re.IGNORECASE)


def _read(content: str, file: str) -> Entry:
    text = words(content, file)
    parts = read_parts(text)
    if len(parts) > 1:
        raise TemplateError(
            f"'{file}' is a time-varying program of {len(parts)} templates, expected one "
            "template: read it with `load_templates`."
        )
    return _entry(text, parts[0], "")


def read_all(content: str, file: str) -> tuple[Entry, ...]:
    """Return every template of a file, those of a time-varying program in their order.

    Raises
    ------
    TemplateError
        Names the file, the line, and the expected text.
    """
    text = words(content, file)
    parts = read_parts(text)
    numbered = len(parts) > 1
    return tuple(_entry(text, p, f" {n}" if numbered else "") for n, p in enumerate(parts, 1))


def _entry(text: Words, part: Part, suffix: str) -> Entry:
    header = text.header
    # headers of several files are the same, so that only the file's own name says which it is
    file = PurePath(text.file)
    said = " ".join(header.get("temlibname", "").strip(" -.?").split())
    same = said.lower() == file.stem.lower()
    try:
        template = Template(
            re.sub(r"[^A-Za-z0-9_ .-]", "_", said if same else file.stem)[:60] + suffix,
            **_physics(text, part),
            boundary=_boundary(text),
            **_start(text),
            output="sign" if "DT-CNN" in header.get("cnnmodel", "").upper() else "standard",
            description=_description(header),
            source=f"imported from {file.name}{f' ({said})' if said and not same else ''}",
        )
    except (TemplateError, ArrayError) as error:
        raise TemplateError(f"'{text.file}': {error}") from None
    about = About(header.get("input", ""), header.get("inistate", ""))
    unsaid = Guess(
        "duration", "A .tem file names no duration: it runs until it settles.", always=True
    )
    return Entry(template, (), about, guesses=(unsaid, *dict.fromkeys(text.guesses)))


def _boundary(text: Words) -> float | str:
    said = text.header.get("boundary", "")
    fixed = _FIXED.search(said)
    if fixed:
        return float(fixed[1])
    lower = said.lower()
    if "flux" in lower:
        return "zero-flux"
    if "periodic" in lower:
        return "periodic"
    got = f"the boundary '{said}' is none that is known" if said else "no boundary is named"
    text.guess("boundary", 0, f"{got}: 0 is taken")
    return 0.0


def _description(header: Mapping[str, str]) -> str:
    """Return what the header says of the function, and of maps, which no template holds."""
    said = [header.get("function", "")]
    said += [f"Its header asks for a {what}: {value}." for what, value, _ in _maps(header)]
    return " ".join(part for part in said if part)


def _maps(header: Mapping[str, str]) -> Iterator[tuple[str, str, str]]:
    """Yield the maps that a header asks for: what, which, and the argument of a run."""
    for what, key, role in (
        ("bias map", "biasmap", "bias"),
        ("fixed-state mask", "fixedstatemap", "mask"),
    ):
        value = header.get(key, "").strip(" -")
        if value:
            yield what, value, role


def _start(text: Words) -> dict[str, Any]:
    """Return the initial state, and whether a run should be given one."""
    said, read = text.header.get("inistate", ""), text.header.get("input", "")
    for what, value, role in _maps(text.header):
        wish = f"the header asks for the {what} '{value}', which no template holds"
        text.guess(role, 0, f"{wish}: give it to each run, as '{role}='")
    start = _initial(said)
    if start != "input":
        if not said.strip(" -"):
            text.guess("initial", 0, "no initial state (IniState) is named: 0 is taken")
        return {"initial": start}
    pictures = [_PICTURE.match(part.strip()) for part in (said, read)]
    if pictures[0] is None:
        text.guess("initial", 0, f"the initial state '{said}' is taken for the input picture")
    elif pictures[1] is not None and pictures[0][0].upper() != pictures[1][0].upper():
        return {"initial": 0.0, "needs_state": True}
    return {"initial": start}


def _initial(said: str) -> Initial:
    given = _GIVEN.search(said)
    if given:
        return float(given[1])
    said = said.strip(" -")
    return float(said) if _NUMBER.fullmatch(said) else "input" if said else 0.0


def _physics(text: Words, part: Part) -> dict[str, Any]:
    """Return A, B, z, and the nonlinear and delayed couplings."""
    blocks = [(n, block) for n, layer in part.layers.items() for block in layer.blocks]
    layers = max([part.count, *(n + 1 for n in part.layers)])
    if layers > part.count > 1:
        text.guess("A", 0, f"NRLAYERS is {part.count}, but there is a LAYER {layers}")
    inputs = max((b.source + 1 for _, b in blocks if b.part.endswith("B")), default=0)
    side = max((len(b.rows) for _, b in blocks), default=1)
    kernels = {
        "A": np.zeros((layers, layers, side, side)),
        "B": np.zeros((layers, max(inputs, 1), side, side)),
        "delayed A": np.zeros((layers, layers, side, side)),
        "delayed B": np.zeros((layers, max(inputs, 1), side, side)),
    }
    nonlinear = list[NonlinearCoupling]()
    for to, block in blocks:
        if block.source >= (kernels["A"] if block.part.endswith("A") else kernels["B"]).shape[1]:
            line = block.rows[0][0].line
            raise text.wrong(line, f"a layer from 1 to {layers}", f"{block.source + 1}")
        weights, terms = _split(text, part, to, block)
        nonlinear += terms
        if block.part != "D":
            where = (to, block.source)
            if weights.any() and kernels[block.part][where].any():
                said = (
                    f"two matrices of {block.part} to layer {to + 1} from {block.source + 1} are "
                    "added"
                )
                text.guess(block.part, block.rows[0][0].line, said)
            kernels[block.part][where] += _centred(weights, side)
    reads = inputs > 0 or any("u" in (c.neighbour, c.centre) for c in nonlinear)
    parts: dict[str, Any] = {"A": kernels["A"], "z": _biases(part, layers)}
    parts["B"] = kernels["B"] if reads else None
    parts["nonlinear"] = nonlinear
    late = [kernels["delayed A"], kernels["delayed B"][:, : max(inputs, 1) if reads else 0]]
    if part.delay is None and any(kernel.any() for kernel in late):
        raise TemplateError(
            f"'{text.file}': expected DELAY and a time with the delayed matrices, got none."
        )
    if part.delay is not None and any(kernel.any() for kernel in late):
        parts["delayed"] = DelayedCoupling(part.delay, *(frozen(kernel) for kernel in late))
    return parts


def _biases(part: Part, layers: int) -> list[float]:
    return [part.layers[n].z if n in part.layers else 0.0 for n in range(layers)]


def _centred(weights: Floats, side: int) -> Floats:
    rim = (side - len(weights)) // 2
    return np.pad(weights, rim)


def _split(
    text: Words, part: Part, to: int, block: Block
) -> tuple[Floats, list[NonlinearCoupling]]:
    """Return a matrix's plain weights, and a coupling for each function that it names."""
    side = len(block.rows)
    plain, marks = np.zeros((side, side)), dict[str, Floats]()
    for row, tokens in enumerate(block.rows):
        for col, token in enumerate(tokens):
            if token.text[0].isalpha():
                key = token.text.lower()
                marks.setdefault(key, np.zeros((side, side)))[row, col] = 1.0
            else:
                plain[row, col] = float(token.text)
    lines = {token.text.lower(): token.line for row in block.rows for token in row}
    return plain, [
        _coupling(text, part, to, block, (mark, weights, lines[mark]))
        for mark, weights in marks.items()
    ]


def _coupling(
    text: Words, part: Part, to: int, block: Block, cells: tuple[str, Floats, int]
) -> NonlinearCoupling:
    mark, weights, line = cells
    known = {k: f for layer in part.layers.values() for k, f in layer.functions.items()}
    function = part.layers[to].functions.get(mark[0], known.get(mark[0]))
    if function is None:
        raise text.wrong(line, f"a table of the function '{mark[0]}' in the file", "none")
    neighbour, centre, factor = "y" if block.part.endswith("A") else "u", None, False
    if block.part == "D":
        centre, neighbour, factor = argument_of(text, block.argument)
    elif mark[1:] == "-":
        centre = neighbour
    same = centre is not None and (centre == "u") == (neighbour == "u")
    source = block.source if block.part != "D" or neighbour == "u" else to
    try:
        return NonlinearCoupling(
            weights,
            Table.of(*function),
            cast(Quantity, neighbour),
            cast(Quantity | None, centre),
            times_argument=factor,
            to=to,
            source=source,
            centre_source=source if same else (to if centre in ("x", "y") else 0),
        )
    except CnnumError as error:
        raise TemplateError(f"'{text.file}', line {line}: {error}") from None


TEM = FileFormat(".tem", _read, entry_to_tem)
"""A template as the CNN Software Library writes it."""
