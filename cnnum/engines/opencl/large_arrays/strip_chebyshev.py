"""One of Chebyshev's steps, strip by strip: as many levels as its length needs.

Level 0 makes Y₁ of Y₀ = x; level j makes Y_{j+1} in the place of Y_{j−1}; level s judges Y_s, and
leaves its rates in the place of Y_{s−1}. So two arrays hold the states of the stages of even and of
odd number. Two more hold the begin of a step. A step that is taken over changes which array is
which. An array that the plan's body sets holds that, the number of stages and their coefficients.
"""

from dataclasses import replace

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.strip_couplings import coupled
from cnnum.engines.opencl.large_arrays.strip_error import A, B, figures, judged, magnitude
from cnnum.engines.opencl.large_arrays.strip_rows import ONES, At, Rows, constant, vector
from cnnum.engines.opencl.transients.step_control import H
from cnnum.integrators.chebyshev import MAX_STAGES

ARRAYS = ("strip_0", "strip_1", "strip_2", "strip_3")
"""The arrays of states and rates: at first x, k0, then the stages."""

STEP, STAGES_AT, STATE, RATES, EVEN, ODD, ROWS = range(7)
"""The head of the array of control: h; the stages; the numbers of the arrays of x, of its
rates, and of stages of even and odd number; then the method's rows of 4 numbers."""

PLACES = ("state", "rates", "odd", "now", "old", "before")
"""Variables that hold how far the arrays of these are from the first."""

OWN, BACK1, BACK2, WEIGHT = ir.names("own back1 back2 weight")
START_WEIGHT, BEGIN = ir.names("start_weight begin")
"""Variables that hold a stage's weights in all lanes."""

CONTROL = ROWS + 4 * MAX_STAGES
"""Numbers of it."""


def chebyshev_cases(rows: Rows, block: int) -> list[ir.Case]:
    """Return all levels of a number of rows."""
    offsets = rows.offsets[ARRAYS[1]]
    rows = replace(rows, offsets={**rows.offsets, **{name: name for name in PLACES}})
    every, own = rows.block(block), tuple(-scale for scale in rows.scales)
    places = {"state": STATE, "rates": RATES, "even": EVEN, "odd": ODD}
    head = [
        f"__global const scalar *const control = x + {rows.offsets['strip_control']};",
        f"__global const scalar *const row = control + {ROWS} + 4 * number;",
        f"const scalar h = control[{STEP}];",
        *(f"const int {name} = (int)control[{n}] * {offsets};" for name, n in places.items()),
        "const int now = number & 1 ? odd : even, old = number & 1 ? even : odd;",
    ]
    stage = [
        "const int before = number == 1 ? state : old;",
        "const vec own = (vec)((scalar)1 - row[0] - row[1]);",
        "const vec back1 = (vec)(row[0]), back2 = (vec)(row[1]);",
        "const vec weight = (vec)(h * row[2]), start_weight = (vec)(h * row[3]);",
    ]
    begins = [_begin(rows, at) for at in every]
    sums = coupled(rows, every, own, "now")
    each = [_next(rows, at) for at in every]
    judges = [_judge(rows, at) for at in every]
    return [
        rows.case(0, begins, [*head, "const vec begin = (vec)(h * row[2]);"]),
        rows.case(1, [*sums, *each], [*head, *stage]),
        rows.case(2, judged(rows, [*sums, *judges]), head),
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
    rate = rows.free(at, at.sum, ONES - ONES) if rows.masked else at.sum
    k1, error = ir.Name("k1"), ir.Name("e")
    states = rows.array("state", at), rows.array("now", at)
    offsets = ir.Number(0.8) * (states[0] - states[1])
    slopes = ir.Number(0.4) * H * (rows.array("rates", at) + k1)
    return ir.block(
        constant(k1, rate),
        rows.store("old", at, k1),
        constant(error, magnitude(offsets + slopes)),
        *figures(rows, error, error, k1, states),
    )
