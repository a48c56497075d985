"""The reference engine: float64 NumPy and SciPy, operation by operation; slow, plain, trusted."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.engines.backend import Solvers
from cnnum.engines.failures import refuse_unfinished
from cnnum.engines.reference.equation import Given, StateEquation
from cnnum.engines.reference.solve import change, instead, solve
from cnnum.errors import DeviceError, name_error
from cnnum.graph.nodes import (
    CAPTURED,
    Apply,
    Constant,
    ConstantMap,
    FirstFrame,
    Input,
    Loop,
    Node,
    Parameter,
    Pick,
    Read,
    Reduce,
    Transient,
)
from cnnum.graph.schedule import Schedule
from cnnum.integrators.estimate import LOST
from cnnum.integrators.solver import Solver
from cnnum.templating.template import Template


@dataclass(slots=True, eq=False)
class ReferenceMemory:
    """What the memories of a batch of streams hold, by number."""

    values: dict[int, Floats] = field(default_factory=dict[int, Floats])


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceExecutable:
    """Walks a schedule node by node.

    Every value is (batch, rows, cols), a stack (batch, maps · rows, cols), a number (batch, 1, 1).
    """

    schedule: Schedule
    solvers: Solvers

    @property
    def launches(self) -> int:
        """There is no device to launch on."""
        return 0

    @property
    def private_bytes(self) -> int:
        """There is no device with private memory."""
        return 0

    @property
    def local_bytes(self) -> int:
        """There is no device with local memory."""
        return 0

    @property
    def scratch_bytes(self) -> int:
        """The host's memory is not counted."""
        return 0

    @property
    def source(self) -> str:
        """The operations in words."""
        lines = [
            f"{node.index}: {node.operation} of {[a.index for a in node.arguments]}"
            for node in self.schedule.nodes
        ]
        return "\n".join(lines)

    def new_memory(self, batch: int) -> object:
        """Return cleared memories."""
        rows, cols = self.schedule.shape
        return ReferenceMemory(
            {
                number: np.zeros(
                    (batch, 1, 1) if memory.read.scalar else (batch, memory.read.maps * rows, cols)
                )
                for number, memory in self.schedule.memories.items()
            }
        )

    def held(self, memory: object, batch: int) -> tuple[NDArray[np.floating], ...]:
        """Return what memories hold."""
        assert isinstance(memory, ReferenceMemory)
        return tuple(memory.values.values())

    def restore(self, memory: object, numbers: Sequence[NDArray[np.floating]], batch: int) -> None:
        """Let memories hold a copy of these numbers."""
        assert isinstance(memory, ReferenceMemory)
        copies = (np.array(values, dtype=np.float64) for values in numbers)
        memory.values = dict(zip(memory.values, copies, strict=True))

    def one(self, memory: object) -> None:
        """A single frame goes the way of a batch."""

    def run_large(self, maps: Sequence[NDArray[np.floating]], lead: tuple[int, ...]) -> None:
        """Large arrays go the way of others, and are looked at before."""

    def run(
        self, frames: NDArray[np.floating], memory: object, *, first: bool
    ) -> dict[str, Floats]:
        """Run every operation on the whole batch."""
        assert isinstance(memory, ReferenceMemory)
        inputs = {
            name: np.asarray(frames[..., place], dtype=np.float64)
            for place, name in enumerate(self.schedule.channels_read)
        }
        batch = len(frames)
        values: dict[int, Floats] = {}
        for node in self.schedule.nodes:
            operation = node.operation
            if isinstance(operation, Input):
                values[node.index] = inputs[operation.channel]
            elif isinstance(operation, Read):
                values[node.index] = memory.values[operation.memory]
            elif isinstance(operation, FirstFrame):
                values[node.index] = np.full((1, 1, 1), float(first))
        # what overflows is infinite on every engine; the plan refuses it where it comes out
        with np.errstate(all="ignore"):
            self._evaluate(self.schedule.nodes, values, {}, batch)
        for number, kept in self.schedule.memories.items():
            shape = memory.values[number].shape
            memory.values[number] = np.broadcast_to(values[kept.store.index], shape).copy()
        return self._outputs(values, batch)

    def _evaluate(
        self,
        nodes: tuple[Node, ...],
        values: dict[int, Floats],
        answers: dict[int, dict[str, Floats]],
        batch: int,
    ) -> None:
        """Fill in the values of nodes whose arguments are known."""
        for node in nodes:
            arguments = [values[a.index] for a in node.arguments if a.index in values]
            operation = node.operation
            if node.index in values:
                continue
            if isinstance(operation, Transient):
                answers[node.index] = self._transient(node, operation, arguments, batch)
            elif isinstance(operation, Loop):
                answers[node.index] = self._loop(operation, arguments, batch)
                if not _read_by_a_pick(node, "finished", nodes):
                    refuse_unfinished(1.0 - answers[node.index]["finished"].ravel())
            elif isinstance(operation, Pick):
                values[node.index] = _picked(operation, answers[node.arguments[0].index])
            else:
                values[node.index] = _local(operation, arguments)

    def _loop(self, loop: Loop, arguments: list[Floats], batch: int) -> dict[str, Floats]:
        """Run a loop's body; frames that have stopped keep their values."""
        start, *rest = arguments
        count = len(loop.results)
        running = np.broadcast_to(start != 0.0, (batch, 1, 1)).copy()
        carried = [np.broadcast_to(v, (batch, *v.shape[1:])).copy() for v in rest[:count]]
        iterations = np.zeros((batch, 1, 1))
        for _ in range(loop.limit):
            if not running.any():
                break
            values: dict[int, Floats] = {}
            for node in loop.parameters:
                assert isinstance(node.operation, Parameter)
                place = node.operation.place
                captured = count + place - CAPTURED
                values[node.index] = carried[place] if place < CAPTURED else rest[captured]
            self._evaluate(loop.nodes, values, {}, batch)
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

    def _outputs(self, values: dict[int, Floats], batch: int) -> dict[str, Floats]:
        outputs: dict[str, Floats] = {}
        for name, node in self.schedule.outputs.items():
            value = values[node.index]
            whole = np.broadcast_to(value, (batch, *value.shape[1:]))
            outputs[name] = whole.reshape(batch, *self.schedule.shape_of(node)).copy()
        return outputs

    def _transient(
        self, node: Node, operation: Transient, arguments: list[Floats], batch: int
    ) -> dict[str, Floats]:
        """Solve frame by frame; answers by name, maps as (batch, layers, rows, cols)."""
        template, shape, solver = operation.template, self.schedule.shape, self.solvers[node.index]
        stacked = {
            role: np.stack([np.broadcast_to(m, (batch, *shape)) for m in maps], axis=1)
            for role, maps in operation.by_role(arguments).items()
            if maps
        }

        def answer(frame: int) -> dict[str, Floats]:
            own = {role: maps[frame] for role, maps in stacked.items()}
            held = own["mask"][0] != 0.0 if "mask" in own else None
            given = Given(
                own.get("input"), own.get("previous"), own.get("state"), own.get("bias"), held
            )
            return _figures(StateEquation(template, shape, given), solver)

        answers = [answer(frame) for frame in range(batch)]
        return {name: np.array([one[name] for one in answers]) for name in answers[0]}


