"""The result of a template's run."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cnnum.arrays import Floats
from cnnum.integrators.estimate import LOST
from cnnum.sharing import html, tables
from cnnum.values import ByContent

FEW = 6
"""Times that a picture shows."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Result(ByContent):
    """The results of a template's run.

    Attributes
    ----------
    output, state : (..., rows, cols) or (..., layers, rows, cols) float
    time : (...) float
        Time constants reached. A run to a rest may be exact, so that it ends after any time. Then
        this is the longest that others may take.
    steps : (...) int
        Steps taken, rejected ones counted; 0 where none were needed.
    settled : (...) bool
        Whether |dx/dt|·τ is below the tolerance in every cell.
    error : (...) float
        Estimated error of the state: the sum of the steps' local errors and roundings, times a
        safety factor. Of an exact answer, it is its roundings; with a delay, that of runs in steps
        of half the length. Infinity means that nothing is known of it. So it is of steps of a fixed
        length, or in discrete time, which are not followed unless `estimate=True`. So it is, too,
        of runs with a delay up to a rest, and of steps that were forced. So it is where an estimate
        grew beyond 1e30.
    method : str
    reason : str
        Why this method: why the array is exact, or about how many evaluations of the rates it
        takes against others. The `reference` engine solves far below the tolerance instead, unless
        it is exact or the steps were asked for.
    """

    output: Floats
    state: Floats
    time: Floats
    steps: np.ndarray
    settled: np.ndarray
    error: Floats
    method: str
    reason: str
    times: tuple[float, ...] = ()

    def __repr__(self) -> str:
        facts = ", ".join(f"{name} {value}" for name, value in self._facts())
        return f"Result({facts})"

    def _facts(self) -> list[tuple[str, str]]:
        settled = np.atleast_1d(self.settled)
        return [
            ("output", str(self.output.shape)),
            ("time", f"{float(np.max(self.time)):.4g} τ"),
            *((("times", str(len(self.times))),) if self.times else ()),
            ("steps", str(int(np.max(self.steps)))),
            ("settled", str(bool(settled.all()))),
            ("error", f"{float(np.max(self.error)):.2g}"),
            ("method", self.method),
        ]

    def maps(self) -> dict[str, Floats]:
        """Return the (rows, cols) output and state of the first array and layer.

        Of a run `at` times these are its outputs at a few of them.
        """
        if self.times:
            first = self.output.reshape(len(self.times), -1, *self.output.shape[-2:])[:, 0]
            few = np.unique(np.linspace(0, len(self.times) - 1, FEW).round().astype(int)).tolist()
            return {f"output at {self.times[n]:.4g} τ": first[n] for n in few}
        parts = {"output": self.output, "state": self.state}
        return {n: v.reshape(-1, *v.shape[-2:])[0] for n, v in parts.items()}

    def _repr_html_(self) -> str:
        shown = [html.picture(name, values) for name, values in self.maps().items()]
        return html.facts("Result", [*self._facts(), ("reason", self.reason)], shown)

    def plot(self, ax: object = None) -> object:
        """Draw the `maps`, and return the axes."""
        from cnnum.sharing import plots

        return plots.maps(self.maps(), ax)

    def to_xarray(self) -> Any:
        """Return an `xarray.Dataset` of output, state and figures (extra `tables`).

        A run `at` times has them as its coordinate "tau".
        """
        batch = [f"batch_{n}" for n in range(np.ndim(self.time) - bool(self.times))]
        lead = ["tau", *batch] if self.times else batch
        inner = self.output.ndim - len(lead)
        axes = [*lead, *(("layer",) if inner == 3 else ()), "row", "col"]
        figures = ("time", "steps", "settled", "error")
        variables: dict[str, Any] = {
            name: (axes, getattr(self, name)) for name in ("output", "state")
        }
        variables |= {name: (lead, getattr(self, name)) for name in figures}
        places = {"tau": (("tau",), np.asarray(self.times))} if self.times else {}
        return tables.dataset(variables, places, {"method": self.method, "reason": self.reason})

    def to_dataframe(self) -> Any:
        """Return a `pandas.DataFrame` with a row a cell: its time or place, output, state."""
        places: list[Any] = list(np.indices(self.output.shape).reshape(self.output.ndim, -1))
        lead = self.output.ndim - 2
        names = [*(f"axis_{n}" for n in range(lead)), "row", "col"]
        if self.times:
            names[0], places[0] = "tau", np.asarray(self.times)[places[0]]
        columns: dict[str, Any] = dict(zip(names, places, strict=True))
        columns |= {"output": self.output.ravel(), "state": self.state.ravel()}
        return tables.data_frame(columns)


def result_of(outputs: Mapping[str, Floats], layers: int, method: str, reason: str) -> Result:
    """Return the result in the outputs of a run's plan.

    Parameters
    ----------
    outputs : mapping of str to (..., rows, cols) or (...) float
        "output N" and "state N" of every layer, and the run's figures.
    layers : int
    method, reason : str
    """

    def of_layers(what: str) -> Floats:
        planes = [outputs[f"{what} {layer}"] for layer in range(layers)]
        return np.stack(planes, axis=-3)

    error = outputs["error"]
    if error.ndim:
        error = np.where(error < LOST, error, math.inf)
    elif not error < LOST:  # one number is looked at in a tenth of the time
        error = np.array(math.inf)
    return Result(
        output=outputs["output 0"] if layers == 1 else of_layers("output"),
        state=outputs["state 0"] if layers == 1 else of_layers("state"),
        time=outputs["time"],
        steps=outputs["steps"].astype(np.int64),
        settled=outputs["settled"].astype(bool),
        error=error,
        method=method,
        reason=reason,
    )
