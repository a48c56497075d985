"""The reference engine: float64 NumPy and SciPy, operation by operation; slow, plain, trusted."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.engines.backend import Analogue, EngineRecord
from cnnum.engines.host import HostExecutable, HostMemory, Values, local, picked, picks
from cnnum.engines.notices import refuse_unfinished
from cnnum.engines.reference.equation import Feedback, Given, StateEquation
from cnnum.engines.reference.solve import Answer, change, instead, solve
from cnnum.graph.nodes import Loop, Node, Pick, Transient
from cnnum.graph.schedule import Schedule
from cnnum.integrators.estimate import LOST
from cnnum.integrators.series import Stretch
from cnnum.integrators.solver import Solver, Solvers
from cnnum.templating.template import Template


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceExecutable(HostExecutable):
    """Walks a schedule node by node.

    Attributes
    ----------
    solvers : mapping of int to Solver
        How each transient runs, by the index of its node.
    analogue : Analogue, optional
        Model of the array that programs run on.
    """

    solvers: Solvers
    analogue: Analogue | None = None

    def evaluate(self, values: dict[int, Values], batch: int) -> None:
        """Fill in the values of all nodes."""
        # overflow is infinite on every engine; the plan refuses it where it comes out
        with np.errstate(all="ignore"):
            known = cast(dict[int, Floats], values)
            self._evaluate(self.schedule.nodes, known, {}, np.ones((batch, 1, 1), bool))

    def _evaluate(
        self,
        nodes: tuple[Node, ...],
        values: dict[int, Floats],
        answers: dict[int, dict[str, Floats]],
        running: NDArray[np.bool_],
    ) -> None:
        """Fill in the values of nodes whose arguments are known; those of running frames count."""
        for node in nodes:
            arguments = [values[a.index] for a in node.arguments if a.index in values]
            operation = node.operation
            if node.index in values:
                continue
            if isinstance(operation, Transient):
                answers[node.index] = self._transient(node, operation, arguments, running)
            elif isinstance(operation, Loop):
                answer = answers[node.index] = self._loop(operation, arguments, running)
                if not picks(node, "finished", nodes):
                    refuse_unfinished((running & (answer["finished"] == 0.0)).ravel())
            elif isinstance(operation, Pick):
                values[node.index] = cast(
                    Floats, picked(operation, answers[node.arguments[0].index])
                )
            else:
                values[node.index] = np.asarray(local(operation, arguments), np.float64)

    def _loop(
        self, loop: Loop, arguments: list[Floats], outside: NDArray[np.bool_]
    ) -> dict[str, Floats]:
        """Run a loop's body; frames that have stopped keep their values."""
        start, *rest = arguments
        count, batch = len(loop.results), len(outside)
        running = outside & (start != 0.0)
        carried = [np.broadcast_to(v, (batch, *v.shape[1:])).copy() for v in rest[:count]]
        iterations = np.zeros((batch, 1, 1))
        for _ in range(loop.limit):
            if not running.any():
                break
            values = {node.index: carried[place] for place, node in loop.carried.items()}
            values |= {node.index: rest[count + n] for n, node in loop.captured.items()}
            self._evaluate(loop.nodes, values, {}, running)
            becomes = [
                np.where(running, values[n.index], carried[k]) for k, n in enumerate(loop.results)
            ]
            changed = np.zeros((batch, 1, 1), dtype=bool)
            for was, now in zip(carried, becomes, strict=True):
                changed |= (was != now).any(axis=(1, 2), keepdims=True)
            iterations += running
            again = changed if loop.again is None else values[loop.again.index] != 0.0
            running = running & again
            carried = becomes
        answers = {f"carried {k}": value for k, value in enumerate(carried)}
        return answers | {"iterations": iterations, "finished": (~running).astype(np.float64)}

    def _transient(
        self,
        node: Node,
        operation: Transient,
        arguments: list[Floats],
        running: NDArray[np.bool_],
    ) -> dict[str, Floats]:
        """Solve frames that go on; answers by name, (batch, layers, rows, cols) maps, else 0."""
        batch = len(running)
        frames, going = self._by_frame(operation, arguments, batch), np.flatnonzero(running)
        solver = self.solvers[node.index]
        answers = [self.answer(operation, solver, frames[frame]) for frame in going]
        result = dict[str, Floats]()
        for name, value in answers[0].items():
            result[name] = np.zeros((batch, *value.shape))
            result[name][going] = [answer[name] for answer in answers]
        return result

    def _by_frame(
        self, operation: Transient, arguments: list[Floats], batch: int
    ) -> list[dict[str, Floats]]:
        """Return the (maps, rows, cols) of every frame by role."""
        shape = self.schedule.shape
        stacked = {
            role: np.stack([np.broadcast_to(m, (batch, *shape)) for m in maps], axis=1)
            for role, maps in operation.by_role(arguments).items()
            if maps
        }
        return [{role: maps[frame] for role, maps in stacked.items()} for frame in range(batch)]

    def look(
        self,
        frames: Floats,
        moments: Sequence[float],
        ends: Sequence[Stretch] = (),
        cuts: int = 1,
    ) -> dict[str, Floats]:
        """Return the samples at given times of a run with a single transient.

        Of runs that are solved finely, by implicit steps, or without any: `Looking` says the rest.
        """
        memory = self.new_memory(len(frames))
        assert isinstance(memory, HostMemory)
        values = cast(dict[int, Floats], self._given(frames, memory, first=True))
        (node,) = self.schedule.transients
        assert isinstance(node.operation, Transient)
        before = self.schedule.nodes[: self.schedule.nodes.index(node)]
        seen, marks = list[list[Floats]](), list[list[list[Floats]]]()
        with np.errstate(all="ignore"):
            self._evaluate(before, values, {}, np.ones((len(frames), 1, 1), bool))
            arguments = [values[argument.index] for argument in node.arguments]
            for maps in self._by_frame(node.operation, arguments, len(frames)):
                equation = self._equation(node.operation, maps, None)
                passed = _passed(equation, self.solvers[node.index], moments)
                seen.append([end["state"] for end in passed])
                marks.append([[end[n] for n in ("steps", "settled", "error")] for end in passed])
        return {"seen": np.array(seen).swapaxes(0, 1), "marks": np.array(marks).swapaxes(0, 1)}

    def answer(
        self, operation: Transient, solver: Solver, maps: dict[str, Floats]
    ) -> dict[str, Floats]:
        """Return the answers of a template's run on one frame; maps by role."""
        if self.analogue is None:
            return self.solved(operation, solver, maps, None)

        def solve(
            operation: Transient, maps: dict[str, Floats], feedback: Feedback | None
        ) -> dict[str, Floats]:
            return self.solved(operation, solver, maps, feedback)

        return self.analogue.answer(solve, operation, maps, self.schedule.shape)

    def solved(
        self,
        operation: Transient,
        solver: Solver,
        maps: dict[str, Floats],
        feedback: Feedback | None,
    ) -> dict[str, Floats]:
        """Return the answers of a template whose feedback may differ from cell to cell."""
        return _figures(self._equation(operation, maps, feedback), solver)

    def _equation(
        self, operation: Transient, maps: dict[str, Floats], feedback: Feedback | None
    ) -> StateEquation:
        held = maps["mask"][0] != 0.0 if "mask" in maps else None
        given = Given(
            maps.get("input"), maps.get("previous"), maps.get("state"), maps.get("bias"), held,
            feedback,
        )  # fmt: skip
        return StateEquation(operation.template, self.schedule.shape, given)


