"""The audit of boundaries: a template's answer with another rim."""

from dataclasses import dataclass, replace

import numpy as np

from cnnum.arrays import Shape
from cnnum.templating.boundary import parse_boundary
from cnnum.templating.checks.measuring import WRONG
from cnnum.templating.checks.registry import form_of, posed
from cnnum.templating.checks.running import Engine, run_case
from cnnum.templating.template import Template

BOUNDARIES: tuple[float | str, ...] = (0.0, -1.0, "zero-flux")


@dataclass(frozen=True, slots=True)
class Audit:
    """Wrong cells of a template under each boundary.

    Attributes
    ----------
    template : str
    boundary : str or float
        Its own, for which the answer is defined.
    cells : int
        Number of cells of all pictures, objects at the frame among them.
    wrong : tuple of int
        Wrong cells with 0, −1 and zero-flux.
    """

    template: str
    boundary: str | float
    cells: int
    wrong: tuple[int, ...]


def audit(template: Template, engine: Engine, shape: Shape = (12, 12)) -> Audit | None:
    """Return the audit of a template; None where its answer is gray."""
    form = form_of(template)
    if not form.digital:
        return None
    case, expected = posed(template, 0, shape)
    wrong = list[int]()
    for boundary in BOUNDARIES:
        rim = parse_boundary(boundary)
        other = replace(template, boundary=rim, input_boundary=rim)
        found = np.asarray(run_case(other, engine, case, form.rtol).output, dtype=np.float64)
        wrong.append(int((~(np.abs(found - expected) <= WRONG)).sum()))
    return Audit(template.name, template.boundary.name, expected.size, tuple(wrong))
