"""Exact answers of linear arrays as sums of products: a matrix, modes, or shifts on a torus."""

from collections.abc import Callable, Sequence
from math import prod
from typing import NamedTuple

import numpy as np

from cnnum import kernels as ir
from cnnum.arrays import Floats
from cnnum.embedded.arithmetic.fixed import Quantity, constant
from cnnum.embedded.arithmetic.primitives import LOGIC
from cnnum.embedded.arithmetic.whole import call, opposite
from cnnum.embedded.lowering.builder import CELL, COLUMN, FINE, ROW
from cnnum.embedded.lowering.neighbours import Padded, reach
from cnnum.embedded.lowering.transient_work import TransientWork
from cnnum.embedded.program import Array
from cnnum.integrators.exact_ends.circulant import Circulant
from cnnum.integrators.exact_ends.propagator import Decay, Propagator
from cnnum.integrators.exact_ends.spectral import Spectral
from cnnum.integrators.solver import Solver
from cnnum.templating.network import taps

J = ir.Name("j", (0, 1 << 16))
DOWN = ir.Name("d", (0, 1 << 16))

Ends = Callable[[int, Quantity], None]
"""Takes in the end of a layer in a cell: a state, or a rate."""


def _item(
    work: TransientWork, array: Array, row: ir.Expression, width: int, col: ir.Expression
) -> Quantity:
    """Return the number of an array at a row and a column."""
    return work.to.item(array, call("add", call("multiply", row, ir.Integer(width)), col))


def _total(
    work: TransientWork, name: str, over: Sequence[tuple[ir.Name, int]], a: Quantity, b: Quantity
) -> Quantity:
    """Write a sum of products over counts, the last one innermost; return it."""
    count = prod(number for _, number in over)
    term = call("multiply", a.value, b.value)
    bounds = None
    if term.bounds is not None:
        bounds = min(0, count * term.bounds[0]), max(0, count * term.bounds[1])
    sum, nothing = ir.Name(name, bounds), work.to.zero()
    inner: ir.Statement = ir.add(sum, term)
    for variable, number in reversed(over):
        inner = ir.Loop(variable, number, (inner,))
    work.to.body += [ir.declare(sum, nothing), inner]
    return Quantity(sum, a.fraction + b.fraction)


def _sources(work: TransientWork) -> list[tuple[str, int, Array]]:
    """Write drives and starts that are not 0, once; return them with their kind and layer."""
    found = list[tuple[str, int, Array]]()
    work.prepare()
    to, template = work.to, work.template
    for layer in range(template.layers):
        name = f"w{work.index}_{layer}"
        with to.within() as body:
            terms = work.drive_terms(layer, 1.0)
            if terms and name in to.arrays:
                found.append(("drive", layer, to.arrays[name]))
            elif terms:
                array = to.array(name, "work", to.cells, to.formats.stored(name), "drive")
                to.store(array, to.arithmetic.weighted(terms, FINE))
                found.append(("drive", layer, array))
        to.loop(body, cols=work.halo > 0, halo=work.halo)
        start = _start(work, layer)
        if start is not None:
            found.append(("state", layer, start))
    return found


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
    found = dict[int, Array]()
    _dense(work, scheme, _sources(work), _answering(work, found))
    return found


def _answering(work: TransientWork, found: dict[int, Array]) -> Ends:
    """Return the function that writes the answers of a layer from its state, and keeps them."""
    return lambda layer, state: found.update(work.answers(layer, state))


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
                    table = _table(work, f"{kind}_{layer}_{source}", block, "propagator")
                    a, b = _item(work, table, CELL, n, J), to.item(array, J)
                    parts.append(_total(work, f"s_{kind}_{layer}_{source}", [(J, n)], a, b))
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
    for one in parts[1:]:
        total = to.arithmetic.add(total, one, FINE)
    return total


