"""`.tem` files as templates, and templates as `.tem` files."""

import re
from pathlib import PurePath
from typing import Any, cast

import numpy as np

from cnnum.arrays import Floats, frozen
from cnnum.errors import ArrayError, CnnumError, TemplateError
from cnnum.templating.couplings import DelayedCoupling, NonlinearCoupling, Quantity
from cnnum.templating.files.entry import About, Entry, FileFormat
from cnnum.templating.files.tem_reading import Block, Part, argument_of, read_parts
from cnnum.templating.files.tem_tokens import Words, words
from cnnum.templating.files.tem_writing import entry_to_tem
from cnnum.templating.function_tables import Table
from cnnum.templating.template import Initial, Template

_SIZE = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d{1,2})?"
_NUMBER = re.compile(_SIZE, re.IGNORECASE)
_FIXED = re.compile(rf"Fixed\s*\(\s*({_SIZE})\s*\)", re.IGNORECASE)
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
            boundary=_boundary(header.get("boundary", "")),
            initial=_initial(header.get("inistate", "")),
            output="sign" if "DT-CNN" in header.get("cnnmodel", "").upper() else "standard",
            description=header.get("function", ""),
            source=f"imported from {file.name}{f' ({said})' if said and not same else ''}",
        )
    except (TemplateError, ArrayError) as error:
        raise TemplateError(f"'{text.file}': {error}") from None
    about = About(header.get("input", ""), header.get("inistate", ""))
    return Entry(template, (), about)


def _boundary(said: str) -> float | str:
    fixed = _FIXED.search(said)
    if fixed:
        return float(fixed[1])
    lower = said.lower()
    return "zero-flux" if "flux" in lower else "periodic" if "periodic" in lower else 0.0


def _initial(said: str) -> Initial:
    given = _GIVEN.search(said)
    if given:
        return float(given[1])
    return float(said) if _NUMBER.fullmatch(said.strip()) else "input" if said else 0.0


def _physics(text: Words, part: Part) -> dict[str, Any]:
    """Return A, B, z, and the nonlinear and delayed couplings."""
    blocks = [(n, block) for n, layer in part.layers.items() for block in layer.blocks]
    layers = max([part.count, *(n + 1 for n in part.layers)])
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
        weights, found = _split(text, part, to, block, layers)
        nonlinear += found
        if block.part != "D":
            kernels[block.part][to, block.source] += _centred(weights, side)
    reads = inputs > 0 or any("u" in (c.neighbour, c.centre) for c in nonlinear)
    parts: dict[str, Any] = {"A": kernels["A"], "z": _biases(part, layers)}
    parts["B"] = kernels["B"] if reads else None
    parts["nonlinear"] = nonlinear
    late = [kernels["delayed A"], kernels["delayed B"][:, : max(inputs, 1) if reads else 0]]
    if part.delay is not None and any(kernel.any() for kernel in late):
        parts["delayed"] = DelayedCoupling(part.delay, *(frozen(kernel) for kernel in late))
    return parts


def _biases(part: Part, layers: int) -> list[float]:
    return [part.layers[n].z if n in part.layers else 0.0 for n in range(layers)]


def _centred(weights: Floats, side: int) -> Floats:
    rim = (side - len(weights)) // 2
    return np.pad(weights, rim)


def _split(
    text: Words, part: Part, to: int, block: Block, layers: int
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
