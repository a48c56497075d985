"""The choice of `auto`: by evaluations of the rates, counted on runs with every method."""

import math

import numpy as np
import pytest

from cnnum.engine import Engine
from cnnum.engines.reference.equation import Given, StateEquation
from cnnum.errors import MethodError
from cnnum.graph.nodes import RunSpec
from cnnum.integrators.cost import effort, motion, pair
from cnnum.integrators.schemes import AdaptiveSteps, ChebyshevSteps
from cnnum.integrators.spectrum import spectrum
from cnnum.integrators.stability import stability_bound
from cnnum.integrators.tableau import (
    BOGACKI_SHAMPINE,
    DORMAND_PRINCE,
    MAX_STAGES,
    TABLEAUX,
    chebyshev_method,
    stages_for,
)
from cnnum.runs.ladder import LADDER, run
from cnnum.runs.request import Request, maps_by_role
from cnnum.runs.result import ROLES
from cnnum.templating.library import get_template
from cnnum.templating.template import Template

PAIRS = ("bogacki-shampine", "dormand-prince")
STAGES = "runge-kutta-chebyshev"
STEPPING = (
    "AVERAGE", "CCD_DIAG", "CONNECTI", "CONTOUR", "DIFFUS", "GLOBMAX", "GRADIENT", "HOLE",
    "INTERP", "LAPLACE", "MAXLOC", "OSCILLATOR", "PROP1", "RECALL", "SHADOW",
)  # fmt: skip


def network(rng):
    """A template of any strength, growing or not, which may settle or end before."""
    k = int(rng.choice([3, 5]))
    feedback = rng.normal(size=(k, k))
    if rng.random() < 0.5:
        feedback = feedback + feedback[::-1] + feedback[:, ::-1] + feedback[::-1, ::-1]
    feedback *= 10.0 ** rng.uniform(-0.5, 1.3) / np.abs(feedback).sum()
    return Template(
        "sampled",
        feedback,
        None,
        float(rng.normal(0.0, 0.5)),
        boundary=rng.choice(np.array([0.0, -1.0, "zero-flux", "periodic"], dtype=object)),
        initial="input",
        duration=float(rng.choice([0.5, 2.0, 8.0, 30.0])),
        output=str(rng.choice(["standard", "standard", "tanh"])),
    )


HALVED = [way.name for way in LADDER].index("halved")


def counted(engine, solver_for, template, spec, maps):
    """Return how many evaluations of the rates each method takes that can, on the way alone.

    `Engine.run` goes on where a rest is not shown, and runs anew for longer.
    """
    counts = {}
    given, whole = maps_by_role(template, {role: maps.get(role) for role in ROLES})
    for method in PAIRS:
        asked = RunSpec(method=method, **spec)
        request = Request(engine._open, template, given, whole, asked)
        steps = int(run(request, HALVED).steps)  # below the way to a rest
        counts[method] = 1 + steps * (TABLEAUX[method].stages - 1)
    shape = maps["state"].shape[-2:]
    if template.plain and spectrum(template, shape).real:
        solver = solver_for(template, shape, method=STAGES, **spec)
        counts[STAGES] = chebyshev_evaluations(template, shape, maps, solver)
    return counts


def maps_of(template, rng, shape=(8, 8)):
    state = rng.uniform(-1.0, 1.0, (template.layers, *shape))
    maps = {"state": state[0] if template.layers == 1 else state}
    if template.inputs:
        maps["input"] = np.sign(rng.normal(size=(template.inputs, *shape)))[0]
    return maps


def cases():
    rng = np.random.default_rng(41)
    for name in STEPPING:
        for rtol in (1e-3, 1e-5, 1e-7):
            yield get_template(name), rtol, rng
    for _ in range(45):
        yield network(rng), float(10.0 ** -rng.integers(3, 8)), rng


@pytest.fixture(scope="module")
def runs(solver_for):
    """Of each case whether it bends on its way to an end, its method, counts, and maps."""
    engine, found = Engine("numba", precision="float64"), []
    for template, rtol, rng in cases():
        maps, spec = maps_of(template, rng), {"rtol": rtol, "atol": 0.1 * rtol}
        solver = solver_for(template, (8, 8), **spec)
        bends = not (template.output.smooth or solver.settle)
        counts = counted(engine, solver_for, template, spec, maps)
        found.append((bends, solver.method, counts, (template, spec, maps)))
    return found


