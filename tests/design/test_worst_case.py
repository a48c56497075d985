"""The worst case of a template is a bound, and no smaller one is."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from single_cells import EVERY, Cell, is_right

from cnnum import Engine, get_template
from cnnum.design.worst_case import state_after, worst_case
from cnnum.templating.checks.records import Case
from cnnum.templating.checks.registry import form_of
from cnnum.templating.checks.robustness import Judge
from cnnum.templating.checks.rules import narrow_neighbourhoods
from cnnum.templating.library import template_names
from cnnum.templating.numbers import with_numbers
from cnnum.templating.template import Check, Template

STATES = {"logic": (-1.0, 1.0)}


@cache
def bounds():
    every = ((name, worst_case(get_template(name))) for name in template_names())
    return {name: found for name, found in every if found is not None}


def cell_of(template):
    b = np.zeros((3, 3))
    if template.inputs:
        off = 1 - template.B.shape[-1] // 2
        b[off : 3 - off, off : 3 - off] = template.B[0, 0]
    middle = template.A.shape[-1] // 2
    time = np.inf if template.duration == "settle" else template.duration
    own = float(template.A[0, 0, middle, middle])
    return Cell(own, b.ravel(), float(template.z[0]), template.initial, time)


def decided(template):
    """Yield the right colours of all neighbourhoods, and the states before where those are given.

    Neighbourhoods that the check avoids are left out by a colour of NaN.
    """
    form = form_of(template)
    pictures = EVERY.reshape(-1, 3, 3)
    plain = replace(template, boundary=-1.0, input_boundary=-1.0)
    for state in STATES.get(form.name, (None,)):
        before = None if state is None else np.full(512, state)
        states = None if state is None else np.full(pictures.shape, state)
        colour = form.expected(plain, Case(input=pictures, state=states))[:, 1, 1]
        if template.name == "MATCNN_EDGE":
            black = EVERY > 0
            colour = np.where(black[:, 4] & (black.sum(axis=1) == 6), np.nan, colour)
        yield colour, before


def threshold_cells(template):
    level = dict(template.check.parameters)["threshold"]
    return np.array([level - 0.05, level + 0.05])


def test_most_of_the_uncoupled_templates_have_a_bound():
    assert len(bounds()) > 90
    assert {"EDGE", "LOGAND", "THRES", "MULLER", "DIAG", "MATCH"} <= bounds().keys()
    for name in ("HOLE", "AVERAGE", "DIFFUS", "SHADOW", "HORLINE", "LIFE", "MAXLOC"):
        assert worst_case(get_template(name)) is None


def test_no_mismatch_below_the_worst_case_breaks_a_template_and_the_named_one_does():
    for name in bounds():
        if name not in ("MULLER", "DIAG"):
            broken_where_it_says(name)


def broken_where_it_says(name):
    """Try random mismatch, its corners, and the optimum of each neighbourhood by itself."""
    template, found, rng = get_template(name), bounds()[name], np.random.default_rng(7)
    cell, share = cell_of(template), found.share
    if form_of(template).name == "threshold":
        colour, start = np.array([-1.0, 1.0]), threshold_cells(template)

        def wrong(a, z):
            own, drive = cell.a * (1.0 + a), cell.z * (1.0 + z)
            return not is_right(own, drive, start, cell.time, colour).all()

        assert not any(wrong(*rng.uniform(-share, share, 2)) for _ in range(300)), name
        named = 1.001 * share * found.changes["A"].sum(), 1.001 * share * found.changes["z"][0]
        assert wrong(*named), name
        return
    named = np.zeros((3, 3))
    off = 1 - template.B.shape[-1] // 2
    named[off : 3 - off, off : 3 - off] = found.changes["B"][0, 0]
    broken, exact = False, []
    for colour, before in decided(template):
        known = np.isfinite(colour)
        colour = np.where(known, colour, 1.0)

        def wrong(a, b, z, colour=colour, before=before, known=known):
            return not (cell.right(colour, before, a, b, z) | ~known).all()

        for n in range(60):
            inside = rng.uniform(-share, share, 11)
            if n % 2:
                inside = 0.9999 * share * np.sign(inside)  # the corners are where it is narrow
            assert not wrong(inside[9], inside[:9], inside[10]), name
        changes = 1.001 * share
        own, bias = (changes * found.changes[part].sum() for part in ("A", "z"))
        broken |= wrong(own, changes * named.ravel(), bias)
        if known.all():
            exact.append(cell.narrowest(colour, before))
    assert broken, (name, found.words)
    if exact:  # the optimum of each neighbourhood by itself, the own feedback on a grid
        assert share == pytest.approx(min(exact), rel=1e-6), name


@pytest.mark.parametrize("name", ["MULLER", "DIAG"])
def test_the_worst_case_of_five_by_five_cells_is_no_larger_than_any_neighbourhood_says(name):
    """Of 33 million neighbourhoods 400,000 are drawn, near the decision and far from it."""
    template, found, rng = get_template(name), bounds()[name], np.random.default_rng(3)
    black = rng.random((400_000, 5, 5)) < rng.random((400_000, 1, 1))
    if name == "DIAG":
        words = ["ooo+#", "oo##+", "o###o", "+##oo", "#+ooo"]
        weight = np.array([[0.5 if s in "+-" else 1.0 for s in row] for row in words])
        wanted = np.array([[s in "#+" for s in row] for row in words])
        black ^= (rng.random(black.shape) < 0.3) ^ (black ^ wanted)
        differ = (weight * (black != wanted)).sum(axis=(1, 2))
        own = black[:, 2, 2]
        colour = (own & (differ < 7.4)) | (~own & (differ < 2.4))
        free = (differ == 7.5) | (~own & (differ == 2.5))
    else:
        count, own = black.sum(axis=(1, 2)) - black[:, 2, 2], black[:, 2, 2]
        colour, free = own & (count <= 5), own & (count == 6)
    middle = template.A.shape[-1] // 2
    a, signs = template.A[0, 0, middle, middle], np.where(black, 1.0, -1.0)[~free]
    right = np.where(colour, 1.0, -1.0)[~free]

    def all_right(share, way, worst):
        kernel = template.B[0, 0] * (1.0 + share * worst) if worst is not None else template.B[0, 0]
        drive = (signs * kernel).sum(axis=(1, 2)) + template.z[0]
        if worst is None:
            drive = drive - right * share * (np.abs(template.B).sum() + abs(template.z[0]))
        own = a * (1.0 + way * share)
        return is_right(own, drive, signs[:, 2, 2], template.duration, right).all()

    assert all(all_right(0.999 * found.share, way, None) for way in (-1.0, 0.0, 1.0))
    assert not all(all_right(1.001 * found.share, way, None) for way in (-1.0, 1.0))


@pytest.mark.parametrize(
    "name", ["EDGE", "LOGAND", "RIGHTCON", "MATCNN_DILATION", "THRES", "MULLER"]
)
def test_an_engine_breaks_where_the_worst_case_says(name):
    """The check of the project itself calls the named mismatch wrong, and none of a little less."""
    template, found = get_template(name), bounds()[name]
    judge = Judge(template, Engine("reference" if name == "THRES" else "numba"))
    numbers = {"A": template.A, "z": template.z} | ({"B": template.B} if template.inputs else {})

    def off(share):
        parts = {k: v * (1.0 + share * found.changes[k]) for k, v in numbers.items()}
        return judge.wrong(with_numbers(template, parts))

    # a hundredth: the engine's own tolerance, and gray levels that no picture may have
    assert off(0.99 * found.share) == 0.0
    if name != "THRES":
        assert off(1.01 * found.share) > 0.0


def wide(rule, side=5, inputs=True):
    """Return a template whose cells are all white, with a rule of its neighbourhood."""
    b = np.full((side, side), 1e-3) if inputs else None
    check = Check("rule", (("rule", rule),))
    a = np.zeros((side, side))
    a[side // 2, side // 2] = 2.0
    return Template("own", a, b, -50.0, boundary=-1.0, duration=5.0, check=check)


def test_a_rule_that_is_tangled_for_one_colour_has_no_bound_from_the_other():
    """White cells are few inequalities, black ones 2¹² sets of them."""
    tangled = " and ".join(f"ring24 != {count}" for count in range(1, 13))
    assert worst_case(wide(tangled)) is None
    assert worst_case(wide("ring24 > 24")) is not None


def test_what_is_wider_than_the_language_or_sees_no_input_has_no_bound():
    seven = wide("ring24 > 24", side=7)
    assert worst_case(seven) is None
    assert narrow_neighbourhoods(seven, np.random.default_rng(1)).shape == (0, 5, 5)
    assert worst_case(wide("ring24 > 24", inputs=False)) is None


def test_the_signs_of_a_decision_are_those_of_the_inputs_that_it_sees():
    for name, found in bounds().items():
        side = get_template(name).B.shape[-1] if get_template(name).inputs else 0
        threshold = form_of(get_template(name)).name == "threshold"
        assert found.decision.signs.shape == ((0, 0) if threshold else (side, side)), name


def test_the_words_say_which_numbers_grow_in_size():
    """A weight of −1 that goes to −1.3 is larger in size, and was called "up"."""
    template, found = get_template("EDGE"), bounds()["EDGE"]
    changed = template.B * (1.0 + found.share * found.changes["B"])
    larger = np.argwhere(np.abs(changed[0, 0]) > np.abs(template.B[0, 0])).tolist()
    assert larger
    grown = found.words.split(" larger")[0] if "larger" in found.words else ""
    assert all(f"B{place}" in grown for place in larger), found.words


def test_the_examples_that_were_no_bounds():
    """Of LOGAND a third was said, and of EDGE 5.9 %: at rest, and without the own feedback's 1."""
    assert bounds()["LOGAND"].share < 0.25
    assert "A[1, 1]" in bounds()["LOGAND"].words
    assert bounds()["EDGE"].share < 0.99 / 17
    longer = worst_case(replace(get_template("EDGE"), duration=500.0))
    assert bounds()["EDGE"].share < longer.share < 0.99 / 17


def test_a_cell_moves_as_the_equation_says():
    from scipy.integrate import solve_ivp

    rng = np.random.default_rng(5)
    for _ in range(40):
        a, w, start = rng.uniform(-1, 3), rng.uniform(-3, 3), rng.uniform(-3, 3)
        time = rng.uniform(0.1, 6.0)
        exact = solve_ivp(
            lambda _, x, a=a, w=w: -x + a * np.clip(x, -1, 1) + w,
            (0.0, time), [start], rtol=1e-10, atol=1e-12, max_step=0.05,
        ).y[0, -1]  # fmt: skip
        # the solver steps across the corners of f: 1e-4 is the square of its largest step, and less
        assert state_after(a, w, start, time) == pytest.approx(exact, abs=1e-4, rel=1e-6)
    assert state_after(0.5, 1.0, 0.0, np.inf) == pytest.approx(1.5)
    assert state_after(2.0, 0.0, 0.0, np.inf) == 0.0
