"""Properties of a template's transients before they run: rates, stable steps, and rest."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cnnum.arrays import Shape, as_shape
from cnnum.errors import ProgramError, TemplateError
from cnnum.frame import FORCE_AXES
from cnnum.graph.nodes import RunSpec, Transient
from cnnum.graph.schedule import schedule
from cnnum.integrators.choice import choose
from cnnum.integrators.closed_forms import diagonal_in_modes, mode_rates
from cnnum.integrators.estimate import error_growth
from cnnum.integrators.rosenbrock import IMPLICIT_METHODS
from cnnum.integrators.spectrum import EIGENVALUE_LIMIT, Spectrum, spectrum, torus_coupling
from cnnum.integrators.stability import METHODS, StabilityBound, delayed_rates, stability_bound
from cnnum.programs import Program
from cnnum.runs.linear_range import as_linear
from cnnum.runs.planning import graph_of
from cnnum.safety.values import expect
from cnnum.templating.functions import OUTPUT_FUNCTIONS
from cnnum.templating.library import as_template
from cnnum.templating.network import Network
from cnnum.templating.stability_class import (
    StabilityClass,
    refuted,
    sampled_slopes,
    stability_class,
    state_bound,
)
from cnnum.templating.template import Template
from cnnum.values import ByContent

STILL = 1e-9
"""Fraction of the fastest rate below which a rate is indistinguishable from 0."""

ROUNDINGS = 1e-13
"""Fraction of the largest singular value below which the smallest counts as 0."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Analysis(ByContent):
    """Properties of a template on an array of a given size, known before it runs.

    Attributes
    ----------
    template : str
    shape : (rows, cols)
    kind : StabilityClass
        Whether transients come to rest, and by which theorem.
    source : str
        Origin of the rates, such as "the modes of its boundary" or Gershgorin's discs.
    exact : bool
        Whether `fastest` comes from the eigenvalues of the array and not from a bound on them.
    fastest : float
        Largest |λ| of the array, whichever cells saturate, in 1/time. With a delay, only modes that
        do not decay count.
    slowest : float
        Smallest rate of decay while no cell saturates, in 1/time; NaN if no mode decays, or if the
        rates are not known.
    growth, turning : float
        Largest real and imaginary parts of the rates while no cell saturates, in 1/time; NaN if the
        rates are not known.
    stiffness : float
        Ratio of the largest rate of decay to the smallest; NaN where `slowest` is NaN.
    condition : float
        Condition number of the matrix 1 − A, which gives the state at rest while no cell saturates:
        the largest factor by which it amplifies a relative error of the drive. Infinite if 1 − A is
        singular, NaN if it is not known.
    saturation : str
        Effect of saturating cells, as a sentence.
    largest : float
        Bound on |x| for inputs within [−1, 1], with the template's own inputs beyond the rim, and
        for initial states within [−1, 1] or as the template gives them; infinite if no bound is
        known.
    bounds : mapping of str to StabilityBound
        Longest stable step of each method.
    method, reason : str
        The method that ``method="auto"`` chooses, and the reason.
    """

    template: str
    shape: Shape
    kind: StabilityClass
    source: str
    exact: bool
    fastest: float
    slowest: float
    growth: float
    turning: float
    stiffness: float
    condition: float
    saturation: str
    largest: float
    bounds: Mapping[str, StabilityBound]
    method: str
    reason: str

    def __repr__(self) -> str:
        rows, cols = self.shape
        return (
            f"Analysis('{self.template}' on {rows}×{cols}: {self.kind.name}, fastest "
            f"{self.fastest:.4g}, stiffness {self.stiffness:.4g}, method {self.method})"
        )


def analyse(template: Template | str, shape: Sequence[int] = (8, 8)) -> Analysis:
    """Return the properties of a template's transients before they run.

    Parameters
    ----------
    template : Template or str
        A template, or the name of one of the library.
    shape : (rows, cols)

    Raises
    ------
    ArrayError
        If the shape is not that of an array.
    TemplateError
        If it is not a template.
    UnknownNameError
        If the library has no template of that name.

    Notes
    -----
    Rates are exact if they come from the modes of the boundary or from the eigenvalues of up to
    256 states; otherwise Gershgorin's discs bound them. Rates "while no cell saturates" assume
    f(x) = x and are therefore not known for your own output functions. If samples of such a
    function exceed the slopes that it declares, the figures use the sampled slopes and no theorem
    is named.
    """
    known = as_template(template)
    names = [f"input {n}" for n in range(known.inputs)]
    names += [f"state {n}" for n in range(known.layers)]
    graph = graph_of(known, as_shape(shape), names, RunSpec())
    (transient,) = (node.operation for node in graph.nodes if isinstance(node.operation, Transient))
    return _analysed(transient, as_shape(shape))


def analyse_program(
    program: Program, shape: Sequence[int] = (8, 8), *, channels: Sequence[str] = FORCE_AXES
) -> tuple[Analysis, ...]:
    """Return the analysis of each template that a program runs.

    Parameters
    ----------
    program : Program
    shape : (rows, cols)
    channels : sequence of str
        As in `Engine.compile`.

    Raises
    ------
    ProgramError
        If it is not a program, or cannot be traced.
    """
    expect("program", program, Program, ProgramError)
    thinned = schedule(program.trace(shape, channels), channels, None)
    result = {node.operation: None for node in thinned.transients}
    return tuple(
        _analysed(transient, thinned.shape)
        for transient in result
        if isinstance(transient, Transient)
    )


