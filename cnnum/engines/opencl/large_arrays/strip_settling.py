"""Steps of a fixed length until nothing changes, by strips: a launch takes several of them.

Each step keeps, by strip and lane, whether a rate at its start is above the limit of rest. The
first step that saw no such rate may be amid a launch. Then the launch is taken again from its
begin, up to that step's end.
"""

from dataclasses import dataclass, replace

from cnnum import kernels as ir
from cnnum.engines.opencl.large_arrays.strip_boundary import first_states
from cnnum.engines.opencl.large_arrays.strip_error import (
    CELLS,
    magnitude,
    mark_cells,
    no_cells,
)
from cnnum.engines.opencl.large_arrays.strip_rows import ONES, At, Rows
from cnnum.engines.opencl.transients.state_equation import CHANGE
from cnnum.engines.opencl.transients.step_control import RUNNING, SETTLED, STEPS, STILL
from cnnum.integrators.schemes import FixedSteps
from cnnum.kernels.launch_plan import Strips
from cnnum.templating.reads import lag

BEFORE = "strip_before"
"""The array of the states with which a launch began."""

CHANGES, CONTROL = "strip_changes", "strip_control"
"""By step, strip and lane whether any rate is more than none, 1 or 0; how many levels a frame
takes, in how many strips, and how many steps came before."""


CONTROLS, SEEN = ir.Name(CONTROL), ir.Name(CHANGES)

TAKEN, LEVELS, AT, K, ANY = ir.names("taken levels at k changes")
"""Steps and levels of a launch; of its steps the first without a change, and whether any is."""