def around_torus(work: TransientWork, scheme: Circulant) -> dict[int, Array]:
    """Write the equilibrium as a sum of shifted drives, each weighed by its distance on the torus.

    A table holds the weights of distances from 1 − n to n − 1 along both axes. So no index wraps
    around. It is reversed, so that table and drive are read in the same direction.
    """
    to, (rows, cols) = work.to, work.to.shape
    sources = _sources(work)
    apart = [np.arange(n - 1, -n, -1) for n in (rows, cols)]
    width, found = 2 * cols - 1, dict[int, Array]()
    row = call("add", call("subtract", ir.Integer(rows - 1), ROW), DOWN)
    col = call("add", call("subtract", ir.Integer(cols - 1), COLUMN), J)
    for layer in work.layers:
        with to.within() as body:
            parts = list[Quantity]()
            for kind, source, array in sources:
                weights = scheme.drive[layer, source][np.ix_(*apart)]
                if kind == "drive" and np.any(weights):
                    table, _ = to.table(f"k{work.index}_{layer}_{source}", weights, "by distance")
                    a, b = _item(work, table, row, width, col), _item(work, array, DOWN, cols, J)
                    over = [(DOWN, rows), (J, cols)]
                    parts.append(_total(work, f"s_{layer}_{source}", over, a, b))
            found |= work.answers(layer, _sum(work, parts, np.zeros(1), layer))
        to.loop(body, cols=True)
    return found


def through_modes(work: TransientWork, scheme: Spectral) -> dict[int, Array]:
    """Write x(t) = Rᵀ [factors · (R s Cᵀ)] C + constant, summed over starts and drives s."""
    found = dict[int, Array]()
    _modal(work, scheme, _sources(work), _answering(work, found))
    return found


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
    along_rows, _ = to.table(f"modes_{rows}_{_kind(work)}", scheme.rows, "modes of rows")
    along_cols, _ = to.table(f"modes_{cols}_{_kind(work)}", scheme.cols, "modes of columns")
    seen = [
        (kind, layer, _forward(work, f"{kind}{tag}", layer, one, along_rows, along_cols))
        for kind, layer, one in sources
    ]
    for layer in work.layers:
        mixed = _wide(work, f"u{work.index}_{layer}{tag}", "modes of the answer")
        with to.within() as body:
            parts = list[Quantity]()
            for kind, source, array in seen:
                block = factors[kind][layer, source]
                table = _table(work, f"{kind}_{layer}_{source}", block, "factors of modes")
                parts.append(to.arithmetic.multiply(to.item(table), to.item(array), FINE))
            to.store(mixed, _sum(work, parts, np.zeros(1), layer))
        to.loop(body)
        # over rows: Rᵀ, so the table's columns
        a, b = _item(work, along_rows, J, rows, ROW), _item(work, mixed, J, cols, COLUMN)
        half = _mixed(work, f"v{work.index}_{layer}{tag}", "modes of columns", rows, a, b)
        a, b = _item(work, half, ROW, cols, J), _item(work, along_cols, J, cols, COLUMN)
        with to.within() as body:
            end = _total(work, f"s_{layer}", [(J, cols)], a, b)
            ends(layer, _sum(work, [end], scheme.constant[layer], layer))
        to.loop(body, cols=True)


def rests(work: TransientWork, solver: Solver) -> Quantity:
    """Write whether an array rests at its exact end: its rates there are within the tolerances.

    The rates of a linear array decay as its states do: x'(t) is the part "state" of its end of
    x'(0). Those of a cell under the mask are 0. The rate of a fast layer counts by the slowest τ.
    Roundings of stored starts and drives are no rates.
    """
    to, scheme, rates = work.to, solver.scheme, _rates(work)
    moves = ir.Name(f"moves{work.index}", LOGIC)

    def ends(layer: int, rate: Quantity) -> None:
        arithmetic, x = to.arithmetic, to.item(work.target(layer, "state"))
        most = solver.atol + decayed[layer] * rates[layer].rounded
        share = arithmetic.multiply(arithmetic.absolute(x), constant(solver.rtol), FINE)
        bound = arithmetic.add(share, constant(most), FINE)
        moving = arithmetic.compare("greater", arithmetic.absolute(rate), bound).value
        if work.given["mask"]:
            moving = call("and", moving, opposite(work.cell(work.given["mask"][0]).value))
        to.body.append(ir.Accumulate(moves, "maximum", moving))

    to.body.append(ir.declare(moves, 0))
    begun = [("state", n, one.array) for n, one in enumerate(rates)]
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
        for layer, one in enumerate(rates):
            with to.within() as body:
                ends(layer, to.arithmetic.weighted([(decayed[layer], to.item(one.array))], FINE))
            to.loop(body)
    return to.let(f"settled_{work.index}", Quantity(opposite(moves)))


