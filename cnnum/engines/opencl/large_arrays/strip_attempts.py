"""Adaptive steps of large arrays, strip by strip: embedded pairs and Chebyshev steps.

Every strip finds the maximum of each error figure over its cells; the plan's body reduces them.

A step of an embedded pair consists of its stages and the error estimate.

The first stage applies the previous step, if it was accepted, and computes the first state. The
last stage finds the largest error in a strip, from which the step is judged.

A Chebyshev step takes as many levels as its length needs.

Level 0 computes Y₁ from Y₀ = x. Level j computes Y_{j+1} in place of Y_{j−1}. Level s estimates the
error of Y_s and leaves its rates in place of Y_{s−1}. Thus two arrays hold the states of even and
odd stages, and two more hold the start of a step. Accepting a step permutes the roles of the
arrays. An array set by the plan's body holds these roles, the number of stages and their
coefficients.
"""

from collections.abc import Sequence
from dataclasses import replace

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.strip_kernel import StripText, apart, strip_kernel
from cnnum.engines.opencl.large_arrays.strip_rows import (
    CONTROL,
    FINDINGS,
    ONES,
    At,
    Rows,
    constant,
    coupled,
    gain_lines,
    strip_rows,
    vector,
)
from cnnum.engines.opencl.transients.builder import TIME, H, TransientBuilder, rates_of
from cnnum.engines.opencl.transients.fixed_steps import STAGES, count_stages
from cnnum.engines.opencl.transients.pair_steps import LEFT_OUT
from cnnum.engines.opencl.transients.step_control import ACCEPT, K0, Attempt, rounding
from cnnum.integrators.estimate import AROUND, LEAST_SLOPE, slopes_count
from cnnum.integrators.schemes import AdaptiveSteps, ChebyshevSteps
from cnnum.integrators.tableau import MAX_STAGES, Pair, Row, coefficients

FIGURES = ("worst", "added", "speed", "change")
"""Results of a step, each a maximum over all cells."""

FOUND = {name: n for n, name in enumerate(FIGURES)}
"""Their indices among the results of a strip."""

STRIP_ATTEMPT_A, STRIP_ATTEMPT_B = ir.names("a b")


def attempt_rows(text: TransientBuilder, arrays: tuple[str, ...], registers: int) -> Rows:
    """Return the rows of arrays, and declare the given number of registers.

    The first two arrays hold the states and the rates at the start.
    """
    rows = strip_rows(text, arrays, tuple(1.0 / float(tau) for tau in text.template.tau))
    rows.declare_findings(registers, len(FIGURES))
    return rows


def attempt(
    rows: Rows,
    own: StripText,
    levels: int,
    settings: Sequence[ir.Statement],
    *,
    begin: Sequence[ir.Statement],
    advance: Sequence[ir.Statement],
    counted: ir.Name | None = None,
) -> Attempt:
    """Return the statements of steps, and add their kernel to the tables.

    Parameters
    ----------
    rows : Rows
    own : StripText
    levels : int
        Maximum number of levels per step.
    settings, begin, advance : sequence of Statement
        Statements that set the registers before each step, before all of them, and after each.
    counted : Name, optional
        Variable of the plan's body that holds the number of levels of a frame.
    """
    _, rates, *_ = rows.offsets
    rest = [rows.brought(rates, K0.text)]
    strips = strip_kernel(rows, replace(own, rest=rest, findings=len(FIGURES)), levels)
    brought, stages, end = apart(strips)
    result = [
        ir.Accumulate(ir.Name(name), "greater", FINDINGS[ir.Integer(n * rows.finding) + ir.CELL])
        for name, n in FOUND.items()
    ]
    return Attempt(
        begin=[*begin, brought],
        stages=[*settings, ir.StripSteps(stages, counted)],
        judge=[ir.sweep(ir.CELL, rows.finding, result)],
        advance=advance,
        end=[end],
    )


