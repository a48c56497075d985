"""Fixed steps of large arrays by strips of rows, and the schemes that strips support."""

from dataclasses import dataclass, replace

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.lane_layout import lanes_fit
from cnnum.engines.opencl.large_arrays.strip_kernel import (
    SHOWN,
    StripText,
    apart,
    first_states,
    strip_kernel,
)
from cnnum.engines.opencl.large_arrays.strip_rows import (
    CONTROL,
    FINDINGS,
    FROM,
    ONES,
    OUTPUTS,
    PART,
    At,
    Kept,
    Moments,
    Rows,
    coupled,
    strip_rows,
    uneven,
    vector,
)
from cnnum.engines.opencl.transients.builder import (
    CHANGE,
    RUNNING,
    SETTLED,
    STEPS,
    STILL,
    TIME,
    TransientBuilder,
)
from cnnum.engines.opencl.transients.fixed_steps import fixed_figures
from cnnum.engines.opencl.transients.step_control import Controlled, Figures
from cnnum.integrators.schemes import AdaptiveSteps, FixedSteps, Stage, Stages, Sum, stages_of
from cnnum.kernels.launch_plan import Strips
from cnnum.templating.functions import Table
from cnnum.templating.network import delays_outputs, gains_jump, lag

BEFORE = "strip_before"
"""The array of the states at the start of a launch."""

COUNT, STEPS_BEFORE = range(2)
"""Registers: the number of levels of a frame, and the number of earlier steps."""

TAKEN, LEVELS, AT, K, ANY = ir.names("taken levels at k changes")
"""Steps and levels of a launch; its first step without a change, and whether there is one."""


