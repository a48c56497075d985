"""Steps one after the other, and whether the last one moved a cell: where it did not, they end."""

from collections.abc import Sequence
from dataclasses import dataclass

from cnnum import kernels as ir
from cnnum.embedded.arithmetic.fixed import Quantity, constant
from cnnum.embedded.arithmetic.primitives import LOGIC
from cnnum.embedded.arithmetic.whole import call, opposite
from cnnum.embedded.lowering.builder import FINE
from cnnum.embedded.lowering.transient_work import TransientWork
from cnnum.integrators.schemes import FixedSteps

STILL = 1e-6
"""A step of reals that moves no cell by more is the last: ten roundings of float32 at 1."""


@dataclass(frozen=True, slots=True)
class Watch:
    """Variables that say whether the last step moved a cell, and how many steps there were.

    Attributes
    ----------
    moved, steps, running : Name
    needed : bool
        Whether anything asks for them.
    """

    moved: ir.Name
    steps: ir.Name
    running: ir.Name
    needed: bool

    @classmethod
    def of(cls, work: TransientWork, scheme: FixedSteps) -> "Watch":
        """Return those of a transient."""
        at, needed = work.index, scheme.settle or "settled" in work.figures
        steps = ir.Name(f"steps{at}", (0, scheme.count))
        return cls(ir.Name(f"moved{at}", LOGIC), steps, ir.Name(f"running{at}", LOGIC), needed)

    def noted(self, new: ir.Expression, old: ir.Expression) -> ir.Accumulate:
        """Return the statement that takes in whether a cell moves."""
        if new.bounds is not None:
            return ir.Accumulate(self.moved, "maximum", opposite(call("equal", new, old)))
        far = call("absolute", call("subtract", new, old))
        return ir.Accumulate(self.moved, "maximum", call("greater", far, ir.Number(STILL)))

    def repeat(
        self, work: TransientWork, scheme: FixedSteps, steps: Sequence[ir.Statement]
    ) -> None:
        """Write the steps and the figures of the run."""
        to, count = work.to, constant(float(scheme.count))
        if self.needed:
            to.body.append(ir.declare(self.moved, 0))
            steps = (ir.Assign(self.moved, ir.Integer(0)), *steps)
        if scheme.settle:
            count = self._until_still(work, scheme, steps)
            time = to.arithmetic.multiply(count, constant(scheme.step), FINE)
        else:
            # a run of no time is watched for one step, which is not stored
            count_of = scheme.count or int(self.needed)
            to.body.append(ir.Counted(ir.ROUND, 0, count_of, None, tuple(steps)))
            time = constant(scheme.step * scheme.count)
        known = {"steps": count, "time": time, "settled": Quantity(opposite(self.moved))}
        for name in work.figures:
            one = known[name]
            if one.exact is None:
                one = to.let(f"{name}_{work.index}", one)
            work.figures[name] = one

    def _until_still(
        self, work: TransientWork, scheme: FixedSteps, steps: Sequence[ir.Statement]
    ) -> Quantity:
        to, more = work.to, call("add", self.steps, ir.Integer(1))
        counted = ir.Assign(self.steps, call("minimum", more, ir.Integer(scheme.count)))
        body = (*steps, counted, ir.Assign(self.running, self.moved))
        to.body += [
            ir.declare(self.steps, 0),
            ir.declare(self.running, 1),
            ir.Counted(ir.ROUND, 0, scheme.count, self.running, body),
        ]
        return Quantity(self.steps if to.integer else call("to_real", self.steps))