def test_auto_takes_the_fewest_evaluations_or_few_more(runs):
    """Its method against the others, all counted, where a rest or a smooth output is the aim."""
    losses = [counts[m] / min(counts.values()) for bends, m, counts, _ in runs if not bends]
    assert len(losses) >= 30
    # here 100 % and 1.11; the tolerance alone would choose well in 63 % of all 90
    assert np.mean(np.array(losses) <= 1.3) >= 0.95
    assert max(losses) <= 1.45


@pytest.mark.in_full("test_auto_takes_the_fewest_evaluations_or_few_more")
def test_where_rates_bend_auto_keeps_the_tolerance_more_often(runs):
    """Against the method of the fewest evaluations; the truth is a pair's at 1e-11."""
    engine, missed = Engine("numba", precision="float64"), []
    for bends, chosen, counts, (template, spec, maps) in runs:
        fewest = min(counts, key=counts.get)
        if bends and chosen != fewest:
            tight = {"method": "dormand-prince", "rtol": 1e-11, "atol": 1e-11}
            truth = engine.run(template, **tight, **maps).state
            tolerance = spec["atol"] + spec["rtol"] * np.abs(truth)
            states = (
                engine.run(template, method=m, **spec, **maps).state for m in (chosen, fewest)
            )
            missed.append([np.any(np.abs(state - truth) > tolerance) for state in states])
            # six evaluations a step against three, at bends of about the same length
            assert counts[chosen] <= 2.5 * counts[fewest]
    ours, theirs = np.mean(missed, axis=0)
    assert len(missed) >= 15
    assert ours <= 0.5 * theirs


def chebyshev_evaluations(template, shape, maps, solver):
    """Return the stages that Chebyshev's steps take, one by one in NumPy."""
    state, seen = maps["state"].reshape(-1, *shape), maps.get("input")
    inputs = None if seen is None else seen.reshape(-1, *shape)
    equation = StateEquation(template, shape, Given(inputs, None, state, None, None))
    slowest = float(template.tau.max())
    drive, scheme, x = equation.drive(), solver.scheme, state
    longest = chebyshev_method(MAX_STAGES).real_stability / scheme.fastest
    time, h, first, count = 0.0, scheme.first_step, equation.rate(drive, x, None, 0.0), 1
    while time < solver.duration * (1.0 - 1e-9):
        h = min(h, longest, solver.duration - time)
        stages = min(stages_for(h * scheme.fastest), MAX_STAGES)
        method, before = chebyshev_method(stages), x
        now = x + method.first * h * first
        for back1, back2, weight, start in method.rows:
            rate = weight * equation.rate(drive, now, None, time) + start * first
            new = (1.0 - back1 - back2) * x + back1 * now + back2 * before + h * rate
            before, now = now, new
        last = equation.rate(drive, now, None, time)
        error = np.abs(0.8 * (x - now) + 0.4 * h * (first + last))
        scale = solver.atol + solver.rtol * np.maximum(np.abs(x), np.abs(now))
        worst, count = float((error / scale).max()), count + stages
        if worst <= 1.0:
            time, x, first = time + h, now, last
            at_rest = np.abs(slowest * last) <= solver.atol + solver.rtol * np.abs(x)
            if solver.settle and at_rest.all():
                return count
        h *= min(max(0.8 * max(worst, 1e-10) ** (-1.0 / 3.0), 0.1), 5.0)
    return count


@pytest.mark.parametrize(
    ("strength", "rtol"), [(30.0, 1e-3), (30.0, 1e-5), (0.5, 1e-4), (3.0, 1e-8)]
)
def test_stages_are_taken_where_they_pay(solver_for, strength, rtol):
    """A diffusion that saturates: fast, then hardly fast at all."""
    spread = np.array([[0, 1, 0], [1, -4.0, 1], [0, 1, 0]])
    template = Template("spread", strength * spread, boundary="zero-flux", duration=10.0)
    spec = {"rtol": rtol, "atol": 0.1 * rtol}
    state = np.random.default_rng(1).uniform(-1.0, 1.0, (10, 10))
    engine = Engine("numba", precision="float64")
    counts = counted(engine, solver_for, template, spec, {"state": state})
    chosen = solver_for(template, (10, 10), **spec)
    assert (chosen.method == STAGES) == (strength == 30.0)
    assert counts[chosen.method] <= 1.3 * min(counts.values())


