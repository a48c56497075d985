"""One of Chebyshev's steps, strip by strip: as many levels as its length needs.

Level 0 makes Y₁ of Y₀ = x. Level j makes Y_{j+1} in the place of Y_{j−1}. Level s judges Y_s, and
leaves its rates in the place of Y_{s−1}. So two arrays hold the states of the stages of even and of
odd number. Two more hold the begin of a step. A step that is taken over changes which array is
which. An array that the plan's body sets holds that, the number of stages and their coefficients.
"""

from dataclasses import replace

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.strip_attempt import FOUND, attempt, attempt_rows, figures
from cnnum.engines.opencl.large_arrays.strip_couplings import coupled
from cnnum.engines.opencl.large_arrays.strip_kernel import StripText
from cnnum.engines.opencl.large_arrays.strip_rows import CONTROL, ONES, At, Rows, constant, vector
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.chebyshev_steps import STAGES, count_stages
from cnnum.engines.opencl.transients.names import H
from cnnum.engines.opencl.transients.step_control import ACCEPT, Attempt
from cnnum.integrators.schemes import ChebyshevSteps
from cnnum.integrators.tableau import MAX_STAGES, coefficients

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
"""The same for the stages before one: the last, the one before it, and the one that it reads."""

A, B, RATE, ERROR = ir.names("a b k1 e")
OWN, BACK1, BACK2, WEIGHT = ir.names("own back1 back2 weight")
START_WEIGHT, BEGIN = ir.names("start_weight begin")
"""Variables that hold a stage's weights in all lanes."""

LEVELS, AT = ir.names("levels at")
"""Levels of a step; a variable of loops."""


def chebyshev_attempts(text: TransientBuilder, scheme: ChebyshevSteps) -> Attempt:
    """Return the statements of Chebyshev's steps, and keep their kernel with the tables."""
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
        # a loop of this kind is no sweep, which would be a launch of its own
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
    """Return the statements that take a step over: its end is the begin of the next."""
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
    """Return all levels of a number of rows."""
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
        [make(rows, at) for at in rows.block] for make in (_begin, _next, _judge)
    )
    sums = coupled(rows, "now")
    return [
        rows.case(0, begins, [*head, "const vec begin = (vec)(h * row[2]);"]),
        rows.case(1, [*sums, *nexts], [*head, *stage]),
        rows.case(2, [*sums, *judges], head, FOUND),
    ]


def _begin(rows: Rows, at: At) -> ir.Block:
    state = rows.array("state", at) + BEGIN * rows.array("rates", at)
    return ir.block(vector(B, state), *rows.show(at, B), rows.store("odd", at, B))


def _next(rows: Rows, at: At) -> ir.Block:
    now, before, rates = (rows.array(name, at) for name in ("now", "before", "rates"))
    states = OWN * A + BACK1 * now + BACK2 * before
    held = [ir.Assign(B, rows.free(at, B, A))] if rows.masked else []
    return ir.block(
        constant(A, rows.array("state", at)),
        vector(B, states + WEIGHT * at.sum + START_WEIGHT * rates),
        *held,
        *rows.show(at, B),
        rows.store("old", at, B),
    )


def _judge(rows: Rows, at: At) -> ir.Block:
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
