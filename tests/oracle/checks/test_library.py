"""Every template of the library passes its check, and no template with a wrong weight does."""

from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

import cnnum.templating.library as library
from cnnum.arrays import Floats
from cnnum.errors import OneColourError
from cnnum.templating.checks import closed_form_names, form_of, run_check
from cnnum.templating.functions import Table
from cnnum.templating.template import Template

NAMES = library.template_names()
FORMS = {name: form_of(library.get_template(name)).name for name in NAMES}
FIRST = [name for n, name in enumerate(NAMES) if FORMS[name] not in map(FORMS.get, NAMES[:n])]
"""One template of each closed form."""

WEAK = [name for name in NAMES if FORMS[name].startswith("refined")]
"""Their check says nothing of their job, and is slow."""

ROBUST = ("MATCNN_MINIMIZE", "TRACE")
"""The minimum flows round an edge that repels it, and a layer follows its input regardless."""

SHAPES = [(8, 8), (5, 9), (9, 1)]
TOO_LARGE = {(5, 9): ("LINCUT7V", "SMKILLER")}
"""No line of seven cells has room, and nothing is large enough to be kept: no answer is black."""

PAIRS = [
    *((name, shape) for name in NAMES for shape in SHAPES),
    *((name, shape) for name in FIRST if name not in WEAK for shape in [(12, 12), (1, 7)]),
]

EQUIVALENT = {
    # x' = -x + f(x) - 2u and x' = -x - f(x) - 2u both end at -u.
    ("LOGNOT", "A", (0, 0, 1, 1)),
    # Gray values differ by less than 2, so that the table is never read beyond.
    *((name, "table 0", (n,)) for name in ("AVERGRAD", "BLUE") for n in (0, 4)),
    # The maximum flows round one edge that repels it; test_waves.py sees such an array.
    *(("GLOBMAX", "weights 0", edge) for edge in ((0, 1), (1, 0), (1, 2), (2, 1))),
}

# 1.05 times a weight moves an analog answer by more than its tolerance, a digital one not at all.
ANALOG_FORMS = {
    *("diffusion", "coupled", "band-pass", "filter", "uncoupled-cell", "mean-difference"),
    *("dominoes", "delayed-coupling", "fading", "oscillator", "trigger-wave"),
}
ANALOG = [name for name in FIRST if form_of(library.get_template(name)).name in ANALOG_FORMS]


@pytest.mark.one_in(2)
@pytest.mark.parametrize(("name", "shape"), PAIRS, ids=str)
def test_template_passes_its_check(name: str, shape: tuple[int, int], simulator: Any) -> None:
    template = library.get_template(name)
    try:
        result = run_check(template, simulator, shape=shape, repeats=0)
    except OneColourError:
        assert name in TOO_LARGE.get(shape, ()) or min(shape) == 1, name
        return
    assert result.passed, result


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_every_check_has_an_empty_picture_and_one_that_touches_the_frame(
    shape: tuple[int, int],
) -> None:
    for name in NAMES:
        template = library.get_template(name)
        case = form_of(template).cases(template, np.random.default_rng(0), shape)
        given = [maps for maps in (case.input, case.state, case.previous) if maps is not None]
        pictures = np.concatenate([maps.reshape(-1, *shape) for maps in given])
        rim = np.ones(shape, dtype=bool)
        rim[1:-1, 1:-1] = False
        assert (np.ptp(pictures, axis=(1, 2)) == 0.0).any(), f"{name} has no empty picture"
        assert np.ptp(pictures[:, rim], axis=1).any(), f"{name} has nothing at the frame"


@pytest.mark.parametrize("name", ["HOLE", "RECALL", "CCD_HOR", "SHADOW", "CONNECTI"])
def test_waves_cross_an_array_of_sixteen(name: str, simulator: Any) -> None:
    result = run_check(library.get_template(name), simulator, shape=(16, 16), seed=5, repeats=0)
    assert result.passed, result


