"""Programs in stages: between them, templates of which only the end is wanted, and known.

A program is one kernel. Where it runs a template on a large array and reads nothing but the output,
that output may be known without the transient (`wavefront`, `decided`). The program is then cut
there: a first part computes what the template reads, the host finds the output, and a next part
goes on from it. Frames for which the output is not proven run the whole program.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats, Shape, number_type
from cnnum.embedded.formats import is_integer
from cnnum.engines.backend import Executable, OneFrame
from cnnum.engines.fallback import FallbackExecutable
from cnnum.errors import MethodError
from cnnum.graph.nodes import Input, Node, Pick, RunSpec, Transient, picks_of
from cnnum.graph.schedule import Schedule
from cnnum.integrators.affine import fuse
from cnnum.integrators.closed_forms import Separate
from cnnum.integrators.schemes import DECISION, WAVEFRONT
from cnnum.plan import Plan
from cnnum.runs.decided import is_decided, output_of
from cnnum.runs.wavefront import end_of, monotone
from cnnum.safety.values import host_bytes, refuse_beyond

LEAST_CELLS = 257
"""Smaller arrays are one launch, and a second one would cost more than it saves."""

LEAST_APART = 128 * 128
"""Cells from which the host takes the closed form in half a kernel's time; at 64² a third more."""

Maps = Mapping[str, NDArray[np.floating]]

Build = Callable[[Schedule], Executable]


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """How the output of a template is found without its transient.

    Attributes
    ----------
    operation : Transient
    method : str
    output : callable
        Takes (rows, cols) maps by role; returns the output, or None where it is not proven.
    """

    operation: Transient
    method: str
    output: Callable[[Maps], Floats | None]

    @classmethod
    def of(
        cls, operation: Transient, spec: RunSpec, shape: Shape, *, closed: bool
    ) -> "Answer | None":
        """Return the answer for a template, or None if there is none.

        Parameters
        ----------
        operation : Transient
        spec : RunSpec
        shape : (rows, cols)
        closed : bool
            Whether kernels compute the closed form of cells that see no other cell, with their
            states, in less time than it takes to leave them.
        """
        template, has_state = operation.template, operation.has_state
        if spec.method != "auto" or spec.dt is not None or spec.force or spec.estimate:
            return None
        if spec.settle_limit < RunSpec().settle_limit:  # it may end on the way
            return None
        if operation.has_previous or operation.weight_maps or template.radius > min(shape):
            return None
        if monotone(template) is not None:
            return cls(operation, WAVEFRONT, partial(end_of, template, spec, shape))
        duration = template.duration if spec.duration is None else spec.duration
        time = np.inf if duration == "settle" else float(duration)
        if operation.has_bias or operation.has_mask or time <= 0.0:
            return None
        if closed and not template.nonlinear:
            return None
        if not is_decided(template, time, has_input=template.inputs > 0, has_state=has_state):
            return None
        return cls(operation, DECISION, partial(output_of, template, time))


def in_stages(plan: Plan, overrides: Mapping[str, object]) -> Plan:
    """Return a plan cut at the templates that need no way; the plan itself if there is none.

    Parameters
    ----------
    plan : Plan
    overrides : mapping of str to any
        Fields that override those of every transient's `RunSpec`.
    """
    backend, solvers, record = plan.backend, plan.solvers, plan.backend.record
    # an engine that solves finely is what others are held against
    in_steps = record.takes_steps and not is_integer(backend.precision)
    if not in_steps or isinstance(plan.executable, FallbackExecutable):
        return plan
    few = plan.schedule.cells < LEAST_APART or not backend.in_host_memory
    summed = {
        index
        for index, solver in solvers.items()
        if record.devices and isinstance(solver.scheme, Separate) and solver.scheme.ends
    }
    answers = answers_in(plan.schedule, overrides, summed, closed=record.devices and few)
    if not answers:
        return plan

    def build(part: Schedule) -> Executable:
        own = {node.index: solvers[node.index] for node in part.transients}
        return backend.build(fuse(part, own) if record.fuses else part, own)

    dtype = np.dtype(number_type(backend.precision))
    stages = StagedExecutable(plan.schedule, answers, build, plan.executable, dtype)
    return replace(plan, executable=stages)


