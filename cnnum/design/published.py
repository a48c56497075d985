"""The margin of given weights on a local rule, counted as the design counts it."""

import numpy as np

from cnnum.arrays import Floats
from cnnum.design.local_rules import Table
from cnnum.templating.template import Template


def margins(template: Template, table: Table) -> tuple[float, float]:
    """Return the least signed drive over all configurations, and the same over Σ |weights|.

    The drive is that of a cell at its start, Σ A y + Σ B u + z − x. Weights that act together count
    as their sum: a control and a feedback of the same cell that starts from the input. Of the own
    feedback 1 counts as nothing, since it only holds the state. A negative margin is a wrong
    answer.

    Parameters
    ----------
    template : Template
        Of one layer and 3×3 cells.
    table : Table
    """
    feedback, control = _nine(template.A), _nine(template.B) if template.inputs else np.zeros(9)
    feedback[4] -= 1.0
    weights, bias = dict[str, Floats](), float(template.z[0])
    weights["y"], weights["u"], weights["before"] = feedback, control, np.zeros(9)
    sources = {seen.source for seen in table.seen}
    if "y" not in sources:
        if "before" in sources:
            weights["before"][4] = feedback[4]
        elif template.initial == "input":
            weights["u"] = control + feedback
        else:
            bias += float(template.initial) * float(feedback.sum())
    columns = [weights[s.source][3 * (s.down + 1) + s.east + 1] for s in table.seen]
    sums = table.colours * (table.signs @ np.array(columns) + bias)
    # a cell that the rule does not read has either colour, and takes its weight off the margin
    read = {(s.source, 3 * (s.down + 1) + s.east + 1) for s in table.seen}
    used = ("y", "u") if "y" in sources else ("u", "before")
    idle = sum(
        abs(float(w))
        for source in used
        for place, w in enumerate(weights[source])
        if (source, place) not in read
    )
    margin = float(sums.min()) - idle
    size = float(np.abs(columns).sum()) + idle + abs(bias)
    return margin, margin / size


def _nine(kernels: Floats) -> Floats:
    found = np.zeros((3, 3))
    kernel = kernels[0, 0]
    if kernel.shape[0] == 1:
        found[1, 1] = kernel[0, 0]
    else:
        found[:] = kernel
    return found.ravel()
