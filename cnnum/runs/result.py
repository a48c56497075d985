"""The result of a template's run."""

import math
import pickle
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from cnnum import sharing
from cnnum.arrays import Floats
from cnnum.errors import CnnumError
from cnnum.integrators.estimate import LOST
from cnnum.templating.template import Template

if TYPE_CHECKING:
    from cnnum.runs.certificate import Certificate
from cnnum.plan import Plan
from cnnum.values import ByContent


@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """What is proven about the state of every cell at the end of a run.

    A run to equilibrium ends at the equilibrium that the array reaches. Nothing here is an
    estimate: if no proof is found, bounds are infinite and cells are open.

    Attributes
    ----------
    lower, upper : (..., rows, cols) or (..., layers, rows, cols) float
        Bounds on the true state.
    at_rest : (...) bool
        Whether it is proven that the outputs no longer change after the end: exactly if all cells
        are saturated, and otherwise within the tolerance of the run.
    """

    lower: Floats
    upper: Floats
    at_rest: NDArray[np.bool_]

    @property
    def sign(self) -> NDArray[np.int8]:
        """The sign of every cell's state, 1 or −1; 0 where it is open."""
        above = (self.lower > 0.0).astype(np.int8)
        return np.asarray(above - (self.upper < 0.0).astype(np.int8), dtype=np.int8)

    @property
    def saturated(self) -> NDArray[np.bool_]:
        """Whether the state of every cell is proven to be at or beyond 1 or −1."""
        return np.asarray((self.lower >= 1.0) | (self.upper <= -1.0))

    @property
    def open(self) -> NDArray[np.bool_]:
        """Whether the sign of a cell is not proven."""
        return np.asarray(self.sign == 0)

    def __repr__(self) -> str:
        sign = self.sign
        return (
            f"Decision({int((sign != 0).sum())} of {sign.size} cells proven, "
            f"{int(self.saturated.sum())} saturated, at rest {bool(np.all(self.at_rest))})"
        )


class Later:
    """A result that is made when one of its parts is first read.

    Parameters
    ----------
    make : callable
    """

    __slots__ = ("_made", "_make")

    def __init__(self, make: Callable[[], "Result"]) -> None:
        self._make: Callable[[], Result] | None = make
        self._made: Result | None = None

    def __call__(self) -> "Result":
        """Return the result."""
        if self._made is None:
            make = self._make
            assert make is not None
            self._made = make()
        return self._made

    def __reduce__(self) -> tuple[Any, ...]:
        """Go to another process made."""
        return _as_later, (self(),)


def _as_later(result: "Result") -> Later:
    return Later(lambda: result)


class Proof:
    """Everything that the proof of a run needs; `Certificate` computes it on request.

    Parameters
    ----------
    template : Template
    given : mapping of str to array, or sequence of array or None
        The run's maps, (..., maps, rows, cols) by role; or (rows, cols) in the order of `ROLES`.
        They are not copied, so the caller must not change them.
    duration : float or "settle"
        In the unit of `tau`.
    tolerances : (rtol, atol)
    state : (..., rows, cols) or (..., layers, rows, cols) float
    error : (...) float
        State and error of the result.
    """

    __slots__ = ("_given", "_made", "duration", "error", "state", "template", "tolerances")

    def __init__(
        self,
        template: Template,
        given: Mapping[str, NDArray[np.floating]] | Sequence[NDArray[np.floating] | None],
        duration: float | str,
        tolerances: tuple[float, float],
        state: Floats,
        error: Floats,
    ) -> None:
        self.template, self._given, self.duration = template, given, duration
        self.tolerances, self.state, self.error = tolerances, state, error
        self._made: Certificate | None = None

    @property
    def given(self) -> Mapping[str, NDArray[np.floating]]:
        """The run's maps by role, (..., maps, rows, cols) float."""
        given = self._given
        if isinstance(given, Mapping):
            return given
        held = zip(ROLES, given, strict=True)
        return {role: values[np.newaxis] for role, values in held if values is not None}

    def __reduce__(self) -> tuple[Any, ...]:
        """Go to another process unmade, and not with functions that cannot go there."""
        numbers_of_run = (
            self.template,
            self._given,
            self.duration,
            self.tolerances,
            self.state,
            self.error,
        )
        try:
            pickle.dumps(self.template)
        except (pickle.PicklingError, AttributeError, TypeError, CnnumError):
            return type(None), ()
        return Proof, numbers_of_run

    def made(self) -> "Certificate":
        """Return the proof."""
        if self._made is None:
            from cnnum.runs.certificate import Certificate  # with SciPy, which takes its time

            self._made = Certificate(self)
        return self._made


