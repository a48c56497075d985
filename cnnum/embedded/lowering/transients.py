"""Transients in whole numbers: one weighted sum, a product, modes, or explicit steps.

Uncoupled cells are a weighted sum of inputs and start, by any method: their answer is exact.

Cells that see only their own output, with self-feedback a = m + 1, start x₀ with |x₀| ≤ 1 and drive
w, have the output f(x₀ e^{mT} + w (e^{mT} − 1)/m) at the time T, in time constants: until a state
leaves [−1, 1] it is the argument of f, which goes one way, and then it stays outside (see
`cnnum.runs.decided`). With g = (e^{mT} − 1)/m that is f(x₀ + g (w + m x₀)). The rate in brackets is
cut off at ±2/g before it is multiplied, which takes any x₀ to the other end of [−1, 1].
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from cnnum import kernels as ir
from cnnum.arrays import Floats
from cnnum.embedded.arithmetic import LOGIC, Quantity, call, constant, opposite
from cnnum.embedded.lowering.builder import CELL, FINE, Builder, Padded, reach
from cnnum.embedded.lowering.exact_products import (
    around_torus,
    propagated,
    rests,
    through_modes,
)
from cnnum.embedded.lowering.transient_work import (
    Given,
    J,
    TransientWork,
)
from cnnum.embedded.program import Array
from cnnum.errors import NotSupportedError
from cnnum.graph.nodes import Node, Pick, Transient
from cnnum.integrators.closed_forms import (
    Circulant,
    Decay,
    Propagator,
    Separate,
    Spectral,
    summed,
)
from cnnum.integrators.schemes import FixedSteps
from cnnum.integrators.solver import Solver
from cnnum.integrators.tableau import EULER
from cnnum.templating.network import lag, moving_inputs, reads_states, taps
from cnnum.templating.template import Template

STILL = 1e-6
"""A step of reals that moves no cell by more is the last: ten roundings of float32 at 1."""


@dataclass(frozen=True, slots=True)
class Watch:
    """Variables that say whether the last step moved a cell, and how many steps there were.

    Attributes
    ----------
    moved, steps, running : Name
    needed : bool
        Whether anything asks for them.
    """

    moved: ir.Name
    steps: ir.Name
    running: ir.Name
    needed: bool

    @classmethod
    def of(cls, work: TransientWork, scheme: FixedSteps) -> "Watch":
        """Return those of a transient."""
        at, needed = work.index, scheme.settle or "settled" in work.figures
        steps = ir.Name(f"steps{at}", (0, scheme.count))
        return cls(ir.Name(f"moved{at}", LOGIC), steps, ir.Name(f"running{at}", LOGIC), needed)

    def noted(self, new: ir.Expression, old: ir.Expression) -> ir.Accumulate:
        """Return the statement that takes in whether a cell moves."""
        if new.bounds is not None:
            return ir.Accumulate(self.moved, "maximum", opposite(call("equal", new, old)))
        far = call("absolute", call("subtract", new, old))
        return ir.Accumulate(self.moved, "maximum", call("greater", far, ir.Number(STILL)))

    def repeat(
        self,
        work: TransientWork,
        scheme: FixedSteps,
        parts: Sequence[tuple["Part", Sequence[ir.Statement]]],
    ) -> None:
        """Write the steps of each part and the figures of the run."""
        to, count = work.to, constant(float(scheme.count))
        if self.needed:
            to.body.append(ir.declare(self.moved, 0))
            clears = ir.Assign(self.moved, ir.Integer(0))
            parts = [(part, (clears, *steps)) for part, steps in parts]
        if scheme.settle:
            ((_, steps),) = parts
            count = self._until_still(work, scheme, steps)
            time = to.arithmetic.multiply(count, constant(scheme.step), FINE)
        else:
            for part, steps in parts:
                to.body.append(ir.Counted(STEP, part.first, part.after, None, tuple(steps)))
            time = constant(sum(part.step * (part.after - part.first) for part, _ in parts))
            time = time if scheme.count else constant(0.0)
        known = {"steps": count, "time": time, "settled": Quantity(opposite(self.moved))}
        for name in work.figures:
            figure = known[name]
            if figure.exact is None:
                figure = to.let(f"{name}_{work.index}", figure)
            work.figures[name] = figure

    def _until_still(
        self, work: TransientWork, scheme: FixedSteps, steps: Sequence[ir.Statement]
    ) -> Quantity:
        to, more = work.to, call("add", self.steps, ir.Integer(1))
        counted = ir.Assign(self.steps, call("minimum", more, ir.Integer(scheme.count)))
        body = (*steps, counted, ir.Assign(self.running, self.moved))
        to.body += [
            ir.declare(self.steps, 0),
            ir.declare(self.running, 1),
            ir.Counted(STEP, 0, scheme.count, self.running, body),
        ]
        return Quantity(self.steps if to.integer else call("to_real", self.steps))


def stepped(work: TransientWork, scheme: FixedSteps) -> dict[int, Array]:
    """Write the steps, and return the maps that are read at their end.

    Raises
    ------
    NotSupportedError
        If they are not Euler's.
    """
    if scheme.tableau != EULER:
        raise NotSupportedError(
            f"Steps of '{scheme.tableau.name}' cannot be exported: use method='euler'."
        )
    to, template = work.to, work.template
    parts = _parts(work, scheme)
    work.prepare()
    states = [_state(work, layer) for layer in range(template.layers)]
    drives = _drives(work, parts)
    halo = max(reach(template.A), work.far(static=False), _late_reach(template))
    inputs = {source: work.seen_input(source, halo) for source in moving_inputs(template)}
    seen = [
        Padded.made(
            to, _like_output(work, states[n]), f"y{work.index}_{n}", template.boundary, halo
        )
        for n in range(template.layers)
    ]
    # of states that neighbours read, a copy: the cells of a step see those before it
    past = [
        Padded.made(to, state, f"o{work.index}_{n}", template.boundary, halo)
        for n, state in enumerate(states if reads_states(template) else [])
    ]
    late = _histories(work, scheme, states, halo)
    maps = {"u": inputs, "y": dict(enumerate(seen)), "x": dict(enumerate(past))}
    maps["late"] = {source: history.seen for source, history in late.items()}
    watch, bodies = Watch.of(work, scheme), list[tuple[Part, Sequence[ir.Statement]]]()
    for part in parts:
        with to.within() as steps:
            for state, padded in zip(states, seen, strict=True):
                value = to.item(state)
                padded.fill(value if template.output.linear else work.output(value))
            for state, padded in zip(states, past, strict=False):
                padded.fill(to.item(state))
            for source, history in late.items():
                history.exchange(work, seen[source])
            with to.within() as body:
                for layer, state in enumerate(states):
                    drive = drives[part.step, part.late, layer]
                    _step(work, layer, part, state, drive, maps, watch)
            to.loop(body, cols=halo > 0, halo=halo)
        bodies.append((part, steps))
    watch.repeat(work, scheme, bodies)
    return _ends(work, states)


MOST_STEPS = 200_000
"""Steps of a transient at most: the slowest template of the library, INTERP, may take 128,000."""

STEP = ir.Name("n", (0, MOST_STEPS))
"""Number of a step."""

MOST_FACTORS = 4096
"""Steps of a part in which a gain varies: each has a factor in a table."""


@dataclass(frozen=True, slots=True)
class Part:
    """Consecutive steps of one length that read the same inputs.

    Attributes
    ----------
    first, after : int
        Numbers of its first step and of the one after its last.
    step : float
    late : str
        What a delayed B reads: "input", or "previous" inputs before the delay has passed.
    factors : dict of (int, int) to (after − first,) float
        Gains of each step, by the layers `to` and `source` of their couplings.
    stores : bool
        Whether its steps are stored; in a run of no time none is.
    """

    first: int
    after: int
    step: float
    late: str
    factors: Mapping[tuple[int, int], Floats]
    stores: bool = True


def _parts(work: TransientWork, scheme: FixedSteps) -> list[Part]:
    """Return the parts of a run: they end where steps change, or a delayed input arrives."""
    template, count = work.template, scheme.count
    timed = template.delayed is not None or bool(template.gains)
    if timed and (scheme.settle or "settled" in work.figures):
        raise NotSupportedError(
            f"Template '{template.name}' has a delay or a gain in time, so that a step that moves "
            "nothing is no rest: give it a duration, and do not read 'settled'."
        )
    if not count or scheme.settle:
        # a run of no time is watched for one step, which is not stored
        watched = "settled" in work.figures
        return [Part(0, count or int(watched), scheme.step, "input", {}, stores=bool(count))]
    starts = {piece.first: (piece.step, piece.start) for piece in scheme.pieces}
    starts = starts or {0: (scheme.step, 0.0)}
    if not scheme.pieces and scheme.last != scheme.step:
        starts[count - 1] = scheme.last, (count - 1) * scheme.step
    before = lag(template, scheme.step) if work.given["previous"] else 0
    ends = {*starts, count} | ({before} if 0 < before < count else set[int]())
    result = list[Part]()
    for first, after in pairwise(sorted(ends)):
        at = max(start for start in starts if start <= first)
        step, begin = starts[at]
        times = begin + step * np.arange(first - at, after - at, dtype=np.float64)
        late = "previous" if first < before else "input"
        result.append(Part(first, after, step, late, _factors(work, times, step)))
    return result


def _factors(work: TransientWork, times: Floats, step: float) -> dict[tuple[int, int], Floats]:
    """Return the gains of steps that begin at some times, as the engines take them."""
    result = dict[tuple[int, int], Floats]()
    for gain in work.template.gains:
        if work.template.delayed is not None:
            values = np.array([gain.table.mean(time, time + step) for time in times.tolist()])
        else:
            jumps = gain.table.interpolation == "constant"
            values = np.asarray(gain.table(times + 0.5 * step if jumps else times))
        pair = gain.to, gain.source
        result[pair] = result.get(pair, np.ones(len(times))) + values - 1.0
    return result


def _late_reach(template: Template) -> int:
    return 0 if template.delayed is None else reach(template.delayed.A)


@dataclass(frozen=True, slots=True)
class _History:
    """The outputs of a layer over a delay, and the map of those that are read now.

    Attributes
    ----------
    ring : Array or None
        Outputs of the last steps, one map after the other; None where no step sees any.
    steps : int
        Maps in it.
    seen : Padded
    """

    ring: Array | None
    steps: int
    seen: Padded

    def exchange(self, work: TransientWork, now: Padded) -> None:
        """Write the statements that take out the outputs of a delay ago, and put in the new."""
        if self.ring is None:
            return
        to, place = work.to, call("remainder", STEP, ir.Integer(self.steps))
        slot = ir.Name(f"slot_{self.ring.name}", place.bounds)
        to.body.append(ir.fixed(slot, place))
        at = call("add", call("multiply", slot, ir.Integer(to.cells)), CELL)
        self.seen.fill(to.item(self.ring, at))
        with to.within() as body:
            to.store(self.ring, now.at(0, 0), at)
        to.loop(body, cols=now.halo > 0, halo=now.halo)


def _histories(
    work: TransientWork, scheme: FixedSteps, states: Sequence[Array], halo: int
) -> dict[int, _History]:
    """Write the histories of the layers that a delayed A reads, as of before the start."""
    to, template, result = work.to, work.template, dict[int, _History]()
    if template.delayed is None:
        return result
    steps = lag(template, scheme.step)
    for source in np.flatnonzero(template.delayed.A.any(axis=(0, 2, 3))).tolist():
        name, state = f"{work.index}_{source}", states[source]
        like, ring = _like_output(work, state), None
        seen = Padded.made(to, like, f"l{name}", template.boundary, halo)
        start = to.item(state)
        start = start if template.output.linear else work.output(start)
        if steps < scheme.count:
            description = f"outputs of the last {steps} steps"
            ring = to.array(f"ring{name}", "work", steps * to.cells, like.format, description)
            at = call("add", call("multiply", J, ir.Integer(to.cells)), CELL)
            store = to.store_to(ring, to.stored(start, ring), at)
            to.loop([ir.Loop(J, steps, (store,))])
        else:
            seen.fill(start)
        result[source] = _History(ring, steps, seen)
    return result


def _drives(
    work: TransientWork, parts: Sequence[Part]
) -> dict[tuple[float, str, int], Array | None]:
    """Write what a step adds to any state, for each length of a step and each kind of input."""
    result = dict[tuple[float, str, int], Array | None]()
    for part in parts:
        for layer in range(work.template.layers):
            key = part.step, part.late, layer
            if key not in result:
                number = len({(step, late) for step, late, _ in result} - {key[:2]})
                tag = f"_{number}" if number else ""
                result[key] = _drive(work, layer, part, tag)
    return result


def _like_output(work: TransientWork, state: Array) -> Array:
    """Return an array like a layer's output, which a rim may exceed."""
    form = None
    if state.format is not None:
        edge = work.template.boundary.constant or 0.0
        form = state.format
        if not work.template.output.linear:
            form = work.to.formats.precision.stored(max(1.0, abs(edge)))
    return Array(state.name, "work", state.length, form, f"output of {work.template.name}")


