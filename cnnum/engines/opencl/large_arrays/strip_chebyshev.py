"""The kernel text of one of Chebyshev's steps, strip by strip: as many levels as its length needs.

Level 0 makes Y₁ of Y₀ = x; level j makes Y_{j+1} in the place of Y_{j−1}; level s judges Y_s, and
leaves its rates in the place of Y_{s−1}. So two arrays hold the states of all stages, those of even
number and those of odd, and two more hold the begin of a step. A step that is taken over
changes which array is which. That, how many stages there are and with what coefficients stands in
an array that the plan's body sets.
"""

from dataclasses import replace

from cnnum.engines.opencl.large_arrays.strip_couplings import coupled
from cnnum.engines.opencl.large_arrays.strip_error import figures, judged
from cnnum.engines.opencl.large_arrays.strip_rows import At, Rows
from cnnum.integrators.chebyshev import MAX_STAGES

ARRAYS = ("strip_0", "strip_1", "strip_2", "strip_3")
"""The arrays of states and rates: at first x, k0, then the stages."""

STEP, STAGES_AT, STATE, RATES, EVEN, ODD, ROWS = range(7)
"""The head of the array of control: h; the stages; the numbers of the arrays of x, of its
rates, and of stages of even and odd number; then the method's rows of 4 numbers."""

PLACES = ("state", "rates", "odd", "now", "old", "before")
"""Variables that hold how far the arrays of these are from the first."""

CONTROL = ROWS + 4 * MAX_STAGES
"""Numbers of it."""


def chebyshev_cases(rows: Rows, most: int, block: int) -> list[str]:
    """Return the text of all levels of a number of rows; `most` strips keep their findings."""
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
    begins = [line for at in every for line in _begin(rows, at)]
    sums = coupled(rows, every, own, "now")
    each = [line for at in every for line in _next(rows, at)]
    judges = [line for at in every for line in _judge(rows, at)]
    return [
        *rows.case(0, begins, [*head, "const vec begin = (vec)(h * row[2]);"]),
        *rows.case(1, [*sums, *each], [*head, *stage]),
        *rows.case(2, judged(rows, most, [*sums, *judges]), head),
    ]


def _begin(rows: Rows, at: At) -> list[str]:
    state, rates = rows.array("state", at), rows.array("rates", at)
    lines = [f"vec b = {state} + begin * {rates};", *rows.show(at, "b")]
    return rows.braced([*lines, rows.store("odd", at, "b")])


def _next(rows: Rows, at: At) -> list[str]:
    now, before, rates = (rows.array(name, at) for name in ("now", "before", "rates"))
    lines = [
        f"const vec a = {rows.array('state', at)};",
        f"vec b = own * a + back1 * {now} + back2 * {before} + weight * {at.sum} + "
        f"start_weight * {rates};",
        *([f"b = {rows.free(at, 'b', 'a')};"] if rows.masked else []),
        *rows.show(at, "b"),
        rows.store("old", at, "b"),
    ]
    return rows.braced(lines)


def _judge(rows: Rows, at: At) -> list[str]:
    # Sommeijer, Shampine & Verwer 1998, section 2.2
    rate = rows.free(at, at.sum, "one - one") if rows.masked else at.sum
    states = rows.array("state", at), rows.array("now", at)
    offsets = f"{rows.vector(0.8)} * ({states[0]} - {states[1]})"
    slopes = f"{rows.vector(0.4)} * h * ({rows.array('rates', at)} + k1)"
    lines = [
        f"const vec k1 = {rate};",
        rows.store("old", at, "k1"),
        f"const vec e = magnitude({offsets} + {slopes});",
        *figures(rows, "e", "e", "k1", states),
    ]
    return rows.braced(lines)
