"""The exact ends of linear transients as products: by a propagator, by modes, around a torus."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from cnnum import kernels as ir
from cnnum.arrays import Floats
from cnnum.embedded.arithmetic import LOGIC, Quantity, call, constant, opposite
from cnnum.embedded.lowering.builder import CELL, COLUMN, FINE, ROW, Padded, reach
from cnnum.embedded.lowering.transient_work import (
    DOWN,
    J,
    TransientWork,
    item_at,
    sum_of,
)
from cnnum.embedded.program import Array
from cnnum.integrators.closed_forms import Circulant, Decay, Propagator, Spectral
from cnnum.integrators.solver import Solver
from cnnum.templating.network import taps

Ends = Callable[[int, Quantity], None]
"""Takes in the end of a layer in a cell: a state, or a rate."""


def _sources(work: TransientWork) -> list[tuple[str, int, Array]]:
    """Write drives and starts that are not 0, once; return them with their kind and layer."""
    result = list[tuple[str, int, Array]]()
    work.prepare()
    to, template = work.to, work.template
    for layer in range(template.layers):
        name = f"w{work.index}_{layer}"
        with to.within() as body:
            terms = work.drive_terms(layer, 1.0)
            if terms and name in to.arrays:
                result.append(("drive", layer, to.arrays[name]))
            elif terms:
                array = to.array(name, "work", to.cells, to.formats.stored(name), "drive")
                to.store(array, to.arithmetic.weighted(terms, FINE))
                result.append(("drive", layer, array))
        to.loop(body, cols=work.by_place, halo=work.halo)
        start = _start(work, layer)
        if start is not None:
            result.append(("state", layer, start))
    return result


def _start(work: TransientWork, layer: int) -> Array | None:
    to, given = work.to, work.given
    known = given["state"] or (given["input"] if work.template.initial == "input" else [])
    if known and isinstance(known[layer], Array):
        array = known[layer]
        assert isinstance(array, Array)
        return array
    start = work.start(layer)
    if start is None:
        return None
    name = f"s{work.index}_{layer}"
    if name in to.arrays:
        return to.arrays[name]
    array = to.array(name, "work", to.cells, to.formats.stored(name), "start")
    with to.within() as body:
        to.store(array, start)
    to.loop(body)
    return array


def propagated(work: TransientWork, scheme: Propagator) -> dict[int, Array]:
    """Write x(t) = state · x₀ + drive · w + constant."""
    result = dict[int, Array]()
    _dense(work, scheme, _sources(work), _answering(work, result))
    return result


def _answering(work: TransientWork, answers: dict[int, Array]) -> Ends:
    """Return the function that writes the answers of a layer from its state, and keeps them."""
    return lambda layer, state: answers.update(work.answers(layer, state))


def _dense(
    work: TransientWork, scheme: Propagator, sources: Sequence[tuple[str, int, Array]], ends: Ends
) -> None:
    """Write the products of a propagator's matrices and sources, for each layer that is read."""
    to, n = work.to, work.to.cells
    matrices = {"state": scheme.state, "drive": scheme.drive}
    for layer in work.layers:
        rows = slice(layer * n, (layer + 1) * n)
        with to.within() as body:
            parts = list[Quantity]()
            for kind, source, array in sources:
                block = matrices[kind][rows, source * n : (source + 1) * n]
                if np.any(block):
                    bits = to.bits_beside([array], n)
                    table = work.table(f"{kind}_{layer}_{source}", block, "propagator", bits)
                    a, b = item_at(to, table, CELL, n, J), to.item(array, J)
                    parts.append(sum_of(to, f"s_{kind}_{layer}_{source}", [(J, n)], a, b))
            ends(layer, _sum(work, parts, scheme.constant[rows], layer))
        to.loop(body)


def _sum(work: TransientWork, parts: list[Quantity], rim: Floats, layer: int) -> Quantity:
    to = work.to
    if np.any(rim):
        table, _ = to.table(f"k{work.index}_constant_{layer}", rim, "the rim's share")
        parts = [*parts, to.item(table)]
    if not parts:
        return work.fixed(0.0)
    total = parts[0]
    for part in parts[1:]:
        total = to.arithmetic.add(total, part, FINE)
    return total


