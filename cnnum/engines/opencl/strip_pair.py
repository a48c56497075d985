"""The kernel text of one step of a pair that estimates its own error: its stages, and the estimate.

The first stage takes over the step before, if it was accepted, and makes the first state; the last
one finds the worst of the error in a strip, and leaves the step to be judged.
"""

import numpy as np

from cnnum.engines.opencl.strip_rows import At, Rows
from cnnum.integrators.estimate import ROUNDINGS
from cnnum.integrators.schemes import AdaptiveSteps
from cnnum.integrators.tableau import Pair, Row

FIGURES = ("worst", "added", "speed", "change")
"""What is found of a step: the largest of each in all cells."""


def pair_cases(rows: Rows, scheme: AdaptiveSteps, most: int, block: int) -> list[str]:
    """Return the text of all stages of so many rows; `most` strips keep what they find."""
    last, lines = scheme.tableau.stages - 1, list[str]()
    every, own = rows.block(block), tuple(-scale for scale in rows.scales)
    head = [
        f"const vec h = (vec)(x[{rows.apart['strip_control']}]);",
        f"const int moved = x[{rows.apart['strip_control']} + 1] != 0;",
    ]
    first = [line for at in every for line in _first(rows, scheme.of(at.layer), at)]
    lines += rows.case(0, [*head, *first])
    for stage in range(1, last):
        each = rows.coupled(every, own, "strip_xs")
        each += [line for at in every for line in _next(rows, scheme.of(at.layer), stage, at)]
        lines += rows.case(stage, [head[0], *each])
    each = rows.coupled(every, own, "strip_xs")
    each += [line for at in every for line in _judge(rows, scheme.of(at.layer), at)]
    size = rows.layout.width
    places = [
        f"*(__global vec *)(x + {rows.apart['strip_maxima'] + n * most * size} + piece * {size})"
        for n in range(len(FIGURES))
    ]
    loaded = [f"vec {name} = {at};" for name, at in zip(FIGURES, places, strict=True)]
    kept = [f"{at} = {name};" for name, at in zip(FIGURES, places, strict=True)]
    return lines + rows.case(last, [head[0], *loaded, *each, *kept])


def _first(rows: Rows, tableau: Pair, at: At) -> list[str]:
    last = tableau.stages - 1
    lines = [
        f"const vec a = moved ? {rows.array('strip_xs', at)} : {rows.array('strip_x', at)};",
        f"const vec k0 = moved ? {rows.array(f'strip_k{last}', at)} : "
        f"{rows.array('strip_k0', at)};",
        rows.store("strip_x", at, "a"),
        rows.store("strip_k0", at, "k0"),
        *_moved(rows, tableau, 1, at),
    ]
    return _block(lines)


def _next(rows: Rows, tableau: Pair, stage: int, at: At) -> list[str]:
    lines = _rate(rows, stage, at)
    lines += _loaded(rows, [tableau.a[stage + 1]], stage, at)
    lines.append(f"const vec a = {rows.array('strip_x', at)};")
    return _block([*lines, *_moved(rows, tableau, stage + 1, at)])


def _moved(rows: Rows, tableau: Pair, stage: int, at: At) -> list[str]:
    """Return the text that makes the state of a stage, and its outputs."""
    return [
        f"vec b = a + h * ({_combination(rows, tableau.a[stage])});",
        *rows.show(at, "b"),
        rows.store("strip_xs", at, "b"),
    ]


def _rate(rows: Rows, stage: int, at: At) -> list[str]:
    rate = at.sum
    if rows.text.template.output.limited:
        rate = f"inwards({at.sum}, {rows.array('strip_xs', at)}, one)"
    if rows.masked:
        rate = rows.free(at, rate, "one - one")
    return [f"const vec k{stage} = {rate};", rows.store(f"strip_k{stage}", at, f"k{stage}")]


def _loaded(rows: Rows, weights: list[Row], stage: int, at: At) -> list[str]:
    """Return the text that loads what is weighted, but for the stage's own rate."""
    wanted = [n for n in range(stage) if any(n < len(row) and row[n] for row in weights)]
    return [f"const vec k{n} = {rows.array(f'strip_k{n}', at)};" for n in wanted]


def _combination(rows: Rows, weights: Row) -> str:
    terms = [f"{rows.vector(float(w))} * k{n}" for n, w in enumerate(weights) if w]
    return " + ".join(terms) or rows.vector(0.0)


def _judge(rows: Rows, tableau: Pair, at: At) -> list[str]:
    """Return the text that takes a row into the worst error of a step, and what its end is."""
    text, last = rows.text, tableau.stages - 1
    tau = rows.vector(float(text.template.tau.max()))
    rounding = rows.vector(ROUNDINGS * float(np.finfo(text.tables.dtype).eps))
    atol, rtol = rows.vector(text.solver.atol), rows.vector(text.solver.rtol)
    parts = [
        f"magnitude(h * ({_combination(rows, d)}))" for d in (*tableau.truncation, tableau.error)
    ]
    error = parts.pop()
    lines = [
        *_rate(rows, last, at),
        *_loaded(rows, [tableau.error, *tableau.truncation], last, at),
        f"const vec a = magnitude({rows.array('strip_x', at)});",
        f"const vec b = magnitude({rows.array('strip_xs', at)});",
        f"vec found = {error} / ({atol} + {rtol} * (a < b ? b : a));",
        _most(rows, "worst", "found"),
        f"found = {' + '.join(parts)} + {rounding} * b;",
        _most(rows, "added", "found"),
        f"found = magnitude(k{last});",
        _most(rows, "speed", "found"),
        f"found = {tau} * found / ({atol} + {rtol} * b);",
        _most(rows, "change", "found"),
    ]
    return _block(lines)


def _most(rows: Rows, name: str, found: str) -> str:
    """Return the statement that keeps the larger number; what is no cell has none."""
    if "strip_cells" not in rows.apart:
        return f"{name} = greatest({name}, {found});"
    cells = f"*(__global const vec *)(x + {rows.apart['strip_cells']} + p - start)"
    return f"{name} = greatest({name}, {cells} < one ? one - one : {found});"


def _block(lines: list[str]) -> list[str]:
    return ["{", *(f"    {line}" for line in lines), "}"]
