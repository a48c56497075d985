"""Properties of a template's transients before they run: rates, stable steps, and rest."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cnnum.arrays import Shape, as_shape
from cnnum.errors import ProgramError, TemplateError
from cnnum.frame import FORCE_AXES
from cnnum.graph.nodes import RunSpec, Transient
from cnnum.graph.passes import schedule
from cnnum.integrators.choice import choose
from cnnum.integrators.delays import delayed_rates
from cnnum.integrators.estimate import error_growth
from cnnum.integrators.rosenbrock import IMPLICIT_METHODS
from cnnum.integrators.spectrum import EIGENVALUE_LIMIT, Spectrum, spectrum
from cnnum.integrators.stability import METHODS, StabilityBound, stability_bound
from cnnum.programs import Program
from cnnum.runs.linear_range import as_linear
from cnnum.runs.planning import graph_of
from cnnum.safety.values import expect
from cnnum.templating.library import by_name
from cnnum.templating.network import Network
from cnnum.templating.stability_class import StabilityClass, stability_class
from cnnum.templating.template import Template

STILL = 1e-9
"""Part of the fastest rate below which a mode neither decays nor grows: some roundings."""


@dataclass(frozen=True, slots=True)
class Analysis:
    """The figures of a template on an array of given size, before anything runs.

    Attributes
    ----------
    template : str
    shape : (rows, cols)
    kind : StabilityClass
        Whether transients come to rest, with the theorem.
    source : str
        Where the rates are from: "the modes of its boundary", Gershgorin's discs, and so on.
    exact : bool
        The rates are the eigenvalues of the array, not a bound on them.
    fastest : float
        Largest |λ| of the array, whatever cells saturate, 1/time.
    slowest : float
        Smallest rate of decay while no cell saturates, 1/time; NaN where none decays or is known.
    growth, turning : float
        Largest real and imaginary part of a rate while no cell saturates, 1/time.
    stiffness : float
        Largest rate of decay over the smallest; NaN as `slowest`.
    condition : float
        Of the matrix 1 − A that gives the state at rest while no cell saturates: by how much more
        an error of the drive may count there than the drive itself. Infinite where a mode neither
        grows nor decays; NaN where it is not known.
    saturation : str
        The effect of cells that saturate, in a sentence.
    largest : float
        Bound on |x| for inputs and starts within [−1, 1]; infinite where the output is not bounded.
    bounds : mapping of str to StabilityBound
        The longest stable step of every method.
    method, reason : str
        Those of method="auto".
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


def analyse(template: Template | str, shape: Sequence[int] = (8, 8)) -> Analysis:
    """Return the properties of a template's transients before they run.

    Parameters
    ----------
    template : Template or str
        One of your own, or one of the library's by its name.
    shape : (rows, cols)

    Raises
    ------
    ArrayError
        If the shape is not that of an array.
    TemplateError
        If it is no template.
    UnknownNameError
        If there is none of that name.

    Notes
    -----
    Rates are exact in the modes of the boundary, or by the eigenvalues of up to 256 states. Else
    Gershgorin's discs bound them.
    """
    known = by_name(template) if isinstance(template, str) else template
    expect("template", known, Template, TemplateError)
    names = [f"input {n}" for n in range(known.inputs)]
    names += [f"state {n}" for n in range(known.layers)]
    graph = graph_of(known, as_shape(shape), names, RunSpec())
    (transient,) = (node.operation for node in graph.nodes if isinstance(node.operation, Transient))
    return _analysed(transient, as_shape(shape))


def analyse_program(
    program: Program, shape: Sequence[int] = (8, 8), *, channels: Sequence[str] = FORCE_AXES
) -> tuple[Analysis, ...]:
    """Return the analysis of every template that a program runs, each once.

    Parameters
    ----------
    program : Program
    shape : (rows, cols)
    channels : sequence of str
        As in `Engine.compile`.

    Raises
    ------
    ProgramError
        If it is no program, or cannot be traced.
    """
    expect("program", program, Program, ProgramError)
    thinned = schedule(program.trace(shape, channels), channels, None)
    found = {node.operation: None for node in thinned.transients}
    return tuple(_analysed(one, thinned.shape) for one in found if isinstance(one, Transient))


def _analysed(transient: Transient, shape: Shape) -> Analysis:
    template = transient.template
    found = spectrum(template, shape)
    delayed = delayed_rates(template, shape)
    fastest = found.fastest
    free = spectrum(as_linear(template), shape) if template.plain else found
    decays = -free.values.real[free.values.real < -STILL * fastest]
    slowest = float(decays.min()) if len(decays) else math.nan
    solver = choose(transient, shape)
    return Analysis(
        template=template.name,
        shape=shape,
        kind=stability_class(template),
        source=found.reason if delayed is None else delayed.reason,
        exact=found.exact and delayed is None,
        fastest=fastest,
        slowest=slowest,
        growth=max(0.0, float(free.values.real.max(initial=-math.inf))),
        turning=float(np.abs(free.values.imag).max(initial=0.0)),
        stiffness=float(decays.max()) / slowest if len(decays) else math.nan,
        condition=_condition(template, shape, free),
        saturation=_saturation(template, found),
        largest=_largest(template),
        bounds={name: stability_bound(name, template, shape) for name in METHODS},
        method=solver.method,
        reason=solver.reason,
    )


def _condition(template: Template, shape: Shape, free: Spectrum) -> float:
    """Return the condition of the array's matrix: from itself, or from modes that are known."""
    network = Network(template, shape)
    if not template.plain:
        return math.nan
    if network.states <= EIGENVALUE_LIMIT:
        sizes = np.linalg.svd(network.linear_system().matrix, compute_uv=False)
    elif free.exact and free.real:
        sizes = np.abs(free.values)
    else:
        return math.nan
    most, least = float(sizes.max()), float(sizes.min())
    return most / least if least > STILL * most else math.inf


def _saturation(template: Template, found: Spectrum) -> str:
    """Return the effect of saturation on the rates."""
    output = template.output
    if output.linear:
        return "No cell saturates: the rates hold for every state."
    if output.discrete:
        return "It runs in discrete time: every cell is saturated at every step."
    if found.real and not found.exact:
        return (
            "Cells that saturate move the rates towards the cells' own decay: they stay between "
            "those of the array and −1/τ, as A is symmetric."
        )
    discs = found.discs
    reach = found.fastest if discs is None else discs.reach
    growth = max(error_growth(template), 0.0)
    most = f"they may grow at {growth:.3g} at most" if growth else "none grows"
    return f"With any cells saturated, rates are {reach:.3g} at most, and {most} (Gershgorin)."


def _largest(template: Template) -> float:
    """Return 1 + max (Σ|A| + Σ|B| + |z|) of a bounded output (Chua & Yang 1988, theorem 1)."""
    if template.output.linear or not template.plain:
        return math.inf
    if template.output.limited:
        return 1.0
    weights = np.abs(template.A).sum(axis=(1, 2, 3)) + np.abs(template.B).sum(axis=(1, 2, 3))
    return 1.0 + float((weights + np.abs(template.z)).max())


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