def _read_by_a_pick(node: Node, what: str, nodes: tuple[Node, ...]) -> bool:
    return any(
        isinstance(user.operation, Pick)
        and user.arguments == (node,)
        and user.operation.what == what
        for user in nodes
    )


def _figures(equation: StateEquation, solver: Solver) -> dict[str, Floats]:
    found = solve(equation.template, equation.shape, solver, equation.given)
    return {
        "output": equation.outputs(found.state),
        "state": found.state,
        "time": np.asarray(found.time),
        "steps": np.asarray(float(found.steps)),
        "settled": np.asarray(float(change(equation, found, solver) <= 1.0)),
        "error": np.asarray(min(found.error, LOST)),
    }


def _picked(operation: Pick, source: dict[str, Floats]) -> Floats:
    if operation.what in ("output", "state"):
        return source[operation.what][:, operation.layer]
    if operation.what == "carried":
        return source[f"carried {operation.layer}"]
    figure = source[operation.what]
    return figure if figure.ndim == 3 else figure[:, np.newaxis, np.newaxis]


def _local(operation: object, arguments: list[Floats]) -> Floats:
    if isinstance(operation, Constant):
        return np.full((1, 1, 1), operation.value)
    if isinstance(operation, ConstantMap):
        return operation.values[np.newaxis]
    if isinstance(operation, Apply):
        return np.asarray(operation.function.numpy(*arguments), dtype=np.float64)
    assert isinstance(operation, Reduce)
    reduced = np.asarray(operation.function.numpy(arguments[0]), dtype=np.float64)
    return reduced[:, np.newaxis, np.newaxis]


class ReferenceBackend:
    """Needs no device; always float64."""

    name = "reference"
    device = "NumPy and SciPy on the host"
    precision = "float64"

    def __init__(self, device: str | None, precision: str | None) -> None:
        if device is not None:
            raise DeviceError(f"The reference engine runs on the host, got device={device!r:.60}.")
        if precision not in (None, "float64"):
            raise name_error("precision", str(precision), ("float64",))

    def told(self, template: Template, solver: Solver) -> Solver:
        """Return the solver, whose reason tells where it is solved finely instead."""
        words = instead(template, solver)
        return replace(solver, reason=f"{solver.reason}; here {words}") if words else solver

    def build(self, schedule: Schedule, solvers: Solvers) -> ReferenceExecutable:
        """Return the schedule ready to run."""
        return ReferenceExecutable(schedule, solvers)
