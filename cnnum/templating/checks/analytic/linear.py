"""Linear arrays, exact at any time: each mode decays, grows or settles on its own.

x' = λx + b has the solution x(t) = e^{λt}x₀ + b(e^{λt} − 1)/λ (CNN: Chua & Yang 1988).
"""

from collections.abc import Callable

import numpy as np

from cnnum.arrays import Floats, Shape
from cnnum.templating.checks.analytic.modes import Modes, modes
from cnnum.templating.checks.parameters import number
from cnnum.templating.checks.pictures import gray
from cnnum.templating.checks.records import Case, ClosedForm, time_constant
from cnnum.templating.template import Template

ANALOG_TOLERANCE = 1e-3
ANALOG_REASON = (
    "ten times the relative tolerance 1e-4 of a run by default, as the errors of its steps add up; "
    "the answer itself is exact and of the order of 1"
)


def _diffusion_case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    return Case(input=gray(rng, shape), duration=_time(template))


def _time(template: Template) -> float | None:
    time = number(template, "time", 0.0)
    return time * time_constant(template) if time > 0.0 else None


def _diffusion_rates(template: Template, found: Modes) -> Floats:
    """Return λ of each mode where neighbours exchange, and nothing is made or lost."""
    edge, corner = number(template, "edge"), number(template, "corner", 0.0)
    return found.symbol(edge, corner) - 4.0 * (edge + corner)


def _diffusion(template: Template, case: Case) -> Floats:
    return _homogeneous(template, case, lambda found: _diffusion_rates(template, found))


def _coupled_rates(template: Template, found: Modes) -> Floats:
    edge, corner = number(template, "edge"), number(template, "corner", 0.0)
    return number(template, "centre") - 1.0 + found.symbol(edge, corner)


def _coupled_case(template: Template, rng: np.random.Generator, shape: Shape) -> Case:
    """Draw gray values so small that the fastest mode keeps every cell within ±1."""
    time = number(template, "time")
    rates = _coupled_rates(template, modes(template.boundary, shape))
    # A sum of modes is bounded cell by cell by the norm of the propagator's rows.
    bound = np.exp(time * float(rates.max())) * np.sqrt(shape[0] * shape[1])
    return Case(input=gray(rng, shape, 0.95 / bound), duration=time * time_constant(template))


def _coupled(template: Template, case: Case) -> Floats:
    return _homogeneous(template, case, lambda found: _coupled_rates(template, found))


def _homogeneous(template: Template, case: Case, rates: Callable[[Modes], Floats]) -> Floats:
    start = np.asarray(case.start(template), dtype=np.float64)
    found = modes(template.boundary, (start.shape[-2], start.shape[-1]))
    return found.apply(start, np.exp(rates(found) * case.time(template)))


def _band_pass(template: Template, case: Case) -> Floats:
    """Solve x' = −(1 + s²K)²x + 4s²K u with K the wave number squared, on the lattice."""
    found = modes(template.boundary, (case.pictures.shape[-2], case.pictures.shape[-1]))
    scaled = -number(template, "scale") * found.laplacian
    rate = (1.0 + scaled) ** 2
    return found.apply(case.pictures, -np.expm1(-rate * case.time(template)) * 4.0 * scaled / rate)


def _form(
    name: str,
    cases: Callable[..., Case],
    expected: Callable[[Template, Case], Floats],
    summary: str,
    parameters: tuple[tuple[str, ...], tuple[str, ...]],
) -> ClosedForm:
    needs, takes = parameters
    return ClosedForm(
        name, cases, expected, ANALOG_TOLERANCE, ANALOG_REASON, summary, needs=needs, takes=takes
    )


FORMS = (
    _form(
        "diffusion",
        _diffusion_case,
        _diffusion,
        "heat exchange with the neighbours for a time, mode by mode",
        (("edge",), ("corner", "time")),
    ),
    _form(
        "coupled",
        _coupled_case,
        _coupled,
        "small signals of a symmetric feedback, mode by mode, before any cell saturates",
        (("centre", "edge", "time"), ("corner",)),
    ),
    _form(
        "band-pass",
        _diffusion_case,
        _band_pass,
        "4s²K/(1 + s²K)² of each mode: zero mean, gain 1 where s²K = 1",
        (("scale",), ("time",)),
    ),
)
