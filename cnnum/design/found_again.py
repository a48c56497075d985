"""Templates of the library, designed anew from the local rules of their checks alone."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from cnnum.arrays import Floats
from cnnum.design.linear_program import Shape, Weights, as_template, duration_from_rails, separate
from cnnum.design.local_rules import Table, table_of
from cnnum.errors import CnnumError
from cnnum.templating.checks.records import ClosedForm
from cnnum.templating.checks.registry import form_of
from cnnum.templating.library import get_template, template_names
from cnnum.templating.template import Template


@dataclass(frozen=True, slots=True)
class Again:
    """A template of the library, and the one designed from its rule.

    Attributes
    ----------
    published : Template
    template : Template
        Its weights that decide sum to the same size as the published ones.
    weights : Weights
    table : Table
    margin, published_margin : float
        Smallest drive of a cell, for equal sums of weights.
    published_relative : float
        Published margin divided by the sum of all weights.
    """

    published: Template
    template: Template
    weights: Weights
    table: Table
    margin: float
    published_margin: float
    published_relative: float

    @property
    def name(self) -> str:
        """Of the template."""
        return self.published.name


def found_again() -> Iterator[Again]:
    """Yield every uncoupled template of one layer and 3×3 cells whose check is a local rule."""
    for name in template_names():
        template = get_template(name)
        if (table := _table(template)) is not None:
            yield again(template, table)


def again(template: Template, table: Table) -> Again:
    """Return a template together with the one designed from its rule.

    Raises
    ------
    TemplateError
        If no single template follows the rule.
    """
    weights = separate(table)
    assert isinstance(weights, Weights)  # the published one separates too
    margin, relative = margins(template, _with_idle(template, table))
    size = margin / relative if relative else 1.0 / weights.relative
    before = any(seen.source == "before" for seen in table.seen)
    shape = Shape(
        template.name,
        template.description,
        template.boundary.name,
        -1.0 if before else 0.0,
        weights.relative * size,
        template.check,
    )
    made = as_template(weights, shape)
    made = replace(made, input_boundary=template.input_boundary)
    if not before and form_of(template).name == "logic":  # whose cells start black or white
        made = replace(made, duration=duration_from_rails(shape.margin))
    return Again(template, made, weights, table, weights.relative * size, margin, relative)


def _table(template: Template) -> Table | None:
    """Return the local rule of an uncoupled template, None where it has none."""
    if template.check is None or not _fits(template, form_of(template)):
        return None
    try:
        table = table_of(template)
    except CnnumError:
        return None  # the check is no local rule
    return None if any(seen.source == "y" for seen in table.seen) else table


def _with_idle(template: Template, table: Table) -> Table:
    """Return a rule with the cells that decide nothing, which a template may weigh all the same."""
    whole = table_of(template, whole=True)
    kept = [k for k, seen in enumerate(whole.seen) if seen.source == "u" or seen in table.seen]
    return Table(tuple(whole.seen[k] for k in kept), whole.signs[:, kept], whole.colours)


def _fits(template: Template, form: ClosedForm) -> bool:
    single = template.layers == 1 and template.inputs == 1 and template.radius <= 1
    return form.digital and single and template.plain and not np.delete(_nine(template.A), 4).any()


def margins(template: Template, table: Table) -> tuple[float, float]:
    """Return the least signed drive over all configurations, and the same over Σ |weights|.

    The drive is that of a cell at its start, Σ A y + Σ B u + z − x. Weights that act together count
    as their sum: a control and a feedback of the same cell that starts from the input. Of the own
    feedback 1 counts as nothing, since it only holds the state. A negative margin is a wrong
    answer. The ratio compares weights of one form with each other. How far weights may be off is
    another number, since each varies by itself and the run ends: see `worst_case`.

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
    margin = float(sums.min())
    return margin, margin / (float(np.abs(columns).sum()) + abs(bias))


def _nine(kernels: Floats) -> Floats:
    result = np.zeros((3, 3))
    kernel = kernels[0, 0]
    if kernel.shape[0] == 1:
        result[1, 1] = kernel[0, 0]
    else:
        result[:] = kernel
    return result.ravel()