def figures(
    rows: Rows,
    error: ir.Expression,
    left_out: ir.Expression,
    rate: ir.Name,
    states: tuple[ir.Expression, ir.Expression],
) -> list[ir.Statement]:
    """Return the statements that update the error figures by the cells of a row.

    Parameters
    ----------
    rows : Rows
    error, left_out : Expression
        The step's error estimate, and its contribution to the tracked error.
    rate : Name
        The rates at the step's end.
    states : (Expression, Expression)
        States before the step and at its end.
    """
    text, empty = rows.text, rows.empty
    tau = ir.Number(float(text.template.tau.max()))
    atol, rtol = ir.Number(text.solver.atol), ir.Number(text.solver.rtol)
    judgement = (
        error
        / (
            atol
            + rtol * ir.Choice(STRIP_ATTEMPT_A < STRIP_ATTEMPT_B, STRIP_ATTEMPT_B, STRIP_ATTEMPT_A)
        ),
        left_out + rounding(text) * STRIP_ATTEMPT_B,
        _passed_on(rows, rate),
        tau * ir.call("magnitude", rate) / (atol + rtol * STRIP_ATTEMPT_B),
    )
    lines = [
        constant(name, ir.call("magnitude", state))
        for name, state in zip((STRIP_ATTEMPT_A, STRIP_ATTEMPT_B), states, strict=True)
    ]
    for name, figure in zip(FIGURES, judgement, strict=True):
        value = figure if empty is None else ir.Choice(empty, ONES - ONES, figure)
        lines.append(ir.Accumulate(ir.Name(name), "greatest", value))
    return lines


def _passed_on(rows: Rows, rate: ir.Name) -> ir.Expression:
    """Return |dx/dt| times a cell's error propagation factor; outputs of strips are odd
    functions.
    """
    size = ir.call("magnitude", rate)
    if not slopes_count(rows.text.template):
        return size
    around, half = ir.Number(AROUND), ir.Number(0.5 / AROUND)
    rise = ir.call("shown", STRIP_ATTEMPT_B + around, ONES) - ir.call(
        "shown", STRIP_ATTEMPT_B - around, ONES
    )
    slope, least = half * ir.call("magnitude", rise), ir.Number(LEAST_SLOPE)
    return ir.Choice(slope < least, ONES * least, slope) * size


LENGTH, MOVED, BEGINS = range(3)
"""Registers: h, whether the previous step was accepted, and when this one begins."""

MOVED_NOW, STRIP_PAIR_A, STRIP_PAIR_B = ir.names("moved a b")
OFF = ir.Name("off")
"""The error estimate of a pair."""


def pair_attempts(text: TransientBuilder, scheme: AdaptiveSteps) -> Attempt:
    """Return the statements of a pair's steps, and add their kernel to the tables."""
    stages = scheme.tableau.stages
    later_rates = sorted({_rates_at(scheme, n) for n in range(1, stages)})
    rows = attempt_rows(text, ("strip_x", "strip_k0", "strip_xs", *later_rates), 3)
    own = StripText(
        f"number % {stages}",
        lambda rows: _pair_cases(rows, scheme),
        end=f"({rows.register(MOVED)} != 0 ? {rows.at('strip_xs')} : 0)",
    )
    return attempt(
        rows,
        own,
        stages,
        [ir.Assign(CONTROL[LENGTH], H), ir.Assign(CONTROL[BEGINS], TIME)],
        begin=[ir.Assign(CONTROL[MOVED], ir.ZERO)],
        advance=[ir.Assign(CONTROL[MOVED], ACCEPT)],
    )


def _rates_at(scheme: AdaptiveSteps, stage: int) -> str:
    """Return the name of the array that holds the rates of a stage.

    New rates replace earlier ones that this stage reads for the last time, which takes a fifth less
    memory. Those at the start stay, since a step that is not accepted begins again from them.
    """
    last = scheme.tableau.stages - 1
    readers = list[tuple[Row, int]]()
    for tableau in scheme.tableaux:
        readers += [(row, number - 1) for number, row in enumerate(tableau.a)]
        readers += [(row, last) for row in (tableau.error, *tableau.truncation)]
    until = [
        max([n, *(stage for row, stage in readers if n < len(row) and row[n])])
        for n in range(last + 1)
    ]
    places, taken = [0], dict[int, int]()
    for n in range(1, last + 1):
        free = [place for place, end in taken.items() if end <= n]
        places.append(min(free, default=len(taken) + 1))
        taken[places[-1]] = until[n]
    return f"strip_k{places[stage]}"