@dataclass(frozen=True, slots=True)
class Watch:
    """The watch over steps.

    Attributes
    ----------
    rows : Rows
        With places for the kept rates.
    stages : int
        Of a step.
    steps : int
        A launch takes; an even number of levels, so that outputs are where the next begins.
    """

    rows: Rows
    stages: int
    steps: int

    def _factor(self, layer: int) -> float:
        """Return the factor of a layer's d, so that it is the rate times the longest τ."""
        tau = self.rows.text.template.tau
        return float(tau.max() / tau[layer]) / self.rows.scales[layer]

    @property
    def each(self) -> int:
        """Numbers that are kept of a step."""
        return self.rows.size[1] * self.rows.layout.width

    @property
    def own(self) -> str:
        """Where a strip's vector of the step at hand is."""
        step = f"number / {self.stages} * {self.each}"
        return f"x + {self.rows.offsets[CHANGES]} + {step} + piece * {self.rows.layout.width}"

    @property
    def head(self) -> list[str]:
        """The statements before a step's first stage takes its rows."""
        return [f"vec change = *(__global const vec *)({self.own});"]

    @property
    def tail(self) -> list[str]:
        """And after."""
        return [f"*(__global vec *)({self.own}) = change;"]

    def sees(self, at: At, state: ir.Name) -> list[ir.Statement]:
        """Return statements that watch d of a row, and keep the state with which a launch began."""
        solver = self.rows.text.solver
        none = ir.Number(solver.atol) + ir.Number(solver.rtol) * magnitude(state)
        # which is false of NaN
        rests = ir.Number(self._factor(at.layer)) * magnitude(at.sum) <= none
        beyond = no_cells(self.rows)
        rests = rests if beyond is None else ir.Binary("|", rests, beyond)
        return [
            ir.Branch(ir.Name("number").equals(0), (self.rows.store(BEFORE, at, state),)),
            ir.Assign(CHANGE, ir.Choice(rests, CHANGE, ONES)),
        ]

    def clear(self) -> list[str]:
        """Return the settings of the first strip before all else."""
        size = self.steps * self.each
        lines = [f"for (int n = 0; piece == 0 && n < {size}; ++n) {{"]
        lines += [f"    x[{self.rows.offsets[CHANGES]} + n] = 0;", "}"]
        if CELLS in self.rows.offsets:
            lines += mark_cells(self.rows)
        return lines

    def begin(self) -> list[str]:
        """Return the text by which a strip forgets its findings of the launch before."""
        width = self.rows.layout.width
        own = f"{self.rows.offsets[CHANGES]} + n * {self.each} + piece * {width}"
        return [
            f"for (int n = 0; done == 0 && n < {self.steps}; ++n) {{",
            f"    *(__global vec *)(x + {own}) = (vec)(0);",
            "}",
            f"if (piece == 0) {{ x[{self.rows.offsets[CONTROL]} + 1] = pieces; }}",
        ]

    def again(self) -> tuple[str, ...]:
        """Return the text that takes a row back to where a launch began."""
        before = f"x + {self.rows.offsets[BEFORE]} + ROW(row) + layer * {self.rows.layout.span}"
        shown = f"show_row(outputs_of(x, ahead) + p, {before});"
        return (f"copy_lanes(x + p, {before});", shown, *first_states(self.rows.text))

    @property
    def before(self) -> str:
        """The expression of the steps before those of a launch."""
        return f"(int)x[{self.rows.offsets[CONTROL]} + 2]"

    @property
    def count(self) -> str:
        """Levels that a frame takes of at most `most` after those that are `done`."""
        return f"min(most, (int)x[{self.rows.offsets[CONTROL]}] - done)"

    def body(self, scheme: FixedSteps, strips: Strips) -> list[ir.Statement]:
        """Return the statements that launch the kernel until nothing changes."""
        late = lag(self.rows.text.template, scheme.step)
        about = f"at most {scheme.count} steps of {scheme.step:g}, until nothing changes any more"
        levels = replace(strips, begins=False, ends=False)
        count = ir.Cast("int", STEPS)
        rounds = (
            ir.declare(
                TAKEN, ir.call("min", self.steps, ir.Integer(scheme.count) - count), of="int"
            ),
            ir.declare(LEVELS, TAKEN * self.stages, of="int"),
            ir.Assign(CONTROLS[0], ir.real(LEVELS)),
            ir.Assign(CONTROLS[2], STEPS),
            ir.StripSteps(levels, LEVELS),
            *self._find_end(late),
            ir.add(STEPS, ir.real(AT)),
            ir.Assign(SETTLED, ir.ONE - ANY),
            ir.Assign(RUNNING, ir.pick(STEPS < ir.real(scheme.count), ANY, ir.ZERO)),
            ir.Assign(LEVELS, AT * self.stages),
            ir.Assign(CONTROLS[0], ir.real(LEVELS)),
            ir.Branch(AT < TAKEN, (ir.StripSteps(replace(levels, again=True), LEVELS),)),
        )
        begun = [(RUNNING, ir.ONE), (STEPS, ir.ZERO), (SETTLED, ir.ZERO)]
        begun += [(STILL, ir.ZERO)] if late else []
        return [
            ir.Note(f"// {scheme.name}, by strips: {about}"),
            ir.Declare("real", tuple(begun)),
            ir.Assign(CONTROLS[2], ir.ZERO),
            ir.StripSteps(replace(strips, count=0, ends=False)),
            ir.Counted(ir.ROUND, 0, -(-scheme.count // self.steps), RUNNING, rounds),
            ir.StripSteps(replace(strips, count=0, begins=False)),
        ]

    def _find_end(self, late: int) -> list[ir.Statement]:
        """Return the search for the first step at whose start nothing changes, the last one.

        With a delay nothing has to change for longer than that.
        """
        ends = ir.Cast("int", CONTROLS[1]) * self.rows.layout.width
        seen = SEEN[AT * self.each + K]
        strips = ir.Loop(K, ends, (ir.Accumulate(ANY, "fmax", seen),))
        again: tuple[ir.Statement, ...]
        again = (ir.Assign(ANY, ir.ZERO), strips, ir.Assign(AT, ir.Integer(1), "+="))
        if late:
            more = ir.pick(ANY.equals(ir.ZERO), STILL + ir.ONE, ir.ZERO)
            waits = ir.pick(ir.Number(late + 0.5) <= STILL, ir.ZERO, ir.ONE)
            again += (ir.Assign(STILL, more), ir.Assign(ANY, waits))
        return [
            ir.declare(AT, 0, of="int"),
            ir.declare(ANY, ir.ONE),
            ir.While((AT < TAKEN) & ANY.differs(ir.ZERO), again),
        ]


def watch(rows: Rows, stages: int) -> Watch:
    """Declare the watch over steps of a number of stages, and return it."""
    levels, strips = rows.size
    steps = max(1, levels // stages)
    if steps * stages % 2:
        steps += 1 if steps == 1 else -1
    rows.declare(CONTROL, 3)
    rows.declare(CHANGES, steps * strips * rows.layout.width)
    if rows.span > rows.layout.cols:
        rows.declare(CELLS, rows.span)
    return Watch(rows, stages, steps)
