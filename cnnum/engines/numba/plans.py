"""From a template, its array and its solver to the arguments of the compiled functions."""

import numpy as np
from numpy.typing import NDArray

from cnnum.engines.numba import codes
from cnnum.engines.numba.coefficients import chebyshev_rows, tableaux
from cnnum.engines.numba.layout import Layout
from cnnum.engines.numba.methods import method_settings, pieces_of
from cnnum.engines.numba.records import SETTINGS, Plan, Real
from cnnum.engines.numba.stencil import couplings_of, gains_of, packed
from cnnum.integrators.estimate import slopes_count
from cnnum.integrators.solver import Solver
from cnnum.templating.reads import gains_jump, reads_states
from cnnum.templating.template import Template

RESPONSES = {
    "standard": codes.CLAMP,
    "full-range": codes.CLAMP,
    "linear": codes.IDENTITY,
    "tanh": codes.TANH,
    "sign": codes.SIGN,
}
"""Output functions that have a compiled form; others run by their expressions."""


def plan_of(template: Template, layout: Layout, solver: Solver, dtype: Real) -> Plan:
    """Return a template on an array, and how it runs."""
    couplings = couplings_of(template, layout)
    gains = gains_of(template, couplings)
    taps, first = couplings.packed_taps()
    tables, points = couplings.packed_tables(dtype)
    cells = {
        "layers": template.layers,
        "size": layout.size,
        "response": RESPONSES.get(template.output.name, codes.EXPRESSION),
        "limited": template.output.limited,
        "reads_states": reads_states(template),
        "slopes_count": slopes_count(template),
        "jumping": gains_jump(template),
        "whole": template.output.discrete,
        "cuts": 1,
    }
    return Plan(
        settings=packed(SETTINGS, [cells | method_settings(template, solver, dtype)]),
        tableau=tableaux(solver),
        taps=taps,
        first=first,
        tables=tables,
        points=points,
        gains=gains,
        pieces=pieces_of(solver),
        rim=layout.rim(template.boundary),
        bands=layout.bands(template.layers),
        chebyshev=chebyshev_rows(solver, dtype),
        formula=_formula(template, dtype),
        pairs=couplings.packed_pairs(dtype),
    )


def _formula(template: Template, dtype: Real) -> NDArray[np.float64]:
    if template.output.name in RESPONSES:
        return np.zeros((0, 2))
    return codes.operations(template.output.opencl, dtype, {"x": codes.TAKE_STATE})