@pytest.mark.parametrize("name", [name for name in FIRST if name not in (*WEAK, *ROBUST)])
def test_template_with_a_negated_weight_fails_its_check(name: str, hasty_simulator: Any) -> None:
    template = library.get_template(name)
    for part, index, broken in altered(template, -1.0):
        passes = error_of(broken, hasty_simulator) <= form_of(template).tolerance
        assert passes == ((name, part, index) in EQUIVALENT), (part, index)


@pytest.mark.parametrize("name", ANALOG)
def test_analog_template_with_a_weight_off_by_5_percent_fails(
    name: str, hasty_simulator: Any
) -> None:
    template = library.get_template(name)
    for part, index, broken in altered(template, 1.05):
        passes = error_of(broken, hasty_simulator) <= form_of(template).tolerance
        assert passes == ((name, part, index) in EQUIVALENT), (part, index)


@pytest.mark.parametrize("name", ["HOLE", "RECALL", "CCD_HOR", "CCD_VERT"])
def test_boundary_zero_of_the_original_headers_gives_wrong_cells(
    name: str, hasty_simulator: Any
) -> None:
    gray_rim = changed(library.get_template(name), boundary=0.0)
    assert error_of(gray_rim, hasty_simulator, shape=(12, 12)) > 0.5


def test_every_closed_form_serves_some_template() -> None:
    used = {form_of(library.get_template(name)).name for name in NAMES}
    assert used == set(closed_form_names())


def altered(template: Template, factor: float) -> Iterator[tuple[str, tuple[int, ...], Template]]:
    """Yield the template with each number that is not 0 multiplied by the factor, one at a time."""
    for part in ("A", "B", "z"):
        for index, wrong in scaled(getattr(template, part), factor):
            yield part, index, changed(template, **{part: wrong})
    for n, coupling in enumerate(template.nonlinear):
        for index, wrong in scaled(coupling.weights, factor):
            yield f"weights {n}", index, with_nonlinear(template, n, weights=wrong)
        for index, wrong in scaled(heights(coupling.function), factor):
            function = with_heights(coupling.function, wrong)
            yield f"table {n}", index, with_nonlinear(template, n, function=function)
    for n, gain in enumerate(template.gains):
        for index, wrong in scaled(heights(gain.table), factor):
            broken = replace(gain, table=with_heights(gain.table, wrong))
            yield f"gain {n}", index, changed(template, gains=[broken])
    if template.delayed is not None:
        for part in ("A", "B"):
            for index, wrong in scaled(getattr(template.delayed, part), factor):
                broken = replace(template.delayed, **{part: wrong})
                yield f"delayed {part}", index, changed(template, delayed=broken)


def scaled(weights: Floats, factor: float) -> Iterator[tuple[tuple[int, ...], Floats]]:
    for position in np.argwhere(weights):
        index = tuple(int(n) for n in position)
        wrong = weights.copy()
        wrong[index] *= factor
        yield index, wrong


def heights(table: Table) -> Floats:
    return np.array([value for _, value in table.points])


def with_heights(table: Table, values: Floats) -> Table:
    places = [place for place, _ in table.points]
    return Table(table.interpolation, tuple(zip(places, values.tolist(), strict=True)))


def with_nonlinear(template: Template, n: int, **parts: Any) -> Template:
    couplings = list(template.nonlinear)
    couplings[n] = replace(couplings[n], **parts)
    return changed(template, nonlinear=couplings)


def changed(template: Template, **parts: Any) -> Template:
    same = ("A", "z", "tau", "boundary", "input_boundary", "initial", "duration", "output")
    kept = {part: getattr(template, part) for part in same}
    kept |= {part: getattr(template, part) for part in ("nonlinear", "delayed", "gains", "check")}
    kept["B"] = template.B if template.inputs else None
    return Template(template.name, **{**kept, **parts})


def error_of(template: Template, simulator: Any, shape: tuple[int, int] = (8, 8)) -> float:
    form = form_of(template)
    case = form.cases(template, np.random.default_rng(1), shape)
    with np.errstate(over="ignore", invalid="ignore"):  # a broken linear template may diverge
        given = {field.name: getattr(case, field.name) for field in fields(case)}
        run = simulator.run(template, **given)
        error = np.abs(getattr(run, form.compares) - form.expected(template, case)).max()
    return float(error) if np.isfinite(error) else np.inf
