"""Conversion of a template, its array and its solver to arguments of the compiled functions."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.engines.numba import records
from cnnum.engines.numba.records import GAIN, SETTINGS, TABLE, TAP, Ints, Layout, Plan, Real, Reals
from cnnum.integrators.estimate import FLOOR, LOST, ROUNDINGS, error_growth, slopes_count
from cnnum.integrators.schemes import (
    LAYER_METHODS,
    MAX_STEPS,
    AdaptiveSteps,
    ChebyshevSteps,
    FixedSteps,
)
from cnnum.integrators.solver import Solver
from cnnum.integrators.tableau import MAX_STAGES, Explicit, Row, chebyshev_method
from cnnum.templating.couplings import NonlinearCoupling
from cnnum.templating.functions import PairFunction, Table
from cnnum.templating.network import gains_jump, lag, reads_states
from cnnum.templating.template import Template


def tableaux(solver: Solver) -> Floats:
    """Return (layers or 1, rows, stages) numbers, whose rows `codes` names."""
    scheme = solver.scheme
    if isinstance(scheme, FixedSteps):
        return np.array([_coefficients_fixed(tableau) for tableau in scheme.tableaux])
    if isinstance(scheme, AdaptiveSteps):
        result = [
            _rows(tableau.a, errors=tableau.error, parts=tableau.truncation)
            for tableau in scheme.tableaux
        ]
        return np.array(result)
    # one stage of no step gives the slopes
    return np.zeros((1, records.STAGES + 1, 2))


def _rows(
    a: tuple[Row, ...], weights: Row = (), errors: Row = (), parts: tuple[Row, ...] = ()
) -> Floats:
    """Return the rows that `codes` names; nothing is carried."""
    times = tuple(sum(row, Fraction(0)) for row in a)
    rows = np.zeros((records.STAGES + len(a) + len(parts), len(a)))
    for at, row in enumerate((weights, times, errors, (), *a, *parts)):
        rows[at, : len(row)] = [float(x) for x in row]
    return rows


def _coefficients_fixed(tableau: Explicit) -> Floats:
    rows = _rows(tableau.a, weights=tableau.b)
    rows[records.CARRIED, 0] = tableau.carried
    return rows


def part_tableaux(template: Template, solver: Solver, moments: Sequence[float]) -> Floats:
    """Return (times, layers, rows, stages) numbers of the parts of exponential steps up to times.

    Other steps have the same numbers whatever their length: there are none of these.
    """
    method, scheme = LAYER_METHODS.get(solver.method), solver.scheme
    if method is None or not len(moments):
        return np.zeros((0, 1, 1, 1))
    assert isinstance(scheme, FixedSteps | AdaptiveSteps)
    fixed = isinstance(scheme, FixedSteps)
    length = scheme.step if isinstance(scheme, FixedSteps) else scheme.first_step
    # the times at which steps begin, added up as they are on the way
    count = max(1, round(solver.duration / length))
    begins = np.append(0.0, np.cumsum(np.full(count - 1, length)))
    places = np.searchsorted(begins + length * records.ALMOST, moments, side="right")
    lengths = np.asarray(moments) - begins[np.minimum(places, len(begins) - 1)]
    lengths = np.maximum(lengths, records.ROUNDING * length)  # shorter ones are not taken
    stages = scheme.tableaux[0].stages
    table = np.zeros((len(lengths), template.layers, records.STAGES + stages + (not fixed), stages))
    for layer, tau in enumerate(template.tau.tolist()):
        own = table[:, layer]
        if fixed:
            a, own[:, records.WEIGHTS], own[:, records.CARRIED, 0] = method.fixed(lengths, tau)
        else:
            a, own[:, -1] = method.followed(lengths, tau)
        own[:, records.STAGES : records.STAGES + stages] = a
        own[:, records.TIMES] = a.sum(axis=2)
    return table


def chebyshev_rows(solver: Solver, dtype: Real) -> Reals:
    """Return (s · most + j, 4) numbers: stage j of s; the first stage's weight at j = 0."""
    if not isinstance(solver.scheme, ChebyshevSteps):
        return np.zeros((0, 4), dtype)
    table = np.zeros((MAX_STAGES + 1, MAX_STAGES, 4), dtype)
    for stages in range(2, MAX_STAGES + 1):
        method = chebyshev_method(stages)
        table[stages, 0, 2] = method.first
        table[stages, 1:stages] = method.rows
    return table.reshape(-1, 4)


