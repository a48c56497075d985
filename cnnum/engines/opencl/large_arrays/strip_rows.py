"""Rows of strips: time levels, loads and stores, and neighbourhood sums.

Neighbourhood sums in a strip's rows.

A loaded output is used for all cells of the block that it is a neighbour of.

Times of the levels, and reads of earlier levels.

Couplings may vary in time. Delayed ones read the outputs at the start of the step one delay ago: a
ring buffer keeps those of all steps since, and delayed inputs change once the delay has elapsed.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np

from cnnum import kernels as ir
from cnnum.arrays import Floats
from cnnum.engines.opencl.large_arrays.lane_layout import (
    RowLayout,
    block_rows,
    inputs_of,
    row_layout,
)
from cnnum.engines.opencl.transients import builder
from cnnum.engines.opencl.transients.builder import (
    TransientBuilder,
    shares_products,
    weighted_terms,
)
from cnnum.engines.opencl.transients.couplings import (
    Reads,
    V,
    constant_drive,
    gain_name,
    gains,
    summed,
)
from cnnum.integrators.schemes import FixedSteps
from cnnum.kernels.number_types import in_vectors
from cnnum.kernels.printer import OpenCLPrinter
from cnnum.templating.couplings import Quantity
from cnnum.templating.network import Tap, delays_outputs, lag, moving_inputs, reads_states, taps

LEVELS = 32
"""Maximum stages per launch: the gap between strips grows with them. Euler steps of 512×512 cells
take four fifths of their time with 8 (AMD EPYC)."""

LEAST_LEVELS = 8
"""Minimum stages per launch, even if their rows do not fit the cache."""

SHARES = 8
"""Minimum number of strips per array."""

OUTPUTS = ("strip_even", "strip_odd")
"""Arrays of outputs after an even and an odd number of levels."""

SEEN = ("strip_states_even", "strip_states_odd")
"""The same for states, if couplings read those of neighbours."""

LATER = "strip_later"
"""The array of the cells' drive once the delay has elapsed."""

DRIVE = "strip_w"
"""The array of the cells' drive."""

HELD = "strip_held"
"""The array that is 1 where a mask holds a cell fixed, else 0."""

HELD_CELLS = ir.Name("held")
"""The same, in the ordinary cell order."""

CONTROL, FINDINGS = ir.names("strip_control strip_findings")
"""The arrays of registers shared by the plan's body and the strips, and of the strips' results. A
result is the maximum of a quantity over a strip's cells, per lane."""

CELLS = "strip_cells"
"""The array that is 1 where an element of a row is a cell, else 0; absent if all are cells."""

NEW_STATES = "new_states"
"""The destination of states that couplings read from neighbours."""

X, TO, P, START = ir.names("x to p start")
"""The arrays of states and of new outputs, and the indices of a vector and of a row's first."""

ONES = ir.Name("one")
"""1 in every lane."""


class At(NamedTuple):
    """A row of a block, in a layer."""

    layer: int
    row: int

    @property
    def sum(self) -> ir.Name:
        """The sum of the cells' couplings."""
        return ir.Name(f"s{self.layer}_{self.row}")


