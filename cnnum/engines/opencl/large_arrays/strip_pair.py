"""The kernel text of one step of a pair that estimates its own error: its stages, and the estimate.

The first stage takes over the step before, if it was accepted, and makes the first state; the last
one finds the worst of the error in a strip, and leaves the step to be judged.
"""

from cnnum.engines.opencl.large_arrays.strip_couplings import coupled
from cnnum.engines.opencl.large_arrays.strip_error import figures, judged
from cnnum.engines.opencl.large_arrays.strip_rows import At, Rows
from cnnum.engines.opencl.large_arrays.strip_times import gain_lines
from cnnum.integrators.schemes import AdaptiveSteps
from cnnum.integrators.tableau import Pair, Row

LENGTH, MOVED, BEGINS = range(3)
"""Places in the array of control: h, whether the step before was accepted, when this one begins."""


def pair_cases(rows: Rows, scheme: AdaptiveSteps, most: int, block: int) -> list[str]:
    """Return the text of all stages of a number of rows; `most` strips keep their findings."""
    last, lines = scheme.tableau.stages - 1, list[str]()
    every, own = rows.block(block), tuple(-scale for scale in rows.scales)
    control = rows.offsets["strip_control"]
    length = f"x[{control} + {LENGTH}]"
    head = [f"const vec h = (vec)({length});"]

    def at_stage(stage: int) -> list[str]:
        c = rows.text.literal(float(sum(scheme.tableau.a[stage])))
        return [*head, *gain_lines(rows.text, f"x[{control} + {BEGINS}] + {c} * {length}")]

    first = [line for at in every for line in _first(rows, scheme.of(at.layer), at)]
    lines += rows.case(0, first, [*head, f"const int moved = x[{control} + {MOVED}] != 0;"])
    for stage in range(1, last):
        each = coupled(rows, every, own, "strip_xs")
        each += [line for at in every for line in _next(rows, scheme.of(at.layer), stage, at)]
        lines += rows.case(stage, each, at_stage(stage))
    each = coupled(rows, every, own, "strip_xs")
    each += [line for at in every for line in _judge(rows, scheme.of(at.layer), at)]
    return lines + rows.case(last, judged(rows, most, each), at_stage(last))


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
    return rows.braced(lines)


def _next(rows: Rows, tableau: Pair, stage: int, at: At) -> list[str]:
    lines = _rate(rows, stage, at)
    lines += _loaded(rows, [tableau.a[stage + 1]], stage, at)
    lines.append(f"const vec a = {rows.array('strip_x', at)};")
    return rows.braced([*lines, *_moved(rows, tableau, stage + 1, at)])


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
    """Return the text that loads the weighted rates, but for the stage's own rate."""
    wanted = [n for n in range(stage) if any(n < len(row) and row[n] for row in weights)]
    return [f"const vec k{n} = {rows.array(f'strip_k{n}', at)};" for n in wanted]


def _combination(rows: Rows, weights: Row) -> str:
    terms = [f"{rows.vector(float(w))} * k{n}" for n, w in enumerate(weights) if w]
    return " + ".join(terms) or rows.vector(0.0)


def _judge(rows: Rows, tableau: Pair, at: At) -> list[str]:
    """Return the text that takes a row into the worst error of a step, and its end."""
    last = tableau.stages - 1
    parts = [
        f"magnitude(h * ({_combination(rows, d)}))" for d in (*tableau.truncation, tableau.error)
    ]
    error = parts.pop()
    lines = [*_rate(rows, last, at)]
    lines += _loaded(rows, [tableau.error, *tableau.truncation], last, at)
    states = rows.array("strip_x", at), rows.array("strip_xs", at)
    return rows.braced([*lines, *figures(rows, error, " + ".join(parts), f"k{last}", states)])