def _analysed(transient: Transient, shape: Shape) -> Analysis:
    solver, template = choose(transient, shape), transient.template
    kind = stability_class(template, shape)
    template = _as_sampled(template)
    result, delayed = spectrum(template, shape), delayed_rates(template, shape)
    free = _unsaturated(template, shape)
    decays = np.zeros(0) if free is None else -free.values.real
    decays = decays[decays > STILL * (0.0 if free is None else np.abs(free.values).max())]
    slowest = float(decays.min()) if len(decays) else math.nan
    exact = result.exact and delayed is None
    fastest = float(np.abs(result.values).max(initial=0.0)) if exact else result.fastest
    return Analysis(
        template=template.name,
        shape=shape,
        kind=kind,
        source=result.reason if delayed is None else delayed.reason,
        exact=exact,
        fastest=fastest if delayed is None else fastest + delayed.reach,
        slowest=slowest,
        growth=math.nan if free is None else max(0.0, float(free.values.real.max())),
        turning=math.nan if free is None else float(np.abs(free.values.imag).max()),
        stiffness=float(decays.max()) / slowest if len(decays) else math.nan,
        condition=_condition(template, shape),
        saturation=_saturation(template, result),
        largest=state_bound(template),
        bounds={name: stability_bound(template, shape, name) for name in METHODS},
        method=solver.method,
        reason=solver.reason,
    )


def _as_sampled(template: Template) -> Template:
    """Return the template with sampled slopes of its output, if they differ from the declared
    ones.
    """
    output = template.output
    sampled = sampled_slopes(output, state_bound(template))
    if output.discrete or not refuted(output, sampled):
        return template
    if not np.isfinite(sampled).all():
        raise TemplateError(
            f"The output function '{output.name}' of template '{template.name}' is not "
            "finite everywhere, so its rates are not known."
        )
    slope = (min(output.slope[0], sampled[0]), max(output.slope[1], sampled[1]))
    return replace(template, output=replace(output, slope=slope))


def _linear_range(template: Template) -> Template | None:
    """Return the template with f(x) = x, or None if its output or couplings do not allow it."""
    own = OUTPUT_FUNCTIONS.get(template.output.name) is not template.output
    return None if own or template.output.discrete or not template.plain else as_linear(template)


def _unsaturated(template: Template, shape: Shape) -> Spectrum | None:
    """Return the rates while no cell saturates, or None if they are not known individually."""
    linear = _linear_range(template)
    if linear is None:
        return None
    result = spectrum(linear, shape)
    return result if result.exact else None


def _condition(template: Template, shape: Shape) -> float:
    """Return the condition number of 1 − A, from the matrix itself or from known modes.

    Modes are orthonormal, so the singular values are those of the matrices per mode.
    """
    if (linear := _linear_range(template)) is None:
        return math.nan
    linear = replace(linear, tau=np.ones(linear.layers))
    network = Network(linear, shape)
    matrix: NDArray[np.float64] | NDArray[np.complex128]
    if network.states <= EIGENVALUE_LIMIT:
        matrix = network.linear_system().matrix
    elif diagonal_in_modes(linear):
        matrix = mode_rates(linear, shape)
    elif linear.boundary.pad_mode == "wrap":
        matrix = torus_coupling(linear, shape) - np.eye(linear.layers)
    else:
        return math.nan
    sizes = np.linalg.svd(matrix, compute_uv=False)
    most, least = float(sizes.max()), float(sizes.min())
    return most / least if least > ROUNDINGS * most else math.inf


def _saturation(template: Template, rates: Spectrum) -> str:
    """Return the effect of saturation on the rates."""
    output = template.output
    if output.linear:
        return "No cell saturates: the rates hold for every state."
    if output.discrete:
        return "It runs in discrete time: every cell is saturated at every step."
    if rates.real and not rates.exact:
        return (
            "Cells that saturate move the rates towards the cells' own decay: they stay between "
            "those of the array and −1/τ, as A is symmetric."
        )
    discs = rates.discs
    reach = rates.fastest if discs is None else discs.reach
    growth = max(error_growth(template), 0.0)
    most = f"they may grow at {growth:.3g} at most" if growth else "none grows"
    return f"With any cells saturated, rates are {reach:.3g} at most, and {most} (Gershgorin)."


def text(analysis: Analysis) -> list[tuple[str, str]]:
    """Return the figures in words, as pairs of a name and its text."""

    def rate(value: float) -> str:
        return "none is known" if math.isnan(value) else f"{value:.4g}"

    source = f"{analysis.source}{'' if analysis.exact else ' (a bound)'}"
    return [
        ("stability", f"{analysis.kind.name}: {analysis.kind.why}"),
        ("rates", f"up to {rate(analysis.fastest)} a time constant, from {source}"),
        ("slowest decay", rate(analysis.slowest)),
        ("stiffness", f"{rate(analysis.stiffness)} (the largest rate of decay over the smallest)"),
        ("growth", f"{rate(analysis.growth)}; turning {rate(analysis.turning)}"),
        ("condition", rate(analysis.condition)),
        ("saturation", analysis.saturation),
        ("largest |x|", rate(analysis.largest)),
        ("auto", f"{analysis.method}: {analysis.reason}"),
    ]


def step(bound: StabilityBound, method: str) -> str:
    """Return a stable step in words."""
    if bound.step == 0.0:
        return "not for this template" if method in IMPLICIT_METHODS else "none"
    return "any" if math.isinf(bound.step) else f"{bound.step:.4g}"