class Proven:
    """The proof of a run that was computed by one: what a `Certificate` would say of it.

    Parameters
    ----------
    state : (..., rows, cols) float
        An equilibrium, or close to it, with outputs that do not change any more.
    error : (...) float
    keeps : (...) bool
        Whether it is stable.
    """

    __slots__ = ("_error", "_keeps", "_state")

    def __init__(self, state: Floats, error: Floats, keeps: NDArray[np.bool_]) -> None:
        self._state, self._error, self._keeps = state, error, keeps

    @property
    def certified(self) -> NDArray[np.str_]:
        """How each frame's error is known."""
        return np.full(self._error.shape, "proven")

    @property
    def stability(self) -> NDArray[np.str_]:
        """The stability of the equilibrium at each frame's state."""
        return np.where(self._keeps, "stable", "unstable")

    @property
    def decision(self) -> Decision:
        """What is proven for every cell."""
        off = self._error[..., np.newaxis, np.newaxis]
        at_rest = np.ones(self._error.shape, dtype=bool)
        return Decision(self._state - off, self._state + off, at_rest)

    def made(self) -> "Proven":
        """Return the proof."""
        return self


class Decided:
    """Proof of outputs that were computed without states; further facts need the whole result.

    Parameters
    ----------
    output : (..., rows, cols) float
    later : Later
        The whole result.
    """

    __slots__ = ("_later", "_output")

    def __init__(self, output: Floats, later: Later) -> None:
        self._output, self._later = output, later

    def __reduce__(self) -> tuple[Any, ...]:
        """Go to another process with the whole result."""
        return Decided, (self._output, self._later)

    @property
    def certified(self) -> NDArray[np.str_]:
        """How each frame's error is known."""
        return self._later().certified

    @property
    def stability(self) -> NDArray[np.str_]:
        """The stability of the equilibrium at each frame's state."""
        return self._later().stability

    @property
    def decision(self) -> Decision:
        """What is proven for every cell: its output, which no longer changes."""
        y = self._output
        lower = np.where(y > -1.0, np.nextafter(y, -np.inf), -np.inf)
        upper = np.where(y < 1.0, np.nextafter(y, np.inf), np.inf)
        return Decision(
            np.where(y == 1.0, 1.0, lower),
            np.where(y == -1.0, -1.0, upper),
            np.ones(y.shape[:-2], dtype=bool),
        )

    def made(self) -> "Decided":
        """Return the proof."""
        return self


ROLES = ("input", "previous", "state", "bias", "mask")
"""Roles of the maps of a run, in the order of the arguments."""

LATER = ("state", "time", "steps", "settled", "error")
"""Attributes of a result that are computed when read, if its output is known without them."""

