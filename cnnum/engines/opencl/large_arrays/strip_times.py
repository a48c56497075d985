"""When the levels of large arrays' steps are, and their reads of earlier ones.

Couplings may vary in time. Delayed ones read the outputs with which the step a delay ago began:
a ring of arrays keeps those of all steps since, and delayed inputs change when the delay is over.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.lane_rows import size_of
from cnnum.engines.opencl.large_arrays.strip_boundary import LATER, OUTPUTS, by_turns
from cnnum.engines.opencl.large_arrays.strip_couplings import NEXT, PART, PAST
from cnnum.engines.opencl.large_arrays.strip_rows import Rows
from cnnum.engines.opencl.transients.builder import TransientBuilder
from cnnum.engines.opencl.transients.nonlinear_couplings import gains
from cnnum.integrators.schemes import FixedSteps
from cnnum.templating.reads import delays_outputs, lag

RING = "strip_ring"
"""The outputs with which the last steps began."""


def gain_lines(text: TransientBuilder, since: str) -> list[str]:
    """Return the text that finds the varying factors, at a time since the start."""
    return text.tables.printer.lines(gains(text, ir.Constant(since)))


@dataclass(frozen=True, slots=True)
class Moments:
    """When levels of fixed steps are.

    Attributes
    ----------
    text : TransientBuilder
    scheme : FixedSteps
    stages : int
        Of a step: as many levels.
    before : str
        The steps before those that a launch counts, as an expression.
    """

    text: TransientBuilder
    scheme: FixedSteps
    stages: int
    before: str = "0"

    @property
    def lag(self) -> int:
        """The delay in steps; 0 where there is none."""
        return lag(self.text.template, self.scheme.step)

    @property
    def keeps(self) -> bool:
        """Whether outputs of earlier steps are kept."""
        return delays_outputs(self.text.template)

    @property
    def share(self) -> float:
        """The last step's length, in steps."""
        return self.scheme.last / self.scheme.step

    @property
    def uneven(self) -> bool:
        """Whether the last step is shorter."""
        return not math.isclose(self.share, 1.0, rel_tol=1e-9)

    def head(self, stage: int) -> list[str]:
        """Return the statements on a stage's moment, before it takes its rows."""
        text, steps = self.text, f"const int steps = number / {self.stages} + {self.before};"
        lines, last = list[str](), ""
        if self.uneven:
            last = f"steps == {self.scheme.count - 1} ? {text.literal(self.share)} : ONE"
            lines.append(f"const vec {PART.text} = (vec)({last});")
        if text.template.gains:
            at, step = text.literal(self._place(stage)), text.literal(self.scheme.step)
            at += f" * ({last})" if self.uneven else ""
            lines += gain_lines(text, f"{step} * (R(steps) + {at})")
        if self.keeps:
            # the outputs of a step's end are those that the next begins with
            late = int(self._place(stage) == 1.0 and not self.uneven)
            lines.append(self._outputs(PAST.text, late))
            if self.between(stage):
                lines.append(self._outputs(NEXT.text, 1))
        return [steps, *lines] if lines else []

    def between(self, stage: int) -> bool:
        """Return whether the delayed time lies between the outputs of two steps."""
        return self.keeps and self.uneven and self._place(stage) != 0.0

    def _place(self, stage: int) -> float:
        """Return when a stage is, in steps since its step's begin."""
        return float(sum(self.scheme.tableau.a[stage]))

    def _outputs(self, name: str, late: int) -> str:
        level = f"max(steps + {late} - {self.lag}, 0) * {self.stages}"
        return f"__global const scalar *const {name} = outputs_of(x, {level});"

    def keep_outputs(self, rows: Rows, again: int) -> str:
        """Declare the ring that keeps outputs of earlier steps, and return the place of a `level`.

        Of these steps, `again` may be taken again.
        """
        turns = by_turns(rows.offsets, OUTPUTS)
        if not self.keeps:
            return turns
        # a level writes while one before it, a few rows ahead, reads outputs a delay old
        slots, size = self.lag + 2 + again, size_of(self.text, rows.layout)
        rows.declare(RING, slots * size)
        ring = f"x + {rows.at(RING)} + (size_t)(level / {self.stages} % {slots}) * {size}"
        return ring if self.stages == 1 else f"level % {self.stages} ? {turns} : {ring}"

    @property
    def ahead(self) -> str:
        """The expression of the levels before those that a launch counts."""
        return f"{self.before} * {self.stages}"

    def driven(self, offsets: Mapping[str, int | str]) -> str:
        """Return the expression of the cells' drive at the level `number`."""
        if not self.text.has_history:
            return "w"
        return f"number + {self.ahead} < {self.lag * self.stages} ? w : x + {offsets[LATER]}"

    def later(self, offsets: Mapping[str, int | str], scale: str) -> list[str]:
        """Return the text that sets a row's drive of later, which comes with a scale."""
        if not self.text.has_history:
            return []
        later = f"mine + {self.text.arena.places['later']} + cell"
        return [f"to_lanes(x + {offsets[LATER]} + p, {later}, {scale});"]
