"""Checks show every neighbourhood, and answers of both colours."""

from types import SimpleNamespace

import numpy as np
import pytest
from single_cells import EVERY, is_right

from cnnum import Engine, get_template
from cnnum.errors import TemplateError
from cnnum.templating.checks import form_of, run_check
from cnnum.templating.checks.registry import posed
from cnnum.templating.checks.robustness import flips
from cnnum.templating.checks.running import measure
from cnnum.templating.library import template_names
from cnnum.templating.template import Check, Template

LOCAL = {
    *("edge", "erosion", "dilation", "thinning", "hit-or-miss", "neighbour-count"),
    *("shift", "logic", "life-counts", "rule"),
}
WIDE = ("MULLER", "DIAG")
AVOIDING = {"MATCNN_EDGE": 56, "HORLINE": 128}
"""Neighbourhoods that no picture may show: `c and ring == 5`, and white between east and west."""


def windows(pictures):
    """Return the code of the nine cells around each inner cell."""
    black = (pictures > 0).astype(int)
    rows, cols = black.shape[-2:]
    parts = [
        black[:, d : d + rows - 2, e : e + cols - 2] << (3 * d + e)
        for d in range(3)
        for e in range(3)
    ]
    return sum(parts)


def test_the_checks_of_local_rules_show_all_512_neighbourhoods():
    """Twelve random pictures showed 205 of them, and no answer of MATCH was black."""
    tried = 0
    for name in template_names():
        template = get_template(name)
        if form_of(template).name not in LOCAL or name in WIDE:
            continue
        tried += 1
        case, expected = posed(template, 0, (8, 8))
        found = set(np.unique(windows(case.pictures)).tolist())
        if name in AVOIDING:
            # those that force a neighbour into an avoided one cannot be shown either
            assert len(found) >= 512 - 2 * AVOIDING[name], (name, len(found))
        else:
            assert len(found) == 512, (name, len(found))
            strips = case.pictures[:, :2], case.pictures[:, -2:]
            for strip in (*strips, case.pictures[..., :2], case.pictures[..., -2:]):
                line = strip if strip.shape[-1] > 2 else strip.swapaxes(-1, -2)
                codes = windows(np.pad(line, [(0, 0), (0, 1), (0, 0)]))[:, 0]
                assert len(np.unique(codes)) == 64, name
        assert (expected > 0).any(), name
        assert (expected < 0).any(), name
    assert tried > 90


class One:
    """An engine whose every cell is of one colour."""

    name, precision = "one colour", "float64"

    def __init__(self, colour):
        self.colour = colour

    def run(self, template, **given):
        maps = given["input"] if given["input"] is not None else given["state"]
        shape = maps.shape
        if template.layers > 1:
            shape = (len(maps), template.layers, *maps.shape[-2:])
        output = np.full(shape, self.colour)
        return SimpleNamespace(output=output, state=output, method="", reason="", time=0.0)


@pytest.mark.parametrize("colour", [-1.0, 1.0])
def test_a_template_of_one_colour_passes_no_check_of_black_and_white(colour):
    for name in template_names():
        template = get_template(name)
        if form_of(template).digital:
            assert not run_check(template, One(colour), repeats=0).passed, name


@pytest.mark.one_in(3)
@pytest.mark.parametrize("seed", range(1, 7))
def test_no_check_of_the_library_is_of_one_colour(seed):
    for name in template_names():
        template = get_template(name)
        if form_of(template).digital:
            expected = posed(template, seed, (8, 8))[1]
            assert -1.0 < np.sign(expected).mean() < 1.0, name


def test_a_check_whose_answers_have_one_colour_is_refused():
    template = Template(
        "never", [[1.0]], [[1.0]], -9.0, boundary=-1.0,
        check=Check("rule", (("rule", "ring > 8"),)),
    )  # fmt: skip
    with pytest.raises(TemplateError, match="every correct output is white, expected both colours"):
        run_check(template, Engine("numba"), repeats=0)
    with pytest.raises(TemplateError, match="on 1×3 cells"):
        run_check(get_template("MATCH"), Engine("numba"), shape=(1, 3), repeats=0)


def test_the_margin_of_match_is_that_of_its_narrowest_neighbourhood():
    """1.27 was said on pictures without an answer in black; a cell decides with 0.5."""
    margin = measure(get_template("MATCH"), Engine("numba")).margin
    # after ten time constants of x' = w, half a colour takes another 0.05
    assert margin == pytest.approx(0.45, rel=0.02)


@pytest.mark.parametrize(("name", "width"), [("MATCH", 0.05), ("MATCH", 0.1), ("JUNCTION", 0.05)])
def test_flips_are_those_of_all_neighbourhoods(name, width):
    """As often as NumPy alone flips one of 512 cells with 4,000 draws of the mismatch."""
    template, rng, draws = get_template(name), np.random.default_rng(11), 600
    (found,) = flips(template, Engine("numba"), mismatches=(width,), bits=(), draws=draws)
    a, b, z = template.A[0, 0, 1, 1], template.B[0, 0].ravel(), template.z[0]
    colour = np.where(EVERY @ b + z > 0.0, 1.0, -1.0)
    many = 1.0 + width * rng.normal(size=(4_000, 11))
    drives = (b * many[:, :9]) @ EVERY.T + z * many[:, 10:]
    right = is_right(a * many[:, 9:10], drives, 0.0, template.duration, colour)
    rate = 1.0 - float(right.all(axis=1).mean())
    # four standard deviations of both samples
    assert found.flipped == pytest.approx(rate, abs=4.0 * (0.25 / draws + 0.25 / 4_000) ** 0.5)
    assert rate > 0.05