def answers_in(
    schedule: Schedule, overrides: Mapping[str, object], summed: Collection[int], *, closed: bool
) -> dict[int, Answer]:
    """Return the answers for templates of which a program reads the output alone, by their node.

    There is none for a program with memories, or in the body of a loop, which a kernel keeps, nor
    for the nodes that are `summed`: a kernel takes half the host's time for outputs by one sum.
    A walk over the operations takes twice as long as the host.
    """
    if schedule.memories or schedule.cells < LEAST_CELLS:
        return {}
    result = dict[int, Answer]()
    for node in schedule.nodes:
        operation = node.operation
        if not isinstance(operation, Transient) or node.index in summed:
            continue
        spec = replace(operation.spec, **overrides)  # type: ignore[arg-type]
        answer = Answer.of(operation, spec, schedule.shape, closed=closed)
        picks = picks_of(node, schedule.nodes)
        if answer is not None and all(pick.what == "output" for _, pick in picks):
            result[node.index] = answer
    return result


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """A part of a program, and the templates whose outputs are found after it.

    Attributes
    ----------
    executable : Executable or None
        None if nothing has to be computed.
    channels : tuple of str
        Names of the values that it reads.
    answers : mapping of str to (Answer, tuple of str)
        By the name of the output; with the names of the template's arguments.
    """

    executable: Executable | None
    channels: tuple[str, ...]
    answers: Mapping[str, tuple[Answer, tuple[str, ...]]]


def _name(node: Node) -> str:
    return f"value {node.index}"


def _of_frame(channel: str) -> str:
    return f"channel {channel}"


def stages_of(
    schedule: Schedule, answers: Mapping[int, Answer], build: Build
) -> tuple[tuple[Stage, ...], dict[str, str]]:
    """Return the parts of a program, and the names of its outputs among what they compute."""
    levels = dict[int, int]()
    for node in schedule.nodes:
        level = max((levels[argument.index] for argument in node.arguments), default=0)
        after = isinstance(node.operation, Pick) and node.arguments[0].index in answers
        levels[node.index] = level + after
    known = {
        node.index: _of_frame(node.operation.channel)
        for node in schedule.nodes
        if isinstance(node.operation, Input)
    }
    result, last = list[Stage](), max(levels.values())
    for level in range(last + 1):
        due = [n for n in schedule.nodes if n.index in answers and levels[n.index] == level]
        read = schedule.outputs.values() if level == last else [a for n in due for a in n.arguments]
        wanted = {_name(node): node for node in read if node.index not in known}
        nodes = _between(known, wanted.values())
        # a loop that the program asks whether it ended may reach its limit in every part
        ran = {node.index for node in nodes}
        wanted |= {_name(n): n for n in schedule.nodes if _asks_for_end(n, ran)}
        nodes = _between(known, wanted.values())
        if level < last:  # what a template or a loop has computed is not computed again
            wanted |= {_name(node): node for node in nodes if _is_plain_pick(node)}
        part = _part(schedule, nodes, wanted, known)
        own = {
            _name(node): (
                answers[node.index],
                tuple(known.get(a.index, _name(a)) for a in node.arguments),
            )
            for node in due
        }
        result.append(Stage(build(part) if wanted else None, part.channels_read, own))
        known |= {node.index: name for name, node in wanted.items() if _is_plain_pick(node)}
        known |= {p.index: _name(n) for n in due for p, _ in picks_of(n, schedule.nodes)}
    names = {name: known.get(n.index, _name(n)) for name, n in schedule.outputs.items()}
    return tuple(result), names