def _state(work: TransientWork, layer: int) -> Array:
    to, name = work.to, f"x{work.index}_{layer}"
    # steps beside jumps and corners are short: a word would round away the changes of many of them
    form = to.formats.kept(name) if work.template.nonlinear else work.format_of(name)
    array = to.array(name, "work", to.cells, form, f"state of {work.template.name}")
    start = work.start(layer)
    to.loop([to.store_to(array, _value(work, array, start))])
    return array


def _value(work: TransientWork, array: Array, start: Quantity | None) -> ir.Expression:
    return work.to.zero() if start is None else work.to.stored(start, array)


def _drive(work: TransientWork, layer: int, part: Part, tag: str) -> Array | None:
    """Write the part that a step adds to any state, or None if that is nothing."""
    to, share = work.to, part.step / float(work.template.tau[layer])
    with to.within() as body:
        terms = work.drive_terms(layer, share, part.late)
        if not terms:
            return None
        name = f"d{work.index}_{layer}{tag}"
        array = to.array(name, "work", to.cells, to.formats.kept(name), "drive of a step")
        to.store(array, to.arithmetic.weighted(terms, 40))
    to.loop(body, cols=True, halo=work.halo)
    return array


def _step(
    work: TransientWork,
    layer: int,
    part: Part,
    state: Array,
    drive: Array | None,
    maps: Mapping[str, Mapping[int, Padded]],
    watch: Watch,
) -> None:
    to, template, seen = work.to, work.template, maps["y"]
    share = part.step / float(template.tau[layer])
    terms = [
        (share * tap.weight, seen[tap.source].at(tap.row, tap.col))
        for tap in taps(template.A, layer)
        if (layer, tap.source) not in part.factors
    ]
    if template.delayed is not None:
        terms += [
            (share * tap.weight, maps["late"][tap.source].at(tap.row, tap.col))
            for tap in taps(template.delayed.A, layer)
        ]
    own = 1.0 - share
    if template.output.linear:
        # f(x) = x: the cell's own weight takes in the kept share of its state
        terms = _merged(terms, own, seen[layer].at(0, 0))
    elif own:
        terms.append((own, to.item(state)))
    for number, coupling in work.couplings(layer, static=False):
        value = work.coupled(
            number, coupling, lambda what, source, row, col: maps[what][source].at(row, col)
        )
        terms.append((share, value))
    for (layer_to, source), factors in part.factors.items():
        if layer_to == layer:
            terms += _gained(work, layer, source, part, factors, seen[source])
    total = to.arithmetic.weighted(terms, FINE)
    if drive is not None:
        # of a step as long as τ nothing of the state is kept, and the drive is all there is
        finest = total.fraction if terms else FINE
        total = to.arithmetic.add(total, to.item(drive), finest)
    if template.output.limited:
        total = work.clipped(total)
    if work.given["mask"]:
        total = work.masked(total, to.item(state))
    if watch.needed:
        new = to.let(f"new{work.index}_{layer}", Quantity(to.stored(total, state), _places(state)))
        to.body.append(watch.noted(new.value, to.item(state).value))
        if part.stores:
            to.body.append(to.store_to(state, new.value))
        return
    to.store(state, total)


