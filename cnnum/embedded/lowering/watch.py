"""Steps one after the other, and whether the last one moved a cell: where it did not, they end."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cnnum.embedded.arithmetic.fixed import Quantity, constant
from cnnum.embedded.ir.expressions import Expression, Name, Real, Whole, call
from cnnum.embedded.ir.primitives import LOGIC
from cnnum.embedded.ir.statements import Fold, Let, Repeat, Rounds, Set, Statement
from cnnum.embedded.lowering.builder import FINE
from cnnum.integrators.schemes import FixedSteps

if TYPE_CHECKING:
    from cnnum.embedded.lowering.transients import TransientWork

STILL = 1e-6
"""A step of reals that moves no cell by more is the last: ten roundings of float32 at 1."""


@dataclass(frozen=True, slots=True)
class Watch:
    """Variables that say whether the last step moved a cell, and how many steps there were.

    Attributes
    ----------
    moved, steps, running : str
    needed : bool
        Whether anything asks for them.
    """

    moved: str
    steps: str
    running: str
    needed: bool

    @classmethod
    def of(cls, work: "TransientWork", scheme: FixedSteps) -> "Watch":
        """Return those of a transient."""
        at, needed = work.index, scheme.settle or "settled" in work.figures
        return cls(f"moved{at}", f"steps{at}", f"running{at}", needed)

    def noted(self, new: Expression, old: Expression) -> Fold:
        """Return the statement that takes in whether a cell moves."""
        if new.bounds is not None:
            return Fold(self.moved, "maximum", call("not", call("equal", new, old)))
        far = call("absolute", call("subtract", new, old))
        return Fold(self.moved, "maximum", call("greater", far, Real(STILL)))

    def repeat(self, work: "TransientWork", scheme: FixedSteps, steps: Sequence[Statement]) -> None:
        """Write the steps and the figures of the run."""
        to, count = work.to, constant(float(scheme.count))
        moves = Name(self.moved, LOGIC)
        if self.needed:
            to.body.append(Let(self.moved, Whole(0), LOGIC))
            steps = (Set(self.moved, Whole(0)), *steps)
        if scheme.settle:
            count = self._until_still(work, scheme, steps, moves)
            time = to.arithmetic.multiply(count, constant(scheme.step), FINE)
        else:
            to.body.append(Repeat(scheme.count, tuple(steps)))
            time = constant(scheme.step * scheme.count)
        known = {"steps": count, "time": time, "settled": Quantity(call("not", moves))}
        for name in work.figures:
            one = known[name]
            if one.exact is None:
                one = to.let(f"{name}_{work.index}", one)
            work.figures[name] = one

    def _until_still(
        self,
        work: "TransientWork",
        scheme: FixedSteps,
        steps: Sequence[Statement],
        moves: Expression,
    ) -> Quantity:
        many, to = (0, scheme.count), work.to
        more = call("add", Name(self.steps, many), Whole(1))
        counted = Set(self.steps, call("minimum", more, Whole(scheme.count)))
        body = (*steps, counted, Set(self.running, moves))
        to.body += [
            Let(self.steps, Whole(0), many),
            Let(self.running, Whole(1), LOGIC),
            Rounds(self.running, scheme.count, body),
        ]
        found = Name(self.steps, many)
        return Quantity(found if to.integer else call("to_real", found))
