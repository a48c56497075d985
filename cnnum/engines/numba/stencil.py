"""From a template's couplings to lists of taps, function tables and gains."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.engines.numba import codes
from cnnum.engines.numba.layout import Layout
from cnnum.engines.numba.records import GAIN, TABLE, TAP, Ints, Real, Reals
from cnnum.templating.couplings import NonlinearCoupling
from cnnum.templating.functions import PairFunction, Table
from cnnum.templating.template import Template

_QUANTITIES = {"x": codes.MOVED, "y": codes.OUTPUT, "u": codes.INPUT, None: codes.NOTHING}

_KINDS = 6


@dataclass(slots=True)
class Couplings:
    """All that cells do to each other, as it is collected.

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
            gain = to * self.layers + source if kind == codes.FEEDBACK else self.layers**2
            tap = {
                "offset": self._offset(source, row - reach, col - reach),
                "weight": kernels[to, source, row, col],
                "gain": gain,
            }
            self.taps.append((kind, to, tap))

    def nonlinear(self, coupling: NonlinearCoupling) -> None:
        """Add a nonlinear coupling."""
        reach, function = coupling.weights.shape[0] // 2, self._function(coupling.function)
        kind = codes.STILL if coupling.static else codes.MOVING
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
        """Return the fields of a tap that say its function."""
        if isinstance(function, Table):
            return {"table": self.table(function)}
        own = len(_operations(function, np.dtype(np.float64)))
        before = sum(len(_operations(each, np.dtype(np.float64))) for each in self.pairs)
        self.pairs.append(function)
        return {"begin": before, "operations": own}

    def table(self, table: Table) -> int:
        """Return the place of a function table."""
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
    variables = {"n": codes.TAKE_STATE, "c": codes.TAKE_CENTRE}
    return codes.operations(function.opencl, dtype, variables)


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
    found = Couplings(layout, template.layers)
    found.linear(codes.FEEDBACK, template.A)
    found.linear(codes.CONTROL, template.B)
    if template.delayed is not None:
        found.linear(codes.LATE_FEEDBACK, template.delayed.A)
        found.linear(codes.LATE_CONTROL, template.delayed.B)
    for coupling in template.nonlinear:
        found.nonlinear(coupling)
    return found


def gains_of(template: Template, couplings: Couplings) -> NDArray[Any]:
    """Return the gains of a template; their tables join those of the couplings."""
    gains = [
        {"place": gain.to * template.layers + gain.source, "table": couplings.table(gain.table)}
        for gain in template.gains
    ]
    return packed(GAIN, gains)
