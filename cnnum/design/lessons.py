"""Lessons of specifications: their examples, or pictures of the check of a form."""

from collections.abc import Sequence

import numpy as np

from cnnum.arrays import Floats
from cnnum.design.learning import Lesson
from cnnum.errors import TemplateError
from cnnum.templating.checks.registry import form_of
from cnnum.templating.template import Template

SEED, SHAPE = 1, (8, 8)
"""Of the pictures of a check; flips are counted on those of another seed."""

Example = tuple[Floats, Floats | None, Floats]


def lesson_of(form: Template, examples: Sequence[Example]) -> Lesson:
    """Return the lesson of examples, or of the form's check where there are none.

    Parameters
    ----------
    form : Template
    examples : sequence of (input, state or None, output)
        Of one size.

    Raises
    ------
    TemplateError
        If examples differ in size, or the form has no check, or one that no lesson can have.
    """
    if not examples:
        return _of_check(form)
    inputs, states, outputs = zip(*examples, strict=True)
    if len({one.shape for one in outputs}) > 1 or len({one is None for one in states}) > 1:
        raise TemplateError(
            f"The lesson of '{form.name}' needs examples of one size, all with a state or none."
        )
    state = None if states[0] is None else np.stack(states)
    return Lesson(form, np.stack(outputs), np.stack(inputs) if form.inputs else None, state)


def _of_check(form: Template) -> Lesson:
    rule = form_of(form)
    case = rule.cases(form, np.random.default_rng(SEED), SHAPE)
    others = (case.previous, case.bias, case.mask)
    if rule.compares != "output" or any(one is not None for one in others):
        raise TemplateError(
            f"The check of '{form.name}' has more than inputs, states and outputs: give the lesson "
            "as tables [[example]]."
        )
    return Lesson(form, rule.expected(form, case), case.input, case.state)