def method_settings(template: Template, solver: Solver, dtype: Real) -> dict[str, Any]:
    """Return the settings that say how a transient runs."""
    settings = {
        "duration": solver.duration,
        "settle": solver.settle,
        "rtol": solver.rtol,
        "atol": solver.atol,
        "slowest": template.tau.max(),
        "growth": error_growth(template),
        "floor": FLOOR * solver.atol,
        "rounding": ROUNDINGS * float(np.finfo(dtype).eps),
    }
    scheme = solver.scheme
    if isinstance(scheme, FixedSteps):
        return settings | _methods_fixed(template, scheme)
    if isinstance(scheme, AdaptiveSteps):
        own = {
            "scheme": records.ADAPTIVE,
            "stages": scheme.tableau.stages,
            "bends": scheme.bends,
        }
        return settings | _controlled(scheme) | own
    if isinstance(scheme, ChebyshevSteps):
        return settings | _controlled(scheme) | _chebyshev(scheme)
    # there are no steps, but one stage says whether all is at rest
    return settings | {"scheme": records.KNOWN, "stages": 1, "step": 1.0}


def _methods_fixed(template: Template, scheme: FixedSteps) -> dict[str, Any]:
    return {
        "scheme": records.FIXED,
        "stages": scheme.stages,
        "count": scheme.count,
        "step": scheme.step,
        "last": scheme.last,
        "error": LOST,
        "lag": lag(template, scheme.step),
    }


def _controlled(scheme: AdaptiveSteps | ChebyshevSteps) -> dict[str, Any]:
    return {
        "step": scheme.first_step,
        "count": MAX_STEPS,
        "longest": scheme.control.longest,
        "exponent": -1.0 / scheme.control.order,
        "caution": scheme.control.caution,
        "least": scheme.control.least,
        "safety": scheme.safety,
        "later": scheme.later,
    }


def pieces_of(solver: Solver) -> NDArray[np.float64]:
    """Return the time intervals of a run: first step, start, and length of fixed steps."""
    scheme = solver.scheme
    if isinstance(scheme, FixedSteps) and scheme.pieces:
        return np.array([[piece.first, piece.start, piece.step] for piece in scheme.pieces])
    step = scheme.step if isinstance(scheme, FixedSteps) else 0.0
    stops = scheme.stops if isinstance(scheme, AdaptiveSteps) else ()
    return np.array([[0.0, start, step] for start in (0.0, *stops)])


def _chebyshev(scheme: ChebyshevSteps) -> dict[str, Any]:
    reach = (MAX_STAGES**2 - 1) / chebyshev_method(MAX_STAGES).real_stability
    own = {"scheme": records.CHEBYSHEV, "stages": 2, "most": MAX_STAGES}
    return own | {"reach": scheme.fastest * reach}


_QUANTITIES = {"x": records.MOVED, "y": records.OUTPUT, "u": records.INPUT, None: records.NOTHING}

_KINDS = 6


@dataclass(slots=True)
class Couplings:
    """The couplings of a template, as they are collected.

    Attributes
    ----------
    layout : Layout
    layers : int
    taps : list of (kind, layer, fields of a TAP)
    tables : list of Table
    pairs : list of PairFunction
    """

    layout: Layout
    layers: int
    taps: list[tuple[int, int, dict[str, Any]]] = field(
        default_factory=list[tuple[int, int, dict[str, Any]]]
    )
    tables: list[Table] = field(default_factory=list[Table])
    pairs: list[PairFunction] = field(default_factory=list[PairFunction])

    def linear(self, kind: int, kernels: Floats) -> None:
        """Add A or B, or a delayed one."""
        reach = kernels.shape[-1] // 2
        for to, source, row, col in np.argwhere(kernels).tolist():
            gain = to * self.layers + source if kind == records.FEEDBACK else self.layers**2
            tap = {
                "offset": self._offset(source, row - reach, col - reach),
                "weight": kernels[to, source, row, col],
                "gain": gain,
            }
            self.taps.append((kind, to, tap))

    def nonlinear(self, coupling: NonlinearCoupling) -> None:
        """Add a nonlinear coupling."""
        reach, function = coupling.weights.shape[0] // 2, self._function(coupling.function)
        kind = records.STILL if coupling.static else records.MOVING
        for row, col in np.argwhere(coupling.weights).tolist():
            tap = {
                "offset": self._offset(coupling.source, row - reach, col - reach),
                "weight": coupling.weights[row, col],
                "neighbour": _QUANTITIES[coupling.neighbour],
                "centre": _QUANTITIES[coupling.centre],
                "centre_offset": self._offset(coupling.centre_source, 0, 0),
                "sign": coupling.sign,
                "times": coupling.times_argument,
                **function,
            }
            self.taps.append((kind, coupling.to, tap))

    def _function(self, function: Table | PairFunction) -> dict[str, int]:
        """Return the fields of a tap that select its function."""
        if isinstance(function, Table):
            return {"table": self.table(function)}
        own = len(_operations(function, np.dtype(np.float64)))
        before = sum(len(_operations(pair, np.dtype(np.float64))) for pair in self.pairs)
        self.pairs.append(function)
        return {"begin": before, "operations": own}

    def table(self, table: Table) -> int:
        """Return the index of a function table."""
        self.tables.append(table)
        return len(self.tables) - 1

    def _offset(self, source: int, row: int, col: int) -> int:
        return source * self.layout.size + row * self.layout.pitch + col

    def packed_taps(self) -> tuple[NDArray[Any], Ints]:
        """Return all taps, and where those of every kind into each layer begin."""
        ordered = sorted(self.taps, key=lambda item: item[:2])
        slots = [kind * self.layers + layer for kind, layer, _ in ordered]
        ends = np.arange(_KINDS)[:, np.newaxis] * self.layers + np.arange(self.layers + 1)
        return packed(TAP, (tap for *_, tap in ordered)), np.searchsorted(slots, ends).astype("i8")

    def packed_tables(self, dtype: Real) -> tuple[NDArray[Any], Reals]:
        """Return the places of all tables' points, and the points."""
        firsts = np.cumsum([0, *(len(table.points) for table in self.tables)])
        tables = [
            {"first": first, "last": after - 1, "linear": table.interpolation == "linear"}
            for first, after, table in zip(firsts, firsts[1:], self.tables, strict=False)
        ]
        points = [point for table in self.tables for point in table.points]
        return packed(TABLE, tables), np.ascontiguousarray(
            np.array(points).reshape(-1, 2).T, dtype=dtype
        )

    def packed_pairs(self, dtype: Real) -> NDArray[np.float64]:
        """Return the operations of all functions of two cells."""
        return np.concatenate([np.zeros((0, 2)), *(_operations(f, dtype) for f in self.pairs)])