def _gained(
    work: TransientWork, layer: int, source: int, part: Part, factors: Floats, seen: Padded
) -> list[tuple[float, Quantity]]:
    """Return the terms of the couplings from a layer, scaled by a gain that varies in time."""
    to, share = work.to, part.step / float(work.template.tau[layer])
    some = [tap for tap in taps(work.template.A, layer) if tap.source == source]
    if not some:
        return []
    if np.ptp(factors) == 0.0:
        share *= float(factors[0])
        return [(share * tap.weight, seen.at(tap.row, tap.col)) for tap in some]
    if len(factors) > MOST_FACTORS:
        raise NotSupportedError(
            f"Template '{work.template.name}' has a gain that varies over {len(factors):,} steps, "
            f"but an export has a table of at most {MOST_FACTORS:,}: take longer steps with 'dt'."
        )
    name = f"{work.index}_{layer}_{source}"
    total = to.arithmetic.weighted([(tap.weight, seen.at(tap.row, tap.col)) for tap in some], FINE)
    total = work.register(f"f{name}g", total)
    table = work.table(f"gain_{layer}_{source}_{part.first}", factors, "gains by steps")
    at = call("subtract", STEP, ir.Integer(part.first)) if part.first else STEP
    factor = to.item(table, at)
    return [(share, work.register(f"h{name}g", to.arithmetic.multiply(total, factor, FINE)))]


