"""A schedule in fixed-point arithmetic: measured, lowered and run frame by frame."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Floats
from cnnum.embedded.emulator import Numbers, cleared
from cnnum.embedded.formats import Precision
from cnnum.embedded.making import Made, make_with
from cnnum.embedded.measuring import measured
from cnnum.embedded.program import UNFINISHED, IntegerProgram
from cnnum.engines.backend import Runner
from cnnum.engines.host import OnHost
from cnnum.engines.notices import refuse_unfinished
from cnnum.errors import MethodError, ProgramError
from cnnum.graph.nodes import Pick
from cnnum.graph.schedule import Schedule
from cnnum.integrators.estimate import LOST
from cnnum.integrators.solver import Solvers


@dataclass(slots=True, eq=False)
class WholeMemory:
    """Memory of streams between frames; None before the first frame."""

    state: dict[str, Numbers] | None = None


@dataclass(slots=True, eq=False)
class FixedPointExecutable(OnHost):
    """Runs a schedule in fixed-point arithmetic.

    Attributes
    ----------
    schedule : Schedule
    solvers : mapping of int to Solver
    kind : Precision
    runner : callable
    launches : int
        A frame.
    like : (frames, batch, rows, cols, channels) float or None
    """

    schedule: Schedule
    solvers: Solvers
    kind: Precision
    runner: Callable[[IntegerProgram], Runner]
    launches: int
    like: Floats | None
    _made: Made | None = None
    _runners: dict[str, Runner] = field(default_factory=dict[str, Runner])
    _ran: IntegerProgram | None = None

    def __post_init__(self) -> None:
        if self.like is not None:
            self._made = self._measured(self.like)

    @property
    def source(self) -> str:
        """The C source of one frame."""
        from cnnum.embedded.c.text import c_text

        if self._made is None:
            return "The text follows the ranges of the first batch."
        return "\n".join([*c_text(self._made.program).body, ""])

    @property
    def scratch_bytes(self) -> int:
        """Bytes of working memory per frame; 0 while formats are unknown."""
        return 0 if self._made is None else self._made.memory_bytes

    def new_memory(self, batch: int) -> object:
        """Return cleared memories."""
        made = self._made
        return WholeMemory(None if made is None else cleared(made.program, batch))

    def held(self, memory: object, batch: int) -> tuple[NDArray[np.floating], ...]:
        """Return the integer contents of the memories."""
        assert isinstance(memory, WholeMemory)
        return tuple(state.astype(np.float64) for state in (memory.state or {}).values())

    def restore(self, memory: object, numbers: Sequence[NDArray[np.floating]], batch: int) -> None:
        """Restore the memories from a copy of these values."""
        assert isinstance(memory, WholeMemory)
        names = memory.state or {}
        memory.state = {
            name: values.astype(np.int64) for name, values in zip(names, numbers, strict=True)
        }

    def run(
        self, frames: NDArray[np.floating], memory: object, *, first: bool
    ) -> dict[str, Floats]:
        """Run a batch.

        Raises
        ------
        MethodError
            If a loop reaches its iteration limit in a frame and the program does not check for it.
            The memories are then unchanged.
        ProgramError
            If frames form a sequence and no streams were given to measure ranges on.
        """
        assert isinstance(memory, WholeMemory)
        made = self._made
        if made is None:
            if self.schedule.memories and not first:
                raise ProgramError(
                    "A stream in whole numbers needs the ranges of its values: pass typical "
                    "frames to engine.compile(..., like=frames)."
                )
            made = self._measured(np.asarray(frames, dtype=np.float64)[np.newaxis])
        if memory.state is None or self._made is None:
            memory.state = cleared(made.program, len(frames))
        inputs = made.inputs(np.asarray(frames, dtype=np.float64))
        runner = self._runner(made.program)
        before = memory.state
        if made.program.may_not_finish:  # the frame may be none: it is worked in a copy
            memory.state = {name: numbers.copy() for name, numbers in before.items()}
        answer = runner.run(inputs, memory.state, first=first, batch=len(frames))
        if made.program.may_not_finish:
            try:
                refuse_unfinished(np.broadcast_to(answer[UNFINISHED][:, 0], len(frames)))
            except MethodError:
                memory.state = before
                raise
        result = made.outputs(answer)
        lost = {name: np.full(len(frames), LOST) for name in self._errors()}
        return {name: result.get(name, lost.get(name)) for name in self.schedule.outputs}  # type: ignore[misc]

    def _errors(self) -> list[str]:
        """Return the outputs that are error estimates, which are not tracked here."""
        return [name for name, node in self.schedule.outputs.items() if _is_error(node.operation)]

    def _measured(self, streams: Floats) -> Made:
        read, errors = self.schedule.channels_read, self._errors()
        if streams.shape[-1] != len(read):
            at = [self.schedule.channels.index(name) for name in read]
            streams = streams[..., at]
        outputs = {n: node for n, node in self.schedule.outputs.items() if n not in errors}
        nodes = tuple(n for n in self.schedule.nodes if not _is_error(n.operation))
        schedule = replace(self.schedule, channels=read, outputs=outputs, nodes=nodes)
        seen = measured(schedule, self.solvers, streams)
        return make_with("plan", schedule, self.solvers, self.kind, seen)

    def _runner(self, program: IntegerProgram) -> Runner:
        """Return the runner of a program, reusing the last one if possible."""
        if self._ran is not program:
            # the ranges of another batch may give the same source, which is slow to compare
            key = str((program.body, list(program.arrays)))
            if key not in self._runners:
                self._runners.clear()
                self._runners[key] = self.runner(program)
            self._ran = program
        (runner,) = self._runners.values()
        return runner


def _is_error(operation: object) -> bool:
    return isinstance(operation, Pick) and operation.what == "error"