def _pair_cases(rows: Rows, scheme: AdaptiveSteps) -> list[ir.Case]:
    """Return all stages for a block of rows."""
    last, length = scheme.tableau.stages - 1, rows.register(LENGTH)
    head = [f"const vec h = (vec)({length});"]
    first = [_first(rows, scheme, at) for at in rows.block]
    moved = f"const int moved = {rows.register(MOVED)} != 0;"
    cases = [rows.case(0, first, [*head, moved])]
    for stage in range(1, last + 1):
        c = rows.text.literal(float(sum(scheme.tableau.a[stage])))
        gains = gain_lines(rows.text, f"{rows.register(BEGINS)} + {c} * {length}")
        end, places = (_strip_pair_judge, FOUND) if stage == last else (_strip_pair_next, None)
        body = coupled(rows, "strip_xs")
        body += [end(rows, scheme, stage, at) for at in rows.block]
        cases.append(rows.case(stage, body, [*head, *gains], places))
    return cases


def _first(rows: Rows, scheme: AdaptiveSteps, at: At) -> ir.Block:
    tableau = scheme.of(at.layer)
    before = ir.Choice(MOVED_NOW, rows.array("strip_xs", at), rows.array("strip_x", at))
    last = rows.array(_rates_at(scheme, tableau.stages - 1), at)
    rates = ir.Choice(MOVED_NOW, last, rows.array("strip_k0", at))
    return ir.block(
        constant(STRIP_PAIR_A, before),
        constant(rates_of(0), rates),
        rows.store("strip_x", at, STRIP_PAIR_A),
        rows.store("strip_k0", at, rates_of(0)),
        *_moved(rows, tableau, 1, at),
    )


def _strip_pair_next(rows: Rows, scheme: AdaptiveSteps, stage: int, at: At) -> ir.Block:
    tableau = scheme.of(at.layer)
    return ir.block(
        *_rates(rows, scheme, [tableau.a[stage + 1]], stage, at),
        constant(STRIP_PAIR_A, rows.array("strip_x", at)),
        *_moved(rows, tableau, stage + 1, at),
    )


def _moved(rows: Rows, tableau: Pair, stage: int, at: At) -> list[ir.Statement]:
    """Return the statements that compute the state of a stage and its outputs."""
    state = vector(STRIP_PAIR_B, STRIP_PAIR_A + H * _combination(tableau.a[stage]))
    return [state, *rows.show(at, STRIP_PAIR_B), rows.store("strip_xs", at, STRIP_PAIR_B)]


def _rates(
    rows: Rows, scheme: AdaptiveSteps, weights: list[Row], stage: int, at: At
) -> list[ir.Statement]:
    """Return the statements that load the weighted earlier rates, and then store the stage's."""
    rate: ir.Expression = at.sum
    if rows.text.template.output.limited:
        rate = ir.call("inwards", at.sum, rows.array("strip_xs", at), ONES)
    k = rates_of(stage)
    wanted = [n for n in range(stage) if any(n < len(row) and row[n] for row in weights)]
    return [
        constant(k, rows.free(at, rate, ONES - ONES)),
        *(constant(rates_of(n), rows.array(_rates_at(scheme, n), at)) for n in wanted),
        rows.store(_rates_at(scheme, stage), at, k),
    ]


def _combination(weights: Row) -> ir.Expression:
    terms = [ir.Number(float(w)) * rates_of(n) for n, w in enumerate(weights) if w]
    return ir.total(terms) if terms else ir.Number(0.0)


