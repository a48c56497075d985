"""The kernel text of adaptive steps of a single small frame: all stages are rounds of one loop.

Written out a stage after the other the text is several times as long, and takes as much longer to
build. Each round takes all rates so far, those that its stage does not weigh times 0: what is added
is the same, in the same order, but where a 0 stands between two products compilers may fuse others
of the multiply-adds, which round otherwise.
"""

import numpy as np

from cnnum.engines.opencl.rates import Instant, outputs, rates
from cnnum.engines.opencl.stepping import Attempt, advance, judge
from cnnum.engines.opencl.transients import TransientText
from cnnum.integrators.choice import AdaptiveSteps
from cnnum.integrators.tableau import Pair


def rolls(text: TransientText) -> bool:
    """Whether steps are to be built quickly: frames side by side are worth the longer text."""
    return text.arena.private and text.tables.lanes == 1


def rolled(text: TransientText, scheme: AdaptiveSteps) -> Attempt:
    """Return a step's statements as a loop over its stages."""
    stages, n = scheme.tableau.stages, text.layers * text.cells
    tableaux = tuple(scheme.of(layer) for layer in range(text.layers))
    text.array("later", (stages - 1) * n)
    text.array("xs", n)
    names = [f"*const k{stage} = later + {(stage - 1) * n}" for stage in range(1, stages)]
    text.lines.append(f"__private real {', '.join(names)};")
    with text.aside() as body:
        # what a refused step left may be infinite, and is multiplied by 0
        text.lines.append(f"for (int i = 0; i < {(stages - 1) * n}; ++i) {{ later[i] = ZERO; }}")
        text.lines.append("__attribute__((opencl_unroll_hint(1)))")
        text.lines.append(f"for (int stage = 1; stage < {stages}; ++stage) {{")
        _stage(text, tableaux)
        text.lines.append("}")
    return Attempt([], body, judge(text, tableaux), advance(text, stages - 1), [])


def _stage(text: TransientText, tableaux: tuple[Pair, ...]) -> None:
    """Append the round of one stage."""
    stages = tableaux[0].stages
    states: list[str] = []
    for layer, tableau in enumerate(tableaux):
        rows = np.zeros((stages, stages - 1))
        for stage, row in enumerate(tableau.a):
            rows[stage, : len(row)] = [float(weight) for weight in row]
        at = text.tables.data(rows)
        text.lines += [
            f"const real a{layer}_{m} = R(data[{at} + stage * {stages - 1} + {m}]);"
            for m in range(stages - 1)
        ]
        place = text.at(layer)
        terms = " + ".join(f"a{layer}_{m} * k{m}[{place}]" for m in range(stages - 1))
        states.append(f"x[{place}] + h * ({terms})")
    outputs(text, states, keep="xs")
    times = np.array([float(sum(row)) for row in tableaux[0].a])
    after = f"time + R(data[{text.tables.data(times)} + stage]) * h" if text.template.gains else ""
    then = [f"later[(stage - 1) * {text.layers * text.cells} + {{at}}] = rate;"]
    rates(text, "xs", then, Instant(after or "ZERO"))
