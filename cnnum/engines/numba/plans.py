"""From a template, its array and its solver to what the compiled functions take."""

from cnnum.engines.numba import codes
from cnnum.engines.numba.layout import Layout
from cnnum.engines.numba.methods import exact, method_settings, tableau_rows
from cnnum.engines.numba.records import SETTINGS, Plan, Real
from cnnum.engines.numba.taps import couplings_of, gains_of, packed
from cnnum.integrators.choice import Solver
from cnnum.template import Template

RESPONSES = {
    "standard": codes.CLAMP,
    "full-range": codes.CLAMP,
    "linear": codes.IDENTITY,
    "tanh": codes.TANH,
    "sign": codes.SIGN,
}
"""The compiled form of every output function."""


def plan_of(template: Template, layout: Layout, solver: Solver, dtype: Real) -> Plan:
    """Return a template on an array, and how it runs."""
    couplings = couplings_of(template, layout)
    gains = gains_of(template, couplings)
    taps, first = couplings.packed_taps()
    tables, points = couplings.packed_tables(dtype)
    cells = {
        "layers": template.layers,
        "size": layout.size,
        "response": RESPONSES[template.output.name],
        "limited": template.output.limited,
        "reads_states": any("x" in (c.neighbour, c.centre) for c in template.nonlinear),
    }
    return Plan(
        settings=packed(SETTINGS, [cells | method_settings(template, solver, dtype)]),
        tableau=tableau_rows(solver),
        taps=taps,
        first=first,
        tables=tables,
        points=points,
        gains=gains,
        rim=layout.rim(template.boundary),
        inside=layout.inside(template.layers),
        bands=layout.bands(template.layers),
        exact=exact(solver, dtype),
    )