def _strip_pair_judge(rows: Rows, scheme: AdaptiveSteps, last: int, at: At) -> ir.Block:
    """Return the statements that update the largest error of a step by a row, and its end."""
    tableau = scheme.of(at.layer)
    *parts, error = (
        ir.call("magnitude", H * _combination(weights))
        for weights in (*tableau.truncation, tableau.error)
    )
    off: ir.Expression = error
    left_out = ir.total(parts)
    lines = list[ir.Statement]()
    if scheme.bends:
        lines = [constant(LEFT_OUT, left_out), constant(OFF, error)]
        left_out, off = LEFT_OUT, ir.Choice(OFF < LEFT_OUT, LEFT_OUT, OFF)
    states = rows.array("strip_x", at), rows.array("strip_xs", at)
    return ir.block(
        *_rates(rows, scheme, [tableau.error, *tableau.truncation], last, at),
        *lines,
        *figures(rows, off, left_out, rates_of(last), states),
    )


ARRAYS = ("strip_0", "strip_1", "strip_2", "strip_3")
"""The arrays of states and rates: at first x, k0, then the stages."""

STEP, STAGES_AT, STATE, RATES, EVEN, ODD, ROWS = range(7)
"""Registers: h; the stages; the numbers of the arrays of x, of its rates, and of even and odd
stages. Then the method's rows of 4 numbers."""

SIZE = ROWS + 4 * MAX_STAGES
"""The number of registers."""

PLACES = {"state": STATE, "rates": RATES, "even": EVEN, "odd": ODD}
"""Variables that hold which arrays these are, and then how far they are from the first."""

STAGE_PLACES = ("now", "old", "before")
"""The same for earlier stages: the last, the one before it, and the one that it reads."""

STRIP_CHEBYSHEV_A, STRIP_CHEBYSHEV_B, RATE, ERROR = ir.names("a b k1 e")
OWN, BACK1, BACK2, WEIGHT = ir.names("own back1 back2 weight")
START_WEIGHT, BEGIN = ir.names("start_weight begin")
"""Variables that hold a stage's weights, broadcast to all lanes."""

LEVELS, AT = ir.names("levels at")
"""Levels of a step; a variable of loops."""


def chebyshev_attempts(text: TransientBuilder, scheme: ChebyshevSteps) -> Attempt:
    """Return the statements of Chebyshev steps, and add their kernel to the tables."""
    table = text.tables.data(coefficients())
    rows, size = attempt_rows(text, ARRAYS, SIZE), SIZE - ROWS
    stages = f"(int){rows.register(STAGES_AT)}"
    own = StripText(
        f"number == 0 ? 0 : number < {stages} ? 1 : 2",
        _chebyshev_cases,
        end=f"(int){rows.register(STATE)} * {rows.at(ARRAYS[1])}",
        count=f"min(most, {stages} + 1 - done)",
    )
    row = text.tables.number_at(ir.Integer(table) + STAGES * size + AT)
    next_row = ir.Assign(CONTROL[ir.Integer(ROWS) + AT], row)
    settings = [
        *count_stages(scheme),
        ir.Assign(CONTROL[STEP], H),
        ir.Assign(CONTROL[STAGES_AT], ir.Cast("real", STAGES)),
        # a loop of this kind is not a sweep, which would be a separate launch
        ir.declare(AT, 0, of="int"),
        ir.While(AT < size, (next_row, ir.Assign(AT, ir.Integer(1), "+="))),
        ir.fixed(LEVELS, STAGES + 1, of="int"),
    ]
    return attempt(
        rows,
        own,
        MAX_STAGES + 1,
        settings,
        begin=[ir.Assign(CONTROL[at], ir.real(n)) for n, at in enumerate(PLACES.values())],
        advance=_changed_places(),
        counted=LEVELS,
    )