@dataclass(frozen=True, slots=True)
class Watch:
    """Detection of the step at which the state settles.

    Attributes
    ----------
    rows : Rows
        Rows, with room for the stored rates.
    stages : int
        Of a step.
    steps : int
        Steps per launch; an even number of levels, so that outputs are where the next launch
        starts.
    """

    rows: Rows
    stages: int
    steps: int

    def sees(self, at: At, state: ir.Name) -> list[ir.Statement]:
        """Return statements that check d of a row, and save the state at the start of a launch.

        A step sets `change` to 1 if any rate exceeds the tolerance, else to 0.
        """
        solver, empty, tau = self.rows.text.solver, self.rows.empty, self.rows.text.template.tau
        # with it, d is the rate times the longest τ
        factor = float(tau.max() / tau[at.layer]) / self.rows.scales[at.layer]
        limit = ir.Number(solver.atol) + ir.Number(solver.rtol) * ir.call("magnitude", state)
        # which is false for NaN
        rests = ir.Number(factor) * ir.call("magnitude", at.sum) <= limit
        rests = rests if empty is None else ir.Binary("|", rests, empty)
        return [
            ir.Branch(ir.Name("number").equals(0), (self.rows.store(BEFORE, at, state),)),
            ir.Assign(CHANGE, ir.Choice(rests, CHANGE, ONES)),
        ]

    def watched(self, own: StripText) -> StripText:
        """Return the code of steps that are checked and can be repeated."""
        before = f"x + {self.rows.at(BEFORE)} + ROW(row) + layer * {self.rows.layout.span}"
        shown = f"show_row(outputs_of(x, ahead) + p, {before});"
        return replace(
            own,
            findings=self.steps,
            count=f"min(most, (int){self.rows.register(COUNT)} - done)",
            again=(f"copy_lanes(x + p, {before});", shown, *first_states(self.rows.text)),
        )

    @property
    def before(self) -> str:
        """Expression of the number of steps before a launch."""
        return f"(int){self.rows.register(STEPS_BEFORE)}"

    def body(self, scheme: FixedSteps, strips: Strips) -> list[ir.Statement]:
        """Return the statements that launch the kernel until nothing changes."""
        note = f"at most {scheme.count} steps of {scheme.step:g}, until nothing changes any more"
        solver, (begin, levels, end) = self.rows.text.solver, apart(strips)
        left = ir.Integer(scheme.count) - ir.Cast("int", STEPS)
        rounds = (
            ir.declare(TAKEN, ir.call("min", self.steps, left), of="int"),
            ir.declare(LEVELS, TAKEN * self.stages, of="int"),
            ir.Assign(CONTROL[COUNT], ir.real(LEVELS)),
            ir.Assign(CONTROL[STEPS_BEFORE], STEPS),
            ir.StripSteps(levels, LEVELS),
            *self._find_end(scheme),
            ir.add(STEPS, ir.real(AT)),
            ir.Assign(SETTLED, ir.ONE - ANY),
            ir.Assign(RUNNING, ir.pick(STEPS < ir.real(scheme.count), ANY, ir.ZERO)),
            ir.Assign(LEVELS, AT * self.stages),
            ir.Assign(CONTROL[COUNT], ir.real(LEVELS)),
            ir.Branch(AT < TAKEN, (ir.StripSteps(replace(levels, again=True), LEVELS),)),
        )
        time = ir.call("fmin", STEPS * ir.Number(scheme.step), ir.Number(solver.duration))
        begun = (RUNNING, ir.ONE), *((name, ir.ZERO) for name in (STEPS, SETTLED, STILL))
        return [
            ir.Note(f"// {scheme.name}, by strips: {note}"),
            ir.Declare("real", begun),
            ir.Assign(CONTROL[STEPS_BEFORE], ir.ZERO),
            begin,
            ir.Counted(ir.ROUND, 0, -(-scheme.count // self.steps), RUNNING, rounds),
            end,
            ir.fixed(TIME, time),
        ]

    def _find_end(self, scheme: FixedSteps) -> list[ir.Statement]:
        """Return the search for the first step at whose start nothing changes, where the run ends.

        With a delay, nothing may change for longer than the delay.
        """
        count, late = self.rows.finding, lag(self.rows.text.template, scheme.step)
        again = (
            ir.Assign(ANY, ir.ZERO),
            ir.Loop(K, count, (ir.Accumulate(ANY, "fmax", FINDINGS[AT * count + K]),)),
            ir.Assign(AT, ir.Integer(1), "+="),
            ir.Assign(STILL, ir.pick(ANY.equals(ir.ZERO), STILL + ir.ONE, ir.ZERO)),
            ir.Assign(ANY, ir.pick(ir.Number(late + 0.5) <= STILL, ir.ZERO, ir.ONE)),
        )
        return [
            ir.declare(AT, 0, of="int"),
            ir.declare(ANY, ir.ONE),
            ir.While((AT < TAKEN) & ANY.differs(ir.ZERO), again),
        ]


def watch(rows: Rows, stages: int) -> Watch:
    """Declare the settling detection for steps with this number of stages, and return it."""
    steps = max(1, rows.levels // stages)
    if steps * stages % 2:
        steps += 1 if steps == 1 else -1
    rows.declare_findings(2, steps)
    return Watch(rows, stages, steps)


BARE = ("standard", "linear", "full-range")
"""Output functions that cost less to recompute than to store."""


def strips_fit(text: TransientBuilder, scheme: FixedSteps | Controlled) -> bool:
    """Return whether steps of a scheme can be taken strip by strip."""
    template = text.template
    # other functions, of outputs or of couplings, have no form for vectors
    known = template.output.name in SHOWN and all(
        isinstance(coupling.function, Table) for coupling in template.nonlinear
    )
    sums = not gains_jump(template)
    if isinstance(scheme, AdaptiveSteps):
        sums = sums and not scheme.stops
    if isinstance(scheme, FixedSteps):
        sums = (
            sums
            and not scheme.pieces
            and scheme.count > 0
            and stages_of(scheme, 0, 1.0) is not None
        )
    return known and sums and lanes_fit(text)


def _layers(text: TransientBuilder, scheme: FixedSteps) -> tuple[Stages, ...]:
    """Return the stages of a step, by layer."""
    result = (stages_of(scheme, layer, float(tau)) for layer, tau in enumerate(text.template.tau))
    return tuple(stages for stages in result if stages is not None)


def states_suffice(text: TransientBuilder, scheme: FixedSteps) -> bool:
    """Return whether steps of a scheme supported by strips need only states."""
    template, stages = text.template, _layers(text, scheme)[0].stages
    delayed = delays_outputs(template) or text.has_history
    linear = all(coupling.static for coupling in template.nonlinear)
    plain = linear and template.output.name in BARE and not (delayed or scheme.settle)
    return plain and not uneven(scheme) and len(stages) == 1 and stages[0].whole


def state_strips(text: TransientBuilder, scheme: FixedSteps) -> Figures:
    """Append Euler steps that store only states, and return the results of the run.

    Outputs are computed as states are read, which halves the memory traffic of a step. Neighbours
    of a vector in the rows of a block stay in registers from one vector to the next, so each state
    is read, and its output computed, once.
    """
    rows = strip_rows(text, (), tuple(layer.scale for layer in _layers(text, scheme)))
    own = StripText(
        "0",
        lambda rows: [_state_case(rows, scheme)],
        end=f"({scheme.count & 1} ? {rows.at(OUTPUTS[1])} : 0)",
    )
    text.body.append(ir.StripSteps(strip_kernel(rows, own, scheme.count)))
    return fixed_figures(text, scheme)


def _state_case(rows: Rows, scheme: FixedSteps) -> ir.Case:
    kept, limited = Kept(rows), rows.text.template.output.limited
    body = [*kept.load, *coupled(rows, "", whole=True, kept=kept)]
    for at in rows.block:
        if rows.masked:
            body.append(ir.Assign(at.sum, rows.free(at, at.sum, rows.cells(FROM, at))))
        if limited:
            body.append(ir.Assign(at.sum, ir.call("shown", at.sum, ONES)))
        body.append(rows.new(at, at.sum))
    return rows.case(0, [*body, *kept.move], [*Moments(rows, scheme, 1).head(0), *kept.begin])


def strip_steps(text: TransientBuilder, scheme: FixedSteps) -> Figures:
    """Append the steps, add their kernel to the tables, and return the results of the run."""
    layers = _layers(text, scheme)
    stages, arrays = len(layers[0].stages), layers[0].arrays
    names, scales = tuple(map(_array_of, range(arrays))), tuple(layer.scale for layer in layers)
    rows = strip_rows(text, (*names, BEFORE) if scheme.settle else names, scales)
    seen = watch(rows, stages) if scheme.settle else None
    moments = Moments(rows, scheme, stages, seen.before if seen else "0")
    outputs = moments.keep_outputs(seen.steps if seen else 0)
    own = StripText(
        f"number % {stages}",
        lambda rows: _sum_cases(rows, layers, moments, seen),
        rest=[*moments.later(), "show_row(outputs_of(x, 0) + p, x + p);"],
        outputs=outputs,
        ahead=moments.ahead,
        driven=moments.driven,
    )
    if seen:
        strips = strip_kernel(rows, seen.watched(own), stages * seen.steps)
        text.body += seen.body(scheme, strips)
    else:
        text.body.append(ir.StripSteps(strip_kernel(rows, own, stages * scheme.count)))
    return fixed_figures(text, scheme)


def _sum_cases(
    rows: Rows, layers: tuple[Stages, ...], moments: Moments, watch: Watch | None
) -> list[ir.Case]:
    """Return all stages for a block of rows; layers differ only in their factors.

    The first stage is checked for settling.
    """
    cases = list[ir.Case]()
    for number, stage in enumerate(layers[0].stages):
        seen = watch if number == 0 else None
        whole = stage.whole and seen is None and not uneven(moments.scheme)
        state, between = _array_of(stage.state), moments.between(number)
        body = coupled(rows, state, whole=whole, between=between)
        share = PART if uneven(moments.scheme) else None
        for at in rows.block:
            stage = layers[at.layer].stages[number]
            body.append(_end(rows, stage, at, seen, whole, share, first=number == 0))
        findings = {CHANGE.text: f"number / {moments.stages}"} if seen else {}
        cases.append(rows.case(number, body, moments.head(number), findings))
    return cases


def _end(
    rows: Rows,
    stage: Stage,
    at: At,
    seen: Watch | None,
    whole: bool,
    share: ir.Name | None,
    *,
    first: bool,
) -> ir.Block:
    """Return the statements that form the sums of a row, once its d is known.

    If `whole`, the sum is the new state; else d is scaled by `share`. A cell that reaches its limit
    after the `first` stage stays there to the end of the step.
    """
    limited, known = rows.text.template.output.limited, set[int]()
    if not whole:
        known |= {place for part in stage.sums for place, _ in part.terms}
        known |= {stage.state} if limited or seen else set[int]()
    lines = [vector(_kept(place), rows.array(_array_of(place), at)) for place in sorted(known)]
    if limited and first and not whole:
        lines.append(ir.Assign(at.sum, ir.call("inwards", at.sum, _kept(stage.state), ONES)))
    if rows.masked:
        still = rows.array(_array_of(stage.state), at) if whole else ONES - ONES
        lines.append(ir.Assign(at.sum, rows.free(at, at.sum, still)))
    if seen:
        lines += seen.sees(at, _kept(stage.state))
    for part in stage.sums:
        kept, value = _kept(part.place), at.sum if whole else _sum(part, at, share)
        lines.append(ir.Assign(kept, value) if part.place in known else vector(kept, value))
        known.add(part.place)
        if part is stage.sums[0]:
            lines += rows.show(at, kept)
        lines.append(rows.store(_array_of(part.place), at, kept))
    return ir.block(*lines)


def _array_of(place: int) -> str:
    """Return the name of the array that stores a state or a sum."""
    return f"strip_x{place}"


def _kept(place: int) -> ir.Name:
    return ir.Name(f"a{place}")


def _sum(part: Sum, at: At, share: ir.Name | None) -> ir.Expression:
    terms = [_weighted([_kept(place)], factor) for place, factor in part.terms]
    own: list[ir.Expression] = [at.sum] if share is None else [share, at.sum]
    return ir.total([*terms, _weighted(own, part.factor)])


def _weighted(factors: list[ir.Expression], weight: float) -> ir.Expression:
    first, *others = factors if weight == 1.0 else [ir.Number(weight), *factors]
    for factor in others:
        first = first * factor
    return first