def _places(array: Array) -> int:
    return 0 if array.format is None else array.format.fraction


def _merged(
    terms: list[tuple[float, Quantity]], own: float, cell: Quantity
) -> list[tuple[float, Quantity]]:
    centre = sum(weight for weight, quantity in terms if quantity == cell) + own
    return [*((w, quantity) for w, quantity in terms if quantity != cell), (centre, cell)]


def _ends(work: TransientWork, states: list[Array]) -> dict[int, Array]:
    result = dict[int, Array]()
    for index, pick in work.picks.items():
        layer = pick.layer
        linear = work.template.output.linear or pick.what == "state"
        if linear:
            result[index] = states[layer]
            continue
        array = work.target(layer, "output")
        value = work.output(work.to.item(states[layer]))
        work.to.loop([work.to.store_to(array, work.to.stored(value, array))])
        result[index] = array
    return result


def separated(work: TransientWork, scheme: Separate) -> dict[int, Array]:
    """Write the outputs of cells that see only their own, each in one weighted sum.

    Starts beyond ±1 must be known to stay there, as `choice.only_output_matters` finds out; then
    the sum is beyond ±1, too.
    """
    work.prepare()
    to, result = work.to, dict[int, Array]()
    for layer in work.layers:
        kept, gain, weight = summed(float(scheme.own[layer]) - 1.0, float(scheme.time[layer]))
        with to.within() as body:
            terms, start = work.drive_terms(layer, 1.0), work.start(layer)
            if start is not None and weight:
                terms.append((weight, start))
            rate = to.arithmetic.weighted(terms, FINE)
            rate = work.register(f"w{work.index}_{layer}", rate)
            state = _grown(work, rate, gain)
            if start is not None:
                begun = to.arithmetic.weighted([(kept, start)], FINE)
                state = to.arithmetic.add(begun, state, FINE)
            if work.given["mask"]:
                state = work.masked(state, start)
            result |= work.answers(layer, state)
        to.loop(body, cols=work.by_place, halo=work.halo)
    return result