def _operations(function: PairFunction, dtype: Real) -> NDArray[np.float64]:
    variables = {"n": records.TAKE_STATE, "c": records.TAKE_CENTRE}
    return records.operations(function.opencl, dtype, variables)


def packed(kind: np.dtype[Any], records: Iterator[dict[str, Any]] | list[Any]) -> NDArray[Any]:
    """Return records as an array; fields missing from a record are 0."""
    listed = list(records)
    array = np.zeros(len(listed), kind)
    for place, record in enumerate(listed):
        for name, value in record.items():
            array[name][place] = value
    return array


def couplings_of(template: Template, layout: Layout) -> Couplings:
    """Return the couplings of a template without its gains."""
    couplings = Couplings(layout, template.layers)
    couplings.linear(records.FEEDBACK, template.A)
    couplings.linear(records.CONTROL, template.B)
    if template.delayed is not None:
        couplings.linear(records.LATE_FEEDBACK, template.delayed.A)
        couplings.linear(records.LATE_CONTROL, template.delayed.B)
    for coupling in template.nonlinear:
        couplings.nonlinear(coupling)
    return couplings


def gains_of(template: Template, couplings: Couplings) -> NDArray[Any]:
    """Return the gains of a template; their tables join those of the couplings."""
    gains = [
        {"place": gain.to * template.layers + gain.source, "table": couplings.table(gain.table)}
        for gain in template.gains
    ]
    return packed(GAIN, gains)


RESPONSES = {
    "standard": records.CLAMP,
    "full-range": records.CLAMP,
    "linear": records.IDENTITY,
    "tanh": records.TANH,
    "sign": records.SIGN,
}
"""Output functions that have a compiled form; others run by their expressions."""


def plan_of(template: Template, layout: Layout, solver: Solver, dtype: Real) -> Plan:
    """Return a template on an array, and how it runs."""
    couplings = couplings_of(template, layout)
    gains = gains_of(template, couplings)
    taps, first = couplings.packed_taps()
    tables, points = couplings.packed_tables(dtype)
    cells = {
        "layers": template.layers,
        "size": layout.size,
        "response": RESPONSES.get(template.output.name, records.EXPRESSION),
        "limited": template.output.limited,
        "reads_states": reads_states(template),
        "slopes_count": slopes_count(template),
        "jumping": gains_jump(template),
        "whole": template.output.discrete,
        "cuts": 1,
    }
    return Plan(
        settings=packed(SETTINGS, [cells | method_settings(template, solver, dtype)]),
        tableau=tableaux(solver),
        taps=taps,
        first=first,
        tables=tables,
        points=points,
        gains=gains,
        pieces=pieces_of(solver),
        rim=layout.rim(template.boundary),
        bands=layout.bands(template.layers),
        chebyshev=chebyshev_rows(solver, dtype),
        formula=_formula(template, dtype),
        pairs=couplings.packed_pairs(dtype),
    )


def _formula(template: Template, dtype: Real) -> NDArray[np.float64]:
    if template.output.name in RESPONSES:
        return np.zeros((0, 2))
    return records.operations(template.output.opencl, dtype, {"x": records.TAKE_STATE})