def around_torus(work: TransientWork, scheme: Circulant) -> dict[int, Array]:
    """Write the equilibrium as a sum of shifted drives, each weighed by its distance on the torus.

    A table holds the weights of distances from 1 − n to n − 1 along both axes. So no index wraps
    around. It is reversed, so that table and drive are read in the same direction.
    """
    to, (rows, cols) = work.to, work.to.shape
    sources = _sources(work)
    apart = [np.arange(n - 1, -n, -1) for n in (rows, cols)]
    width, result = 2 * cols - 1, dict[int, Array]()
    row = call("add", call("subtract", ir.Integer(rows - 1), ROW), DOWN)
    col = call("add", call("subtract", ir.Integer(cols - 1), COLUMN), J)
    for layer in work.layers:
        with to.within() as body:
            parts = list[Quantity]()
            for kind, source, array in sources:
                weights = scheme.drive[layer, source][np.ix_(*apart)]
                if kind == "drive" and np.any(weights):
                    table, _ = to.table(f"k{work.index}_{layer}_{source}", weights, "by distance")
                    a, b = item_at(to, table, row, width, col), item_at(to, array, DOWN, cols, J)
                    over = [(DOWN, rows), (J, cols)]
                    parts.append(sum_of(to, f"s_{layer}_{source}", over, a, b))
            result |= work.answers(layer, _sum(work, parts, np.zeros(1), layer))
        to.loop(body, cols=True)
    return result


def through_modes(work: TransientWork, scheme: Spectral) -> dict[int, Array]:
    """Write x(t) = Rᵀ [factors · (R s Cᵀ)] C + constant, summed over starts and drives s."""
    result = dict[int, Array]()
    _modal(work, scheme, _sources(work), _answering(work, result))
    return result


def _modal(
    work: TransientWork,
    scheme: Spectral,
    sources: Sequence[tuple[str, int, Array]],
    ends: Ends,
    tag: str = "",
) -> None:
    """Write the products by modes of sources, for each layer that is read."""
    to, (rows, cols) = work.to, work.to.shape
    factors = {"state": scheme.state, "drive": scheme.drive}
    seen, bits = list[tuple[str, int, Array]](), to.bits_beside([], 1)
    for kind, layer, given in sources:
        own = to.bits_beside([given], max(rows, cols))
        modes, bits = _modes(work, scheme, own), max(bits, own)
        seen.append((kind, layer, _forward(work, f"{kind}{tag}", layer, given, *modes)))
    along_rows, along_cols = _modes(work, scheme, bits)
    for layer in work.layers:
        mixed = _wide(work, f"u{work.index}_{layer}{tag}", "modes of the answer")
        with to.within() as body:
            parts = list[Quantity]()
            for kind, source, array in seen:
                block = factors[kind][layer, source]
                table = work.table(f"{kind}_{layer}_{source}", block, "factors of modes", bits)
                parts.append(to.arithmetic.multiply(to.item(table), to.item(array), FINE))
            to.store(mixed, _sum(work, parts, np.zeros(1), layer))
        to.loop(body)
        # over rows: Rᵀ, so the table's columns
        a, b = item_at(to, along_rows, J, rows, ROW), item_at(to, mixed, J, cols, COLUMN)
        half = _mixed(work, f"v{work.index}_{layer}{tag}", "modes of columns", rows, a, b)
        a, b = item_at(to, half, ROW, cols, J), item_at(to, along_cols, J, cols, COLUMN)
        with to.within() as body:
            end = sum_of(to, f"s_{layer}", [(J, cols)], a, b)
            ends(layer, _sum(work, [end], scheme.constant[layer], layer))
        to.loop(body, cols=True)


def rests(work: TransientWork, solver: Solver) -> Quantity:
    """Write whether an array rests at its exact end: its rates there are within the tolerances.

    The rates of a linear array decay as its states do: x'(t) is the part "state" of its end of
    x'(0). Those of a cell under the mask are 0. The rate of a fast layer counts by the slowest τ.
    Roundings of stored starts and drives are no rates.
    """
    to, scheme, rates = work.to, solver.scheme, _rates(work)
    moving_flag = ir.Name(f"moves{work.index}", LOGIC)

    def ends(layer: int, rate: Quantity) -> None:
        arithmetic, x = to.arithmetic, to.item(work.target(layer, "state"))
        most = solver.atol + decayed[layer] * rates[layer].rounded
        share = arithmetic.multiply(arithmetic.absolute(x), constant(solver.rtol), FINE)
        bound = arithmetic.add(share, constant(most), FINE)
        moving = arithmetic.compare("greater", arithmetic.absolute(rate), bound).value
        if work.given["mask"]:
            moving = call("and", moving, opposite(work.cell(work.given["mask"][0]).value))
        to.body.append(ir.Accumulate(moving_flag, "maximum", moving))

    to.body.append(ir.declare(moving_flag, 0))
    begun = [("state", n, rate.array) for n, rate in enumerate(rates)]
    if isinstance(scheme, Decay):
        decayed = scheme.kept.tolist()
    else:
        assert isinstance(scheme, Propagator | Spectral)
        decayed = np.abs(scheme.state).sum(axis=1).reshape(len(rates), -1).max(axis=1).tolist()
    if isinstance(scheme, Propagator):
        _dense(work, scheme.still(), begun, ends)
    elif isinstance(scheme, Spectral):
        _modal(work, scheme.still(), begun, ends, "e")
    else:
        for layer, layer_rate in enumerate(rates):
            with to.within() as body:
                ends(
                    layer,
                    to.arithmetic.weighted([(decayed[layer], to.item(layer_rate.array))], FINE),
                )
            to.loop(body)
    return to.let(f"settled_{work.index}", Quantity(opposite(moving_flag)))