@dataclass(frozen=True, slots=True)
class Rows:
    """Writes the statements for a few rows.

    Attributes
    ----------
    text : TransientBuilder
    layout : RowLayout
    scales : tuple of float
        The factor of each layer's couplings and drive.
    offsets : dict of str to int or str
        Offset of each array from the array of states, as a number or the name of a variable.
    levels, strips : int
        Levels per launch, and the strips that are then high enough.
    high : int
        Number of rows.
    """

    text: TransientBuilder
    layout: RowLayout
    scales: tuple[float, ...]
    offsets: dict[str, int | str]
    levels: int
    strips: int
    high: int

    def declare(self, name: str, length: int) -> None:
        """Append another array."""
        places, first = self.text.arena.places, next(iter(self.offsets))
        self.text.array(ir.Name(name), length)
        self.offsets[name] = places[name] - places[first]

    def at(self, name: str) -> int:
        """Return the offset of an array from the first."""
        return int(self.offsets[name])

    def declare_findings(self, registers: int, findings: int) -> None:
        """Append the arrays of registers, and of results per strip."""
        self.declare(CONTROL.text, registers)
        self.declare(FINDINGS.text, findings * self.finding)
        if self.span > self.layout.cols:
            self.declare(CELLS, self.span)

    @property
    def finding(self) -> int:
        """Size of a result in the lanes of all strips."""
        return self.strips * self.layout.width

    def register(self, place: int) -> str:
        """Return the expression of a register that the plan's body sets."""
        return f"x[{self.at(CONTROL.text)} + {place}]"

    @property
    def empty(self) -> ir.Expression | None:
        """Mask of lanes without a cell, or None if all have one."""
        if CELLS not in self.offsets:
            return None
        return ir.Load(X + self.at(CELLS) + P - START) < ONES

    @property
    def span(self) -> int:
        """Numbers of a row of a layer."""
        return self.layout.length * self.layout.width

    @property
    def block(self) -> list[At]:
        """The rows, in all layers."""
        return [At(layer, row) for layer in range(self.text.layers) for row in range(self.high)]

    def case(
        self,
        number: int,
        body: Sequence[ir.Statement],
        head: Iterable[str | ir.Statement] = (),
        findings: Mapping[str, int | str] | None = None,
    ) -> ir.Case:
        """Return the case that processes the rows from `start` on, vector by vector.

        Statements in `head` come first. The `findings` are the result vectors that these update, by
        name, with their indices among those of a strip. They are stored after each vector: keeping
        them in registers made steps of the Dormand–Prince pair a third slower.
        """
        kept = {f"*finding(x, {n}, piece)": name for name, n in (findings or {}).items()}
        before = [f"vec {name} = {place};" for place, name in kept.items()]
        after = [f"{place} = {name};" for place, name in kept.items()]
        stage_body = (*map(_statement, before), *body, *map(_statement, after))
        vectors = ir.Loop(P, START + self.span, stage_body, start=START, step=self.layout.width)
        return ir.Case(number, (*map(_statement, head), vectors))

    def numbers(self) -> dict[str, int | str]:
        """Return the sizes of strips and of their results that the kernel template refers to."""
        return {
            "levels": self.levels,
            "strips": self.strips,
            "found": self.offsets.get(FINDINGS.text, 0),
            "marked": self.span if CELLS in self.offsets else 0,
            "marks": self.offsets.get(CELLS, 0),
        }

    def lines(self, cases: Iterable[ir.Case]) -> list[str]:
        """Return the vector code of cases."""
        numbers = in_vectors(self.text.tables.printer.numbers)
        return OpenCLPrinter(numbers, {"clamp": "between"}).lines(cases)

    def array(self, name: str, at: At) -> ir.Load:
        """Return the cells of an array."""
        return self.cells(self.base(name), at)

    def base(self, name: str) -> ir.Expression:
        """Return where an array begins."""
        offset = self.offsets[name]
        if isinstance(offset, str):
            return X + ir.Name(offset)
        return X + offset if offset else X

    def store(self, name: str, at: At, value: ir.Expression) -> ir.Store:
        """Return the statement that stores the cells of an array."""
        return ir.Store(self.place(self.base(name), at), value)

    def new(self, at: At, value: ir.Expression) -> ir.Store:
        """Return the statement that stores what the next level reads from neighbours."""
        return ir.Store(self.place(TO, at), value)

    def show(self, at: At, state: ir.Name) -> list[ir.Statement]:
        """Return the statements that store a new state's outputs, and limit the state."""
        shown, limited = ir.call("shown", state, ONES), self.text.template.output.limited
        lines: list[ir.Statement] = [ir.Assign(state, shown)] if limited else []
        lines.append(self.new(at, state if limited else shown))
        if reads_states(self.text.template):
            lines.append(ir.Store(self.place(ir.Name(NEW_STATES), at), state))
        return lines

    @property
    def masked(self) -> bool:
        """Whether a mask holds cells."""
        return self.text.operands.mask is not None

    def set_held(self) -> list[str]:
        """Return the code that sets, for a row, which cells the mask holds fixed."""
        return [self.brought(HELD, HELD_CELLS.text, place="at")] if self.masked else []

    def brought(self, to: str, array: str, scale: str = "1", place: str = "cell") -> str:
        """Return the code that copies a row of a plan's array into one of strips, scaled."""
        source = self.text.arena.places[array]
        return f"to_lanes(x + p + {self.offsets[to]}, mine + {source} + {place}, {scale});"

    def by_turns(self, names: tuple[str, str]) -> str:
        """Return the expression of one of two arrays after `level` levels."""
        even, odd = (self.offsets[name] for name in names)
        return f"x + (level & 1 ? {odd} : {even})"

    def of_layer(self, values: Iterable[float]) -> str:
        """Return the expression of the value for the current layer."""
        numbers = [self.text.literal(value) for value in values]
        if len(set(numbers)) == 1:
            return numbers[0]
        *others, last = numbers
        picks = "".join(f"layer == {layer} ? {number} : " for layer, number in enumerate(others))
        return f"({picks}{last})"

    def free(self, at: At, value: ir.Expression, held: ir.Expression) -> ir.Expression:
        """Return `value`, replaced by `held` where the mask holds cells fixed."""
        return ir.Choice(self.array(HELD, at) < ONES, value, held) if self.masked else value

    def place(self, array: ir.Expression, at: At) -> ir.Expression:
        """Return the index of a row's cells in an array."""
        return array + (at.row * self.layout.pitch + at.layer * self.layout.span) + P

    def cells(self, array: ir.Expression, at: At) -> ir.Load:
        """Return a row's cells, relative to the start of the block in an array."""
        return ir.Load(self.place(array, at))