@pytest.mark.parametrize("rtol", [1e-3, 1e-6])
def test_the_reason_states_the_numbers(solver_for, rtol):
    template = get_template("LAPLACE")
    solver = solver_for(template, (12, 12), rtol=rtol, atol=rtol)
    words = solver.reason.split()
    numbers = [int(word) for word in words if word.isdigit()]
    assert numbers == sorted(numbers)
    assert len(numbers) == 3
    named = {*PAIRS, STAGES}
    assert {word.strip(";,") for word in words} & named == named - {solver.method}


def test_the_reason_names_what_sets_the_steps(solver_for):
    fast = Template("fast", [[0, 30.0, 0], [30.0, -120.0, 30.0], [0, 30.0, 1e-9]], duration=50.0)
    slow = Template("slow", [[0, 0.1, 0], [0.1, 0.2, -0.1], [0, 0.1, 0]], duration=1.0)
    assert "stability sets most" in solver_for(fast, (6, 6)).reason
    assert "the error estimate sets most" in solver_for(slow, (6, 6), rtol=1e-8).reason


@pytest.mark.parametrize("method", [BOGACKI_SHAMPINE, DORMAND_PRINCE], ids=lambda m: m.name)
@pytest.mark.parametrize("tolerance", [1e-5, 1e-9])
def test_one_decaying_mode_takes_as_many_steps_as_it_should(method, tolerance):
    """p (c/tol)^{1/p} steps for e^{−t}, by its formula and as counted on tanh cells near 0."""
    template = Template("mode", [[-1e-12]], duration=60.0, initial="input", output="tanh")
    found = spectrum(template, (2, 2))
    known = motion(template, (2, 2), found, 60.0, (0.0, tolerance), settle=False)
    # no step is held by stability, so that the tolerance alone counts
    long = AdaptiveSteps((method,), 1e9, settle=False, longest=1e9)
    got = effort(pair(method, long), known).evaluations
    steps = method.order * (method.estimate_smooth / tolerance) ** (1 / method.order) / 0.9
    # the first and the last step, and the sum over 40 instants
    assert got == pytest.approx(1 + (method.stages - 1) * (1 + steps), rel=0.03)
    taken = counted_near(template, method.name, tolerance)
    # rejected steps, those at the bound in the end, and the first, which is shorter
    assert got == pytest.approx(taken, rel=0.35)


def counted_near(template, method, tolerance):
    spec = {"method": method, "rtol": 0.0, "atol": tolerance, "duration": 12.0}
    got = Engine("numba", precision="float64").run(template, input=np.ones((2, 2)), **spec)
    return 1 + int(got.steps) * (TABLEAUX[method].stages - 1)


@pytest.mark.parametrize("settle", [False, True])
def test_auto_never_steps_outside_the_stability_bound(solver_for, settle):
    rng = np.random.default_rng(7)
    taken = set()
    for _ in range(60):
        template, rtol = network(rng), float(10.0 ** -rng.integers(1, 10))
        spec = {"rtol": rtol, "duration": "settle" if settle else 50.0}
        solver = solver_for(template, (5, 6), **spec)
        bound = stability_bound(template, (5, 6), solver.method).step
        taken.add(solver.method)
        if isinstance(solver.scheme, AdaptiveSteps):
            assert solver.scheme.first_step <= solver.scheme.longest <= bound
        else:
            assert isinstance(solver.scheme, ChebyshevSteps)
            assert solver.scheme.fastest >= np.abs(spectrum(template, (5, 6)).values).max()
    assert taken >= {*PAIRS}


@pytest.mark.parametrize("output", ["standard", "linear", "full-range", "tanh"])
@pytest.mark.parametrize("duration", [0.0, 1e-20, 3.0, "settle"])
def test_any_array_has_a_choice(solver_for, output, duration):
    """Cells that only grow, integrate or rest have no slowest decay, or no rate at all."""
    for centre in (-40.0, 0.0, 1.0, 9.0):
        for other in (0.0, 0.3):
            template = Template(
                "any", [[0, 0, 0], [other, centre, -other], [0, 0, 0]], output=output
            )
            solver = solver_for(template, (4, 4), duration=duration, has_mask=True)
            assert solver.reason
            if isinstance(solver.scheme, AdaptiveSteps):
                assert math.isfinite(solver.scheme.longest)


def test_a_propagator_takes_no_step():
    with pytest.raises(MethodError, match="A propagator takes no steps: leave dt out"):
        Engine("numba").run(
            get_template("AVERAGE"), input=np.zeros((4, 4)), method="propagator", dt=0.1
        )
