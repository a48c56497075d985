"""Explicit Euler steps: x ← (1 − h/τ) x + h/τ (A ∗ f(x) + w), all with quantised weights."""

from cnnum import kernels as ir
from cnnum.embedded.arithmetic.fixed import Quantity
from cnnum.embedded.lowering.builder import FINE
from cnnum.embedded.lowering.neighbours import Padded, reach
from cnnum.embedded.lowering.transient_work import TransientWork
from cnnum.embedded.lowering.watch import Watch
from cnnum.embedded.program import Array
from cnnum.errors import NotSupportedError
from cnnum.graph.nodes import Pick
from cnnum.integrators.schemes import FixedSteps
from cnnum.integrators.tableau import EULER
from cnnum.templating.network import taps


def stepped(work: TransientWork, scheme: FixedSteps) -> dict[int, Array]:
    """Write the steps, and return the maps that are read at their end.

    Raises
    ------
    NotSupportedError
        If they are not Euler's.
    """
    if scheme.tableau != EULER:
        raise NotSupportedError(
            f"Steps of '{scheme.tableau.name}' are not exported: take method='euler'."
        )
    to, template = work.to, work.template
    work.prepare()
    states = [_state(work, layer) for layer in range(template.layers)]
    drives = [_drive(work, layer, scheme.step) for layer in range(template.layers)]
    halo = reach(template.A)
    seen = [
        Padded.made(
            to, _like_output(work, states[n]), f"y{work.index}_{n}", template.boundary, halo
        )
        for n in range(template.layers)
    ]
    watch = Watch.of(work, scheme)
    with to.within() as steps:
        for state, padded in zip(states, seen, strict=True):
            value = to.item(state)
            padded.fill(value if template.output.linear else work.clipped(value))
        with to.within() as body:
            for layer, (state, drive) in enumerate(zip(states, drives, strict=True)):
                _step(work, layer, scheme, state, drive, seen, watch)
        to.loop(body, cols=halo > 0, halo=halo)
    watch.repeat(work, scheme, steps)
    return _ends(work, states)


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
    form = to.formats.stored(name)
    array = to.array(name, "work", to.cells, form, f"state of {work.template.name}")
    start = work.start(layer)
    to.loop([to.store_to(array, _value(work, array, start))])
    return array


def _value(work: TransientWork, array: Array, start: Quantity | None) -> ir.Expression:
    return work.to.zero() if start is None else work.to.stored(start, array)


def _drive(work: TransientWork, layer: int, step: float) -> Array | None:
    """Write the part that a step adds to any state; None where that is nothing."""
    to, share = work.to, step / float(work.template.tau[layer])
    with to.within() as body:
        terms = work.drive_terms(layer, share)
        if not terms:
            return None
        name = f"d{work.index}_{layer}"
        array = to.array(name, "work", to.cells, to.formats.kept(name), "drive of a step")
        to.store(array, to.arithmetic.weighted(terms, 40))
    to.loop(body, cols=True, halo=work.halo)
    return array


def _step(
    work: TransientWork,
    layer: int,
    scheme: FixedSteps,
    state: Array,
    drive: Array | None,
    seen: list[Padded],
    watch: Watch,
) -> None:
    to, template = work.to, work.template
    share = scheme.step / float(template.tau[layer])
    terms = [
        (share * tap.weight, seen[tap.source].at(tap.row, tap.col))
        for tap in taps(template.A, layer)
    ]
    own = 1.0 - share
    if template.output.linear:
        # f(x) = x: the cell's own weight takes in the kept share of its state
        terms = _merged(terms, own, seen[layer].at(0, 0))
    elif own:
        terms.append((own, to.item(state)))
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
        if scheme.count:
            to.body.append(to.store_to(state, new.value))
        return
    to.store(state, total)


def _places(array: Array) -> int:
    return 0 if array.format is None else array.format.fraction


def _merged(
    terms: list[tuple[float, Quantity]], own: float, cell: Quantity
) -> list[tuple[float, Quantity]]:
    centre = sum(weight for weight, one in terms if one == cell) + own
    return [*((w, one) for w, one in terms if one != cell), (centre, cell)]


def _ends(work: TransientWork, states: list[Array]) -> dict[int, Array]:
    found = dict[int, Array]()
    for one in work.picks:
        pick = one.operation
        assert isinstance(pick, Pick)
        layer = pick.layer
        linear = work.template.output.linear or pick.what == "state"
        if linear:
            found[one.index] = states[layer]
            continue
        array = work.target(layer, "output")
        value = work.clipped(work.to.item(states[layer]))
        work.to.loop([work.to.store_to(array, work.to.stored(value, array))])
        found[one.index] = array
    return found