def strip_rows(text: TransientBuilder, arrays: tuple[str, ...], scales: tuple[float, ...]) -> Rows:
    """Append arrays that hold all rows, and return the writer of their statements."""
    layout, names = row_layout(text), [*(arrays or OUTPUTS)]
    if text.operands.mask is not None:
        text.array(HELD_CELLS, text.cells)
        held = ir.pick(text.operands.mask.differs(ir.ZERO), ir.ONE, ir.ZERO)
        text.over_cells([ir.Assign(HELD_CELLS[ir.CELL], held)])
        names.append(HELD)
    names += SEEN if reads_states(text.template) else ()
    names += (LATER,) if text.has_history else ()
    names = list(dict.fromkeys((*names, DRIVE, *OUTPUTS)))
    for name in names:
        text.array(ir.Name(name), layout.size)
    places, given = text.arena.places, map(inputs_of, moving_inputs(text.template))
    offsets: dict[str, int | str] = {
        name: places[name] - places[names[0]] for name in (*names, *given)
    }
    return Rows(text, layout, scales, offsets, *_levels_of(text, layout, len(offsets)))


def _levels_of(text: TransientBuilder, layout: RowLayout, arrays: int) -> tuple[int, int, int]:
    """Return the stages per launch, the strips high enough for them, and the rows of a block."""
    block = block_rows(layout.width * text.tables.dtype.itemsize)
    # strips must not vanish before the last of the levels
    high = layout.rows // (2 * layout.radius * SHARES) - 1
    row_bytes = layout.pitch * text.tables.dtype.itemsize
    near = text.tables.near_bytes // (block * arrays * row_bytes)
    levels = max(1, min(LEVELS, max(LEAST_LEVELS, near), high))
    return levels, max(1, layout.rows // (2 * (levels + 1) * layout.radius)), block


def vector(name: ir.Name, value: ir.Expression) -> ir.Statement:
    """Return the declaration of a mutable vector."""
    return ir.declare(name, value, of="vec")


def constant(name: ir.Name, value: ir.Expression) -> ir.Statement:
    """Return the declaration of a constant vector."""
    return ir.fixed(name, value, of="vec")


def _statement(line: str | ir.Statement) -> ir.Statement:
    return ir.Verbatim((line,)) if isinstance(line, str) else line


FROM, PAST, NEXT, PART, STATES = ir.names("from past next part states")
"""Variables of the kernel: the outputs of the level before; those a delay before it; those of the
step after them. Then how far between both the level is, and the states of the level before."""


Value = Callable[[int, int, int], ir.Expression]
"""An output, by layer and by row and vector offset from the block."""


@dataclass(frozen=True, slots=True)
class Through:
    """Linear couplings through outputs at one time.

    Attributes
    ----------
    value : callable
        An output.
    weights : (layers, layers, k, k) float
    factor : Expression, optional
        Common factor of all weights.
    """

    value: Value
    weights: Floats
    factor: ir.Expression | None = None

    def taps(self, layer: int) -> tuple[Tap, ...]:
        """Return the nonzero weights into a layer."""
        return taps(self.weights, layer)


@dataclass(frozen=True, slots=True)
class Kept:
    """Outputs around a vector of a block's cells, computed from states and kept for the next
    vector.

    Attributes
    ----------
    rows : Rows
    """

    rows: Rows

    @property
    def begin(self) -> list[ir.Statement]:
        """The statements before the row's first vector."""
        return [vector(self.value(*at), self._made(*at, START)) for at in self._places(False)]

    @property
    def load(self) -> list[ir.Statement]:
        """The reads of the next vectors."""
        return [constant(self.value(*at), self._made(*at, P)) for at in self._places(True)]

    @property
    def move(self) -> list[ir.Statement]:
        """The statements after those of a vector."""
        return [
            ir.Assign(self.value(source, row, col), self.value(source, row, col + 1))
            for source, row, col in self._places(False)
        ]

    def value(self, source: int, row: int, col: int) -> ir.Name:
        """Return an output."""
        radius = self.rows.text.radius
        return ir.Name(f"y{source}_{row + radius}_{col + radius}")

    def _places(self, last: bool) -> Iterable[tuple[int, int, int]]:
        """Return layers, rows and vectors: the last vectors in reach, or those before them."""
        radius, layers = self.rows.text.radius, range(self.rows.text.layers)
        cols = range(radius, radius + 1) if last else range(-radius, radius)
        return product(layers, range(-radius, self.rows.high + radius), cols)

    def _made(self, source: int, row: int, col: int, start: ir.Name) -> ir.Expression:
        state = self.rows.layout.loaded(FROM, source, row, col, start)
        output = self.rows.text.template.output
        return state if output.linear or output.limited else ir.call("shown", state, ONES)


def coupled(
    rows: Rows,
    state: str,
    *,
    whole: bool = False,
    between: bool = False,
    kept: Kept | None = None,
) -> list[ir.Statement]:
    """Return the statements that compute s = w + A ∗ y − state, all scaled, in a block's rows.

    Parameters
    ----------
    rows : Rows
    state : str
        The array of states.
    whole : bool
        Whether s is the new state, so that the state is added.
    between : bool
        Whether the delayed time lies between the outputs of two steps.
    kept : Kept, optional
        Outputs, if arrays hold only states.
    """
    lines, driven = list[ir.Statement](), ir.Name("driven")
    known = constant_drive(rows.text)
    for at in rows.block:
        own = ir.Number(float(whole) - rows.scales[at.layer])
        states = rows.cells(FROM, at) if kept else rows.array(state, at)
        pull = own * states
        if known is None:
            pull = rows.cells(driven, at) + pull
        elif known[at.layer]:
            pull = ir.Number(rows.scales[at.layer] * known[at.layer]) + pull
        lines.append(vector(at.sum, pull))
    for through in _throughs(rows, between, kept):
        shares = any(shares_products(through.taps(layer)) for layer in range(rows.text.layers))
        lines.append(ir.block(*(_gather if shares else _scatter)(rows, through)))
    for at in rows.block:
        for coupling in rows.text.template.nonlinear:
            if not coupling.static and coupling.to == at.layer:
                scale = rows.scales[at.layer]
                lines += summed(coupling, _quantities(rows, at), at.sum, scale, "vec")
    return lines


def _throughs(rows: Rows, between: bool, kept: Kept | None) -> list[Through]:
    """Return the linear couplings: constant, time-varying and delayed."""
    template, now = rows.text.template, kept.value if kept else _loaded(rows, FROM)
    steady, result = template.A.copy(), list[Through]()
    for k, gain in enumerate(template.gains):
        varying = np.zeros_like(steady)
        varying[gain.to, gain.source] = template.A[gain.to, gain.source]
        steady[gain.to, gain.source] = 0.0
        result.append(Through(now, varying, ir.call("(vec)", gain_name(k))))
    if template.delayed is not None:
        past = _mixed(rows) if between else _loaded(rows, PAST)
        result.append(Through(past, template.delayed.A))
    return [through for through in (Through(now, steady), *result) if through.weights.any()]


def _loaded(rows: Rows, array: ir.Expression) -> Value:
    return lambda source, row, col: rows.layout.loaded(array, source, row, col, P)


def _mixed(rows: Rows) -> Value:
    def value(source: int, row: int, col: int) -> ir.Expression:
        before, after = (_loaded(rows, name)(source, row, col) for name in (PAST, NEXT))
        return before + PART * (after - before)

    return value


def _scatter(rows: Rows, through: Through) -> list[ir.Statement]:
    """Return the statements that add every output, as it is loaded, to its sums."""
    weights = {
        (layer, tap.source, tap.row, tap.col): tap.weight
        for layer in range(rows.text.layers)
        for tap in through.taps(layer)
    }
    radius, lines = rows.text.radius, list[ir.Statement]()
    sources = sorted({source for _, source, _, _ in weights})
    around = range(-radius, radius + 1)
    for row, source, col in product(range(-radius, rows.high + radius), sources, around):
        adds = [
            ir.add(at.sum, _weight(rows, through, at.layer, weights[key]) * V)
            for at in rows.block
            if (key := (at.layer, source, row - at.row, col)) in weights
        ]
        if adds:
            lines.append(ir.block(constant(V, through.value(source, row, col)), *adds))
    return lines


def _gather(rows: Rows, through: Through) -> list[ir.Statement]:
    """Return the statements that load all outputs, and sum those of equal weights first."""
    radius = rows.text.radius

    def name(source: int, row: int, col: int) -> ir.Name:
        return ir.Name(f"v{source}_{row + radius}_{col + radius}")

    places = {
        (tap.source, at.row + tap.row, tap.col)
        for at in rows.block
        for tap in through.taps(at.layer)
    }
    lines: list[ir.Statement] = [constant(name(*at), through.value(*at)) for at in sorted(places)]
    for at in rows.block:

        def output(tap: Tap, row: int = at.row) -> ir.Expression:
            return name(tap.source, row + tap.row, tap.col)

        weight = partial(_weight, rows, through, at.layer)
        terms = weighted_terms(through.taps(at.layer), weight, output)
        lines += [ir.add(at.sum, term) for term in terms]
    return lines


def _weight(rows: Rows, through: Through, layer: int, weight: float) -> ir.Expression:
    number = ir.Number(rows.scales[layer] * weight)
    return number if through.factor is None else through.factor * number


def _quantities(rows: Rows, at: At) -> Reads:
    """Return the states, outputs or inputs around a row's cells."""

    def quantity(name: Quantity, source: int, row: int, col: int) -> ir.Expression:
        if name == "u":  # every input has its own array
            return _loaded(rows, rows.base(inputs_of(source)))(0, at.row + row, col)
        return _loaded(rows, FROM if name == "y" else STATES)(source, at.row + row, col)

    return quantity


RING = "strip_ring"
"""The outputs at the start of the last steps."""


def gain_lines(
    text: TransientBuilder, since: str, within: tuple[str, str] | None = None
) -> list[str]:
    """Return the code that computes the time-varying factors at a time since the start."""
    at = ir.Constant(since)  # no gain jumps
    step = None if within is None else (ir.Constant(within[0]), ir.Constant(within[1]))
    return text.tables.printer.lines(gains(text, at, at, step))


def uneven(scheme: FixedSteps) -> bool:
    """Return whether the last step is shorter."""
    return not math.isclose(scheme.step, scheme.last, rel_tol=1e-9)


@dataclass(frozen=True, slots=True)
class Moments:
    """Times of the levels of fixed steps.

    Attributes
    ----------
    rows : Rows
    scheme : FixedSteps
    stages : int
        Stages per step, which is also the number of levels.
    before : str
        The steps before those that a launch counts, as an expression.
    """

    rows: Rows
    scheme: FixedSteps
    stages: int
    before: str = "0"

    @property
    def lag(self) -> int:
        """The delay in steps; 0 where there is none."""
        return lag(self.rows.text.template, self.scheme.step)

    @property
    def keeps(self) -> bool:
        """Whether outputs of earlier steps are kept."""
        return delays_outputs(self.rows.text.template)

    def head(self, stage: int) -> list[str]:
        """Return the code that sets a stage's time, before its rows are processed."""
        lines, literal = list[str](), self.rows.text.literal
        at, step = literal(self._place(stage)), literal(self.scheme.step)
        length = step
        if uneven(self.scheme):
            share = literal(self.scheme.last / self.scheme.step)
            last = f"steps == {self.scheme.count - 1} ? {share} : ONE"
            at += f" * ({last})"
            length += f" * ({last})"
            lines.append(f"const vec {PART.text} = (vec)({last});")
        # with a delay, a step may contain kinks of a gain, which is therefore averaged
        delays = self.rows.text.template.delayed is not None
        within = (f"{step} * R(steps)", length) if delays else None
        lines += gain_lines(self.rows.text, f"{step} * (R(steps) + {at})", within)
        if self.keeps:
            # the outputs at a step's end are those at the start of the next
            late = int(self._place(stage) == 1.0 and not uneven(self.scheme))
            lines.append(self._outputs(PAST.text, late))
            if self.between(stage):
                lines.append(self._outputs(NEXT.text, 1))
        steps = f"const int steps = number / {self.stages} + {self.before};"
        return [steps, *lines] if lines else []

    def between(self, stage: int) -> bool:
        """Return whether the delayed time lies between the outputs of two steps."""
        return self.keeps and uneven(self.scheme) and self._place(stage) != 0.0

    def _place(self, stage: int) -> float:
        """Return the time of a stage, in steps since the start of its step."""
        return float(sum(self.scheme.tableau.a[stage]))

    def _outputs(self, name: str, late: int) -> str:
        level = f"max(steps + {late} - {self.lag}, 0) * {self.stages}"
        return f"__global const scalar *const {name} = outputs_of(x, {level});"

    def keep_outputs(self, again: int) -> str:
        """Declare the ring buffer of outputs of earlier steps, and return the position of a
        `level`.

        The last `again` of these steps may be repeated.
        """
        turns = self.rows.by_turns(OUTPUTS)
        if not self.keeps:
            return turns
        # a level writes while one before it, a few rows ahead, reads outputs a delay old
        slots, size = self.lag + 2 + again, self.rows.layout.size
        self.rows.declare(RING, slots * size)
        ring = f"x + {self.rows.at(RING)} + (size_t)(level / {self.stages} % {slots}) * {size}"
        return ring if self.stages == 1 else f"level % {self.stages} ? {turns} : {ring}"

    @property
    def ahead(self) -> str:
        """The expression of the levels before those that a launch counts."""
        return f"{self.before} * {self.stages}"

    @property
    def driven(self) -> str:
        """The expression of the cells' drive at the level `number`."""
        if not self.rows.text.has_history:
            return "w"
        later = f"x + {self.rows.at(LATER)}"
        return f"number + {self.ahead} < {self.lag * self.stages} ? w : {later}"

    def later(self) -> list[str]:
        """Set the drive once the delay has elapsed, and return the code that copies a row of it."""
        rows, text = self.rows, self.rows.text
        if not text.has_history:
            return []
        both = zip(text.each(builder.LATER), text.each(builder.W), strict=True)
        text.over_cells([ir.add(later, w) for later, w in both])
        return [rows.brought(LATER, builder.LATER.text, rows.of_layer(rows.scales))]