def _asks_for_end(node: Node, loops: set[int]) -> bool:
    """Return whether a node is the flag of one of these loops that it has ended."""
    pick = node.operation
    return isinstance(pick, Pick) and pick.what == "finished" and node.arguments[0].index in loops


def _is_plain_pick(node: Node) -> bool:
    """Return whether a node is a map that a template or a loop gives, and can be a channel."""
    return isinstance(node.operation, Pick) and not (node.scalar or node.logic or node.maps > 1)


def _between(known: Mapping[int, str], wanted: Iterable[Node]) -> list[Node]:
    """Return the nodes from those that are known to those that are wanted, in their order."""
    nodes, stack = dict[int, Node](), list(wanted)
    while stack:
        node = stack.pop()
        if node.index not in nodes:
            nodes[node.index] = node
            stack += () if node.index in known else node.arguments
    return [nodes[index] for index in sorted(nodes)]


def _part(
    schedule: Schedule,
    nodes: Sequence[Node],
    wanted: Mapping[str, Node],
    known: Mapping[int, str],
) -> Schedule:
    """Return the schedule of some nodes, which reads the known ones as channels."""
    new = dict[int, Node]()
    for node in nodes:
        if node.index in known:
            new[node.index] = replace(node, operation=Input(known[node.index]), arguments=())
        else:
            new[node.index] = replace(node, arguments=tuple(new[a.index] for a in node.arguments))
    channels = tuple(dict.fromkeys(known[n.index] for n in nodes if n.index in known))
    return replace(
        schedule,
        nodes=tuple(new.values()),
        outputs={name: new[node.index] for name, node in wanted.items()},
        channels=channels,
        channels_read=channels,
        left_out=(),
    )


