"""A schedule, walked operation by operation over a whole batch."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cnnum.engines.failures import refuse_unfinished
from cnnum.engines.host import HostExecutable, HostMemory
from cnnum.engines.numba.evaluation import Evaluation
from cnnum.engines.numba.records import Real, Reals
from cnnum.engines.numba.transients import TransientRunner
from cnnum.engines.opencl.lowering.storage import PRIVATE_CELLS
from cnnum.graph.nodes import Apply, Loop, Product, Reduce, Transient
from cnnum.graph.schedule import Schedule
from cnnum.integrators.solver import Exact, Solvers


def why_walked(schedule: Schedule) -> str:
    """Return why a schedule is walked operation by operation; empty where it is printed."""
    if schedule.cells > PRIVATE_CELLS:
        return f"an array of more than {PRIVATE_CELLS} cells is shared by all cores"
    done = (Apply, Reduce, Product, Loop, Transient)
    if sum(isinstance(node.operation, done) for node in schedule.nodes) <= 1:
        return "a template alone needs no compiler of its own"
    return ""


@dataclass(frozen=True, slots=True, eq=False)
class NumbaExecutable(HostExecutable):
    """Runs local arithmetic in NumPy and transients in compiled functions.

    Attributes
    ----------
    runners : mapping of int to TransientRunner
        By the index of their node.
    dead : mapping of int to indices
        By node, the values that nothing reads after it.
    """

    runners: Mapping[int, TransientRunner]
    dead: Mapping[int, Sequence[int]]

    @classmethod
    def of(cls, schedule: Schedule, solvers: Solvers, dtype: Real) -> "NumbaExecutable":
        """Return the executable of a schedule."""
        runners = {
            node.index: TransientRunner.of(
                node.operation, schedule.shape, solvers[node.index], dtype
            )
            for node in schedule.transients
            if isinstance(node.operation, Transient)
        }
        return cls(schedule, dtype, runners, _dead_after(schedule))

    @property
    def strategies(self) -> Mapping[int, str]:
        """How transients run, in words, by their nodes."""
        how = f"a walk over the operations ({why_walked(self.schedule)})"
        return dict.fromkeys(self.runners, how)

    def evaluate(self, values: dict[int, Reals], batch: int) -> None:
        """Fill in the values of all nodes, and forget those that nothing reads any more."""
        evaluation = Evaluation(batch, self.dtype, self.runners)
        # overflow is infinite on every engine; the plan refuses it where it comes out
        with np.errstate(all="ignore"):
            evaluation.run(self.schedule.nodes, values, self.dead)
        refuse_unfinished(evaluation.unfinished)

    def look(
        self,
        frames: Reals,
        moments: Sequence[float],
        ends: Sequence[Exact] = (),
        cuts: int = 1,
    ) -> dict[str, Reals]:
        """Return the findings at times of a run, whose only transient this is.

        Parameters
        ----------
        frames : (batch, rows, cols, channels) float
        moments : sequence of float
            Rising, none after the end.
        ends : sequence of Exact
            The schemes of runs to these times, where an end is known without steps.
        cuts : int
            Parts in which a piece of a step of fixed length is taken up to a look.

        Returns
        -------
        dict
            "seen" (times, batch, layers, rows, cols), and "marks" (times, batch, 3): steps,
            settled, error.
        """
        memory = self.new_memory(len(frames))
        assert isinstance(memory, HostMemory)
        values = self._given(frames, memory, first=True)
        evaluation = Evaluation(len(frames), self.dtype, self.runners, moments, ends, cuts)
        with np.errstate(all="ignore"):
            evaluation.run(self.schedule.nodes, values, self.dead)
        refuse_unfinished(evaluation.unfinished)
        return evaluation.seen


def _dead_after(schedule: Schedule) -> dict[int, list[int]]:
    last = {a.index: node.index for node in schedule.nodes for a in node.arguments}
    kept = {node.index for node in schedule.outputs.values()}
    kept |= {memory.store.index for memory in schedule.memories.values()}
    dead: dict[int, list[int]] = {}
    for value, user in last.items():
        if value not in kept:
            dead.setdefault(user, []).append(value)
    return dead