class _Rate(NamedTuple):
    """The rates of a layer at the start, and by how much roundings may make them larger."""

    array: Array
    rounded: float


def _rates(work: TransientWork) -> list[_Rate]:
    """Write (w + A ∗ x₀ − x₀) / τ of every layer, times the slowest τ."""
    to, template, tag = work.to, work.template, f"e{work.index}"
    halo, slowest = reach(template.A), float(template.tau.max())
    sources = {(kind, layer): one for kind, layer, one in _sources(work)}
    starts = [sources.get(("state", n)) for n in range(template.layers)]
    rim, found = bool(halo and template.boundary.constant), list[_Rate]()
    seen = {
        n: Padded.copied(
            to, f"{tag}_x{n}", constant(0.0) if one is None else one, template.boundary, halo
        )
        for n, one in enumerate(starts)
        if rim or one is not None
    }
    for layer in range(template.layers):
        ratio, couplings = slowest / float(template.tau[layer]), taps(template.A, layer)
        terms = list[tuple[float, Quantity]]()
        name = f"{tag}_rate{layer}"
        rates = to.array(name, "work", to.cells, to.formats.kept(name), "rates at the start")
        with to.within() as body:
            for one in couplings:
                if one.source in seen:
                    there = seen[one.source].at(one.row, one.col)
                    terms.append((ratio * one.weight, there))
            if layer in seen:
                terms.append((-ratio, seen[layer].at(0, 0)))
            if ("drive", layer) in sources:
                terms.append((ratio, to.item(sources["drive", layer])))
            to.store(rates, to.arithmetic.weighted(terms, FINE))
        to.loop(body, cols=halo > 0, halo=halo)
        steps = [_step(starts[n]) for n in range(template.layers)]
        rounded = steps[layer] + _step(sources.get(("drive", layer)))
        rounded += sum(abs(one.weight) * steps[one.source] for one in couplings)
        found.append(_Rate(rates, 0.5 * ratio * rounded))
    return found


def _step(array: Array | None) -> float:
    return 0.0 if array is None or array.format is None else array.format.step


def _table(work: TransientWork, name: str, values: Floats, about: str) -> Array:
    """Return a table of a transient, which may be there."""
    found = work.to.arrays.get(f"k{work.index}_{name}")
    return found or work.to.table(f"k{work.index}_{name}", values, about)[0]


def _kind(work: TransientWork) -> str:
    return work.template.boundary.pad_mode


def _forward(
    work: TransientWork, kind: str, layer: int, source: Array, rows: Array, cols: Array
) -> Array:
    """Write R s Cᵀ."""
    (height, width), tag = work.to.shape, f"{work.index}_{kind}_{layer}"
    a, b = _item(work, rows, ROW, height, J), _item(work, source, J, width, COLUMN)
    half = _mixed(work, f"g{tag}", "modes of rows", height, a, b)
    a, b = _item(work, half, ROW, width, J), _item(work, cols, COLUMN, width, J)
    return _mixed(work, f"h{tag}", "modes of a map", width, a, b)


def _mixed(
    work: TransientWork, name: str, about: str, count: int, a: Quantity, b: Quantity
) -> Array:
    """Write a map of sums of products over `j`; return it."""
    to, target = work.to, _wide(work, name, about)
    with to.within() as body:
        to.store(target, _total(work, "mix", [(J, count)], a, b))
    to.loop(body, cols=True)
    return target


def _wide(work: TransientWork, name: str, about: str) -> Array:
    return work.to.array(name, "work", work.to.cells, work.to.formats.kept(name), about)