@dataclass(slots=True, eq=False)
class StagedExecutable:
    """Runs a program in stages.

    Attributes
    ----------
    schedule : Schedule
    answers : mapping of int to Answer
    build : callable
        Builds a part of the program.
    whole : Executable
        Runs all of the program.
    dtype : dtype
        Type of the numbers of a frame.
    """

    schedule: Schedule
    answers: Mapping[int, Answer]
    build: Build
    whole: Executable
    dtype: np.dtype[np.floating]
    _stages: tuple[Stage, ...] = field(init=False)
    _names: dict[str, str] = field(init=False)
    _warm: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        self._stages, self._names = stages_of(self.schedule, self.answers, self.build)

    @property
    def _parts(self) -> list[Executable]:
        return [s.executable for s in self._stages if s.executable is not None]

    @property
    def source(self) -> str:
        """The exact source of the kernels of all stages."""
        return "\n".join(part.source for part in self._parts)

    @property
    def launches(self) -> int:
        """Kernel launches per batch."""
        return sum(part.launches for part in self._parts)

    @property
    def private_bytes(self) -> int:
        """Bytes of private memory of a work item that runs one frame."""
        return max((part.private_bytes for part in self._parts), default=0)

    @property
    def local_bytes(self) -> int:
        """Bytes of local memory per work group."""
        return max((part.local_bytes for part in self._parts), default=0)

    @property
    def scratch_bytes(self) -> int:
        """Bytes of global working memory per frame."""
        return max((part.scratch_bytes for part in self._parts), default=0)

    @property
    def strategies(self) -> Mapping[int, str]:
        """Description of how each transient runs, by node."""
        result = dict[int, str]()
        for part in self._parts:
            result |= part.strategies
        for index, answer in self.answers.items():
            result[index] = (
                f"its output alone, found by {answer.method} on the host in frames whose end is "
                "proven, and as planned in others"
            )
        return result

    def new_memory(self, batch: int) -> object:
        """Return nothing, as there are no memories."""
        return None

    def held(self, memory: object, batch: int) -> tuple[NDArray[np.floating], ...]:
        """Return nothing, as there are no memories."""
        return ()

    def restore(self, memory: object, numbers: Sequence[NDArray[np.floating]], batch: int) -> None:
        """Restore nothing, as there are no memories."""

    def one(self, memory: object) -> OneFrame | None:
        """Return None, as there is no fast path for single frames."""
        return None

    def run_large(
        self, maps: Sequence[NDArray[np.floating]], lead: tuple[int, ...]
    ) -> tuple[dict[str, Floats], bool] | None:
        """Return None, as frames are checked before."""
        return None

    def run(
        self, frames: NDArray[np.floating], memory: object, *, first: bool
    ) -> dict[str, Floats]:
        """Run a batch; frames of which an output is not proven run the whole program."""
        batch, known = len(frames), np.ones(len(frames), bool)
        room = host_bytes()
        if room is not None:  # an argument and an output of the first template
            needed = 2 * 8 * batch * self.schedule.cells
            refuse_beyond(f"A batch of {batch} frame(s)", needed, room, "this machine")
        frames = frames.astype(self.dtype, copy=False)
        if not (self._warm or frames.any()):  # an empty frame comes to warm up
            self._warm_up()
        read = [_of_frame(channel) for channel in self.schedule.channels_read]
        values = {name: frames[..., at] for at, name in enumerate(read)}
        own = dict[str, Floats]()
        for stage in self._stages:
            if stage.executable is not None:
                given = np.zeros((batch, len(stage.channels), *self.schedule.shape), self.dtype)
                for at, name in enumerate(stage.channels):
                    given[:, at] = values[name]
                memory = stage.executable.new_memory(batch)
                values |= stage.executable.run(np.moveaxis(given, 1, -1), memory, first=first)
            for name, (answer, arguments) in stage.answers.items():
                maps = [self._maps(values[argument]) for argument in arguments]
                outputs = [_output(answer, [m[k] for m in maps]) for k in range(batch)]
                known &= [output is not None for output in outputs]
                if not known.all():
                    return self._partly(frames, known, first=first)
                proven = [output for output in outputs if output is not None]
                # to copy a large array takes longer than to find it
                own[name] = proven[0][np.newaxis] if batch == 1 else np.stack(proven)
                values[name] = own[name]
        result = dict[str, Floats]()
        for name, value in self._names.items():
            array = own.pop(value, None)  # once: each output is an array of its own
            result[name] = (
                np.array(values[value], np.float64, order="C") if array is None else array
            )
        return result

    def _warm_up(self) -> None:
        """Run all parts and the whole program on an empty frame, so that all kernels are built."""
        self._warm = True
        read = [(stage.executable, len(stage.channels)) for stage in self._stages]
        for executable, count in (*read, (self.whole, len(self.schedule.channels_read))):
            if executable is not None:
                given = np.zeros((1, *self.schedule.shape, count), self.dtype)
                with suppress(MethodError):  # loops of an empty frame may not end
                    executable.run(given, executable.new_memory(1), first=True)

    def _maps(self, values: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return an argument as maps; a number stands for the same in every cell."""
        maps = values if values.ndim == 3 else values[:, np.newaxis, np.newaxis]
        shape = (len(values), *self.schedule.shape)
        return np.ascontiguousarray(np.broadcast_to(maps, shape), self.dtype)

    def _partly(
        self, frames: NDArray[np.floating], known: NDArray[np.bool_], *, first: bool
    ) -> dict[str, Floats]:
        """Run frames with a proven output in stages, and the whole program for the others."""
        others = int(np.count_nonzero(~known))
        ran = self.whole.run(frames[~known], self.whole.new_memory(others), first=first)
        if others == len(frames):
            return ran
        staged = self.run(frames[known], None, first=first)
        result = dict[str, Floats]()
        for name, values in ran.items():
            result[name] = np.zeros((len(frames), *values.shape[1:]))
            result[name][~known], result[name][known] = values, staged[name]
        return result


def _output(answer: Answer, maps: Sequence[NDArray[np.floating]]) -> Floats | None:
    """Return the output of a template for its arguments."""
    given = answer.operation.by_role(maps)
    return answer.output({role: values[0] for role, values in given.items() if values})