def _changed_places() -> list[ir.Statement]:
    """Return the statements that accept a step: its end becomes the start of the next."""
    state, rates, even, odd = map(ir.Name, PLACES)
    changed = (STAGES % 2).differs(0)
    places = tuple((ir.Name(name), CONTROL[at]) for name, at in PLACES.items())
    taken = (
        ir.Declare("real", places, fixed=True),
        ir.Assign(CONTROL[STATE], ir.pick(changed, odd, even)),
        ir.Assign(CONTROL[RATES], ir.pick(changed, even, odd)),
        ir.Assign(CONTROL[EVEN], state),
        ir.Assign(CONTROL[ODD], rates),
    )
    return [ir.Branch(ACCEPT.differs(ir.ZERO), taken)]


def _chebyshev_cases(rows: Rows) -> list[ir.Case]:
    """Return all levels for a block of rows."""
    offsets, far = rows.offsets, rows.at(ARRAYS[1])
    rows = replace(rows, offsets=offsets | {name: name for name in (*PLACES, *STAGE_PLACES)})
    head = [
        f"__global const scalar *const control = x + {offsets[CONTROL.text]};",
        f"__global const scalar *const row = control + {ROWS} + 4 * number;",
        f"const scalar h = control[{STEP}];",
        *(f"const int {name} = (int)control[{at}] * {far};" for name, at in PLACES.items()),
        "const int now = number & 1 ? odd : even, old = number & 1 ? even : odd;",
    ]
    stage = [
        "const int before = number == 1 ? state : old;",
        "const vec own = (vec)((scalar)1 - row[0] - row[1]);",
        "const vec back1 = (vec)(row[0]), back2 = (vec)(row[1]);",
        "const vec weight = (vec)(h * row[2]), start_weight = (vec)(h * row[3]);",
    ]
    begins, nexts, judges = (
        [make(rows, at) for at in rows.block]
        for make in (_begin, _strip_chebyshev_next, _strip_chebyshev_judge)
    )
    sums = coupled(rows, "now")
    return [
        rows.case(0, begins, [*head, "const vec begin = (vec)(h * row[2]);"]),
        rows.case(1, [*sums, *nexts], [*head, *stage]),
        rows.case(2, [*sums, *judges], head, FOUND),
    ]


def _begin(rows: Rows, at: At) -> ir.Block:
    state = rows.array("state", at) + BEGIN * rows.array("rates", at)
    return ir.block(
        vector(STRIP_CHEBYSHEV_B, state),
        *rows.show(at, STRIP_CHEBYSHEV_B),
        rows.store("odd", at, STRIP_CHEBYSHEV_B),
    )


def _strip_chebyshev_next(rows: Rows, at: At) -> ir.Block:
    now, before, rates = (rows.array(name, at) for name in ("now", "before", "rates"))
    states = OWN * STRIP_CHEBYSHEV_A + BACK1 * now + BACK2 * before
    held = (
        [ir.Assign(STRIP_CHEBYSHEV_B, rows.free(at, STRIP_CHEBYSHEV_B, STRIP_CHEBYSHEV_A))]
        if rows.masked
        else []
    )
    return ir.block(
        constant(STRIP_CHEBYSHEV_A, rows.array("state", at)),
        vector(STRIP_CHEBYSHEV_B, states + WEIGHT * at.sum + START_WEIGHT * rates),
        *held,
        *rows.show(at, STRIP_CHEBYSHEV_B),
        rows.store("old", at, STRIP_CHEBYSHEV_B),
    )


def _strip_chebyshev_judge(rows: Rows, at: At) -> ir.Block:
    # Sommeijer, Shampine & Verwer 1998, section 2.2
    states = rows.array("state", at), rows.array("now", at)
    offsets = ir.Number(0.8) * (states[0] - states[1])
    slopes = ir.Number(0.4) * H * (rows.array("rates", at) + RATE)
    return ir.block(
        constant(RATE, rows.free(at, at.sum, ONES - ONES)),
        rows.store("old", at, RATE),
        constant(ERROR, ir.call("magnitude", offsets + slopes)),
        *figures(rows, ERROR, ERROR, RATE, states),
    )