FEW = 6
"""Times that a picture shows."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Result(ByContent):
    """Result of the run of a template.

    Attributes
    ----------
    output, state : (..., rows, cols) or (..., layers, rows, cols) float
    time : (...) float
        Time reached, in the unit of `tau`. For an exact run to equilibrium, this is the time limit
        that other runs have. In discrete time it is a whole number of steps: a duration of 0.4
        takes one step and reaches 1.
    steps : (...) int
        Steps taken, including rejected ones; 0 if none were needed.
    settled : (...) bool
        Whether |dx/dt|·τ is below the tolerance in every cell. For a run to equilibrium, whether
        the equilibrium was reached and is stable (`stability`).
    error : (...) float
        Largest error of the state; `certified` says how it is known. For a run to equilibrium, it
        is the distance to the equilibrium of the true array, and infinite if the run is not shown
        to lead there. For other runs in steps, it is an estimate: the local errors and rounding
        errors of all steps, times a safety factor. For an exact solution, it bounds the rounding
        errors. With a delay, it comes from runs with steps of half the length. It is infinite if
        nothing is known: for fixed steps and discrete time without `estimate=True`, for forced
        steps, for runs with a delay to one of several equilibria, and where an estimate exceeds
        1e30.
    method : str
        Method of the run. With "decision", the output was computed in one pass over the input and
        is proven (`decision`); the run that gives state, time, steps, settled and error takes place
        when one of them is first read.
    reason : str
        Why this method was chosen: why the array is solved exactly, or about how many evaluations
        of the rates the method needs compared with others. The `reference` engine instead solves
        far below the tolerance, unless an exact solution exists or fixed steps were requested.
    ways : tuple of str
        The strategies of the run, from the outermost to the innermost: "chip", "batch", "times",
        "decided", "prepared", "wavefront", "compared", "settling", "halved", "implicit", "linear"
        and "plain".
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
    proof: Proof | Proven | Decided | None = field(default=None, repr=False, compare=False)
    ways: tuple[str, ...] = field(default=(), repr=False, compare=False)
    later: Later | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Make the arrays read-only, as those of all values that compare by content are."""
        for array in (self.output, self.state, self.time, self.steps, self.settled, self.error):
            if isinstance(cast(object, array), np.ndarray):  # not a number, which NumPy may give
                array.flags.writeable = False

    @classmethod
    def of_output(
        cls, output: Floats, method: str, reason: str, later: Later, proof: Decided
    ) -> "Result":
        """Return a result whose output is known and whose other attributes are computed later."""
        output.flags.writeable = False
        result = cls.__new__(cls)
        known = {"output": output, "method": method, "reason": reason, "times": (), "ways": ()}
        for name, value in (known | {"later": later, "proof": proof}).items():
            object.__setattr__(result, name, value)
        return result

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Make the parts that come later when the first of them is read."""
            if name in LATER:
                if self.later is not None:
                    made = self.later()
                    for part in LATER:
                        object.__setattr__(self, part, getattr(made, part))
                    object.__setattr__(self, "later", None)
                return object.__getattribute__(self, name)
            raise AttributeError(f"'Result' object has no attribute '{name}'")

    @property
    def certified(self) -> NDArray[np.str_]:
        """How the `error` of each frame is known, (...): "proven", "estimated" or "unknown".

        * "proven": in exact arithmetic, an array with this initial state is within `error` of
          `state` at the end, or reaches an equilibrium that is. An enclosure of its trajectory,
          independent of the run, shows this.
        * "estimated": `error` is finite, but no proof was found. For a run to equilibrium, it is
          proven that all states within the estimated error lead to one equilibrium, and how far
          away that is.
        * "unknown": `error` is infinite.

        The value is computed on first use, which takes from a tenth of a second per frame of a
        small array to a minute. Runs with `at`, of template batches or in whole numbers are never
        proven.
        """
        if self.proof is None:
            return np.where(np.isfinite(self.error), "estimated", "unknown")
        return self.proof.made().certified

    @property
    def stability(self) -> NDArray[np.str_]:
        """Stability of the equilibrium at `state`, (...): "stable", "unstable" or "unknown".

        An unstable equilibrium is a saddle or a source: an array that starts on it may stay there,
        but leaves it at the slightest disturbance. "unknown" is also the answer if no equilibrium
        is near.
        """
        if self.proof is None:
            return np.full(np.shape(self.error), "unknown")
        return self.proof.made().stability

    @property
    def decision(self) -> Decision:
        """What is proven for each cell: bounds, sign, saturation, and whether outputs are at rest.

        The value is computed on first use, as that of `certified`. In long runs, these bounds widen
        less than `error` does, because saturated cells add nothing.
        """
        if self.proof is None:
            wide = np.full(self.state.shape, np.inf)
            return Decision(-wide, wide, np.zeros(np.shape(self.error), dtype=bool))
        return self.proof.made().decision

    def __repr__(self) -> str:
        facts = ", ".join(f"{name} {value}" for name, value in self._facts())
        return f"Result({facts})"

    def _facts(self) -> list[tuple[str, str]]:
        settled = np.atleast_1d(self.settled)
        return [
            ("output", str(self.output.shape)),
            ("time", f"{float(np.max(self.time)):.4g}"),
            *((("times", str(len(self.times))),) if self.times else ()),
            ("steps", str(int(np.max(self.steps)))),
            ("settled", str(bool(settled.all()))),
            ("error", f"{float(np.max(self.error)):.2g}"),
            ("method", self.method),
        ]

    def maps(self) -> dict[str, Floats]:
        """Return the output and state of the first array and layer, (rows, cols) each, by name.

        For a run `at` times, these are its outputs at a few of the times.
        """
        if self.times:
            first = self.output.reshape(len(self.times), -1, *self.output.shape[-2:])[:, 0]
            few = np.unique(np.linspace(0, len(self.times) - 1, FEW).round().astype(int)).tolist()
            return {f"output at {self.times[n]:.4g}": first[n] for n in few}
        parts = {"output": self.output, "state": self.state}
        return {n: v.reshape(-1, *v.shape[-2:])[0] for n, v in parts.items()}

    def _repr_html_(self) -> str:
        shown = [sharing.picture(name, values) for name, values in self.maps().items()]
        return sharing.facts("Result", [*self._facts(), ("reason", self.reason)], shown)

    def plot(self, ax: object = None) -> object:
        """Draw the `maps`, and return the axes."""
        from cnnum import sharing

        return sharing.maps(self.maps(), ax)

    def to_xarray(self) -> Any:
        """Return an `xarray.Dataset` of output, state and statistics (extra `tables`).

        For a run `at` times, these are the coordinate "tau".
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
        return sharing.dataset(variables, places, {"method": self.method, "reason": self.reason})

    def to_dataframe(self) -> Any:
        """Return a `pandas.DataFrame` with one row per cell: time or place, output and state."""
        places: list[Any] = list(np.indices(self.output.shape).reshape(self.output.ndim, -1))
        lead = self.output.ndim - 2
        names = [*(f"axis_{n}" for n in range(lead)), "row", "col"]
        if self.times:
            names[0], places[0] = "tau", np.asarray(self.times)[places[0]]
        columns: dict[str, Any] = dict(zip(names, places, strict=True))
        columns |= {"output": self.output.ravel(), "state": self.state.ravel()}
        return sharing.data_frame(columns)


def with_proof(
    result: Result,
    template: Template,
    given: Mapping[str, NDArray[np.floating]] | Sequence[NDArray[np.floating] | None],
    duration: float | str,
    tolerances: tuple[float, float],
) -> Result:
    """Return the result with what its proof takes; parameters are those of `Proof`."""
    proof = Proof(template, given, duration, tolerances, result.state, result.error)
    object.__setattr__(result, "proof", proof)
    return result


def with_fallback(result: Result, plan: Plan) -> Result:
    """Return a result that also says on which engine it ran if not on the plan's own."""
    return replace(result, reason=f"{result.reason}; {plan.fallen}") if plan.fallen else result


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