class _Rate(NamedTuple):
    """The rates of a layer at the start, and by how much roundings may make them larger."""

    array: Array
    rounded: float


def _rates(work: TransientWork) -> list[_Rate]:
    """Write (w + A ∗ x₀ − x₀) / τ of every layer, times the slowest τ."""
    to, template, tag = work.to, work.template, f"e{work.index}"
    halo, slowest = reach(template.A), float(template.tau.max())
    sources = {(kind, layer): array for kind, layer, array in _sources(work)}
    starts = [sources.get(("state", n)) for n in range(template.layers)]
    rim, result = bool(halo and template.boundary.constant), list[_Rate]()
    seen = {
        n: Padded.copied(
            to, f"{tag}_x{n}", constant(0.0) if start is None else start, template.boundary, halo
        )
        for n, start in enumerate(starts)
        if rim or start is not None
    }
    for layer in range(template.layers):
        ratio, couplings = slowest / float(template.tau[layer]), taps(template.A, layer)
        terms = list[tuple[float, Quantity]]()
        name = f"{tag}_rate{layer}"
        rates = to.array(name, "work", to.cells, to.formats.kept(name), "rates at the start")
        with to.within() as body:
            for coupling in couplings:
                if coupling.source in seen:
                    there = seen[coupling.source].at(coupling.row, coupling.col)
                    terms.append((ratio * coupling.weight, there))
            if layer in seen:
                terms.append((-ratio, seen[layer].at(0, 0)))
            if ("drive", layer) in sources:
                terms.append((ratio, to.item(sources["drive", layer])))
            to.store(rates, to.arithmetic.weighted(terms, FINE))
        to.loop(body, cols=halo > 0, halo=halo)
        steps = [_quantum(starts[n]) for n in range(template.layers)]
        rounded = steps[layer] + _quantum(sources.get(("drive", layer)))
        rounded += sum(abs(coupling.weight) * steps[coupling.source] for coupling in couplings)
        result.append(_Rate(rates, 0.5 * ratio * rounded))
    return result


def _quantum(array: Array | None) -> float:
    """Return by how much two of an array's numbers may be apart that were one before rounding."""
    if array is None or array.format is None or array.exact:
        return 0.0
    return array.format.step


def _modes(work: TransientWork, scheme: Spectral, bits: int) -> tuple[Array, Array]:
    """Return the tables of the modes of rows and columns."""
    to, (rows, cols) = work.to, work.to.shape
    kind = f"{_kind(work)}_{bits}"
    along_rows, _ = to.table(f"modes_{rows}_{kind}", scheme.rows, "modes of rows", bits)
    along_cols, _ = to.table(f"modes_{cols}_{kind}", scheme.cols, "modes of columns", bits)
    return along_rows, along_cols


def _kind(work: TransientWork) -> str:
    return work.template.boundary.pad_mode


def _forward(
    work: TransientWork, kind: str, layer: int, source: Array, rows: Array, cols: Array
) -> Array:
    """Write R s Cᵀ."""
    (height, width), tag = work.to.shape, f"{work.index}_{kind}_{layer}"
    a, b = item_at(work.to, rows, ROW, height, J), item_at(work.to, source, J, width, COLUMN)
    half = _mixed(work, f"g{tag}", "modes of rows", height, a, b)
    a, b = item_at(work.to, half, ROW, width, J), item_at(work.to, cols, COLUMN, width, J)
    return _mixed(work, f"h{tag}", "modes of a map", width, a, b)


def _mixed(
    work: TransientWork, name: str, description: str, count: int, a: Quantity, b: Quantity
) -> Array:
    """Write a map of sums of products over `j`; return it."""
    to, target = work.to, _wide(work, name, description)
    with to.within() as body:
        to.store(target, sum_of(to, "mix", [(J, count)], a, b))
    to.loop(body, cols=True)
    return target


def _wide(work: TransientWork, name: str, description: str) -> Array:
    return work.to.array(name, "work", work.to.cells, work.to.formats.kept(name), description)