def _grown(work: TransientWork, rate: Quantity, gain: float) -> Quantity:
    """Return a rate times a gain, cut off at ±2 or a little beyond."""
    arithmetic, edge = work.to.arithmetic, 2.0 / gain
    if work.to.integer:
        # a rate that is not 0 is beyond an edge which is finer than its last place
        gain = min(gain, 2.0 ** (rate.fraction + 1))
        edge = math.ceil(math.ldexp(edge, rate.fraction)) * 2.0**-rate.fraction
    rate = arithmetic.extreme("minimum", rate, constant(edge), rate.fraction)
    rate = arithmetic.extreme("maximum", rate, constant(-edge), rate.fraction)
    return arithmetic.weighted([(gain, rate)], FINE)


FIGURES = ("time", "steps", "settled")
"""Numbers of a run; its error is not followed."""


def lower_transient(
    to: Builder,
    node: Node,
    solver: Solver,
    given: Given,
    picks: Sequence[tuple[Node, Pick]],
    *,
    remembered: bool,
) -> tuple[dict[int, Array], dict[int, Quantity]]:
    """Write a transient; return the arrays and figures that are read of it, by their nodes.

    If they are `remembered`, they have the bits of a memory.

    Raises
    ------
    NotSupportedError
        If the template or the method has no form in whole numbers.
    """
    operation = node.operation
    assert isinstance(operation, Transient)
    wanted = {user.index: pick.what for user, pick in picks if pick.what in FIGURES}
    maps = {user.index: pick for user, pick in picks if user.index not in wanted}
    work = TransientWork(to, operation.template, node.index, given, maps, remembered=remembered)
    exact = {"steps": 0.0, "settled": 1.0, "time": solver.duration}
    work.figures = {name: constant(exact[name]) for name in wanted.values()}
    steps = isinstance(solver.scheme, FixedSteps)
    work.watched = "settled" in work.figures and not (solver.settle or steps)
    work.check()
    result = _lowered(work, solver)
    if work.watched:
        work.figures["settled"] = rests(work, solver)
    return result, {index: work.figures[name] for index, name in wanted.items()}


def _lowered(work: TransientWork, solver: Solver) -> dict[int, Array]:
    scheme = solver.scheme
    if isinstance(scheme, Decay):
        return work.uncoupled(scheme.kept)
    if isinstance(scheme, Separate):
        return separated(work, scheme)
    if isinstance(scheme, Propagator):
        return propagated(work, scheme)
    if isinstance(scheme, Circulant):
        return around_torus(work, scheme)
    if isinstance(scheme, Spectral):
        return through_modes(work, scheme)
    if isinstance(scheme, FixedSteps) and scheme.count > MOST_STEPS:
        raise NotSupportedError(
            f"Template '{work.template.name}' may take {scheme.count:,} steps, but an export can "
            f"contain at most {MOST_STEPS:,}: give it a duration, or leave out the outputs that "
            "need it."
        )
    if isinstance(scheme, FixedSteps):
        return stepped(work, scheme)
    raise NotSupportedError(
        f"Template '{work.template.name}' cannot be exported with the method '{solver.method}': "
        "use method='euler', or leave out the outputs that need it."
    )