def _figures(equation: StateEquation, solver: Solver) -> dict[str, Floats]:
    return _noted(
        equation, solver, solve(equation.template, equation.shape, solver, equation.given)
    )


def _passed(
    equation: StateEquation, solver: Solver, moments: Sequence[float]
) -> list[dict[str, Floats]]:
    """Return the same at moments on the way."""
    result = solve(equation.template, equation.shape, solver, equation.given, moments)
    return [_noted(equation, solver, answer) for answer in result.passed]


def _noted(equation: StateEquation, solver: Solver, result: Answer) -> dict[str, Floats]:
    return {
        "output": equation.outputs(result.state),
        "state": result.state,
        "time": np.asarray(result.time),
        "steps": np.asarray(float(result.steps)),
        "settled": np.asarray(float(change(equation, result, solver) <= 1.0)),
        "error": np.asarray(min(result.error, LOST)),
    }


class ReferenceBackend:
    """Needs no device; always float64.

    Parameters
    ----------
    record : EngineRecord
    device : None
    precision : "float64"
    model : callable, optional
        Makes the model of the array that a program runs on.
    """

    device = "NumPy and SciPy on the host"
    in_host_memory = True

    def __init__(
        self,
        record: EngineRecord,
        device: None,
        precision: str,
        model: Callable[[], Analogue] | None = None,
    ) -> None:
        self.record, self.precision, self._model = record, precision, model

    def explained(self, template: Template, solver: Solver) -> Solver:
        """Return the solver, whose reason says where it is solved finely instead."""
        words = instead(template, solver)
        return replace(solver, reason=f"{solver.reason}; here {words}") if words else solver

    def build(self, schedule: Schedule, solvers: Solvers) -> ReferenceExecutable:
        """Return the schedule ready to run.

        Raises
        ------
        NotSupportedError
            If the analogue array cannot run a template.
        """
        analogue = None
        if self._model is not None:
            analogue = self._model()
            for node in schedule.transients:
                assert isinstance(node.operation, Transient)
                analogue.refuse(node.operation.template)
        return ReferenceExecutable(schedule, np.dtype(np.float64), solvers, analogue)


def on_analogue(record: EngineRecord, model: Callable[[], Analogue]) -> ReferenceBackend:
    """Return the engine whose programs run on an analogue array."""
    return ReferenceBackend(record, None, "float64", model)
