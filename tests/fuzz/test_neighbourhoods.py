"""Random templates of single cells and random local rules: bounds hold, and checks see everything.

What is right comes from `single_cells`, and from a table of the 512 neighbourhoods: none of our own
code has a part in it.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import strategies as st
from single_cells import EVERY, as_rule, drawn

from cnnum.design.worst_case import worst_case
from cnnum.errors import TemplateError
from cnnum.templating.checks import run_check
from cnnum.templating.template import Check, Template

SEEDS = st.integers(0, 2**40)
BOUNDARIES = (-1.0, 1.0, "zero-flux", "periodic")


def compared(seed):
    """Compare the worst case of a random template, if it decides all neighbourhoods both ways."""
    rng = np.random.default_rng(seed)
    cell = drawn(rng)
    sums = EVERY @ cell.b + cell.z
    level = float(rng.choice([0.0, rng.uniform(-1.0, 1.0)]))
    colour = np.where(sums > level, 1.0, -1.0)
    if abs(colour.sum()) == 512 or np.abs(sums - level).min() < 1e-6:
        return False
    exact = cell.narrowest(colour)
    rule = as_rule(cell.b, level - cell.z)
    template = Template(
        "drawn", [[cell.a]], cell.b.reshape(3, 3), cell.z, initial=cell.start, duration=cell.time,
        boundary=float(rng.choice([-1.0, 1.0])), check=Check("rule", (("rule", rule),)),
    )  # fmt: skip
    found = worst_case(template)
    assert (found is None) == (exact is None), seed
    if found is None:
        return False
    assert found.share == pytest.approx(exact, rel=1e-6, abs=1e-9), seed
    shares = rng.uniform(-found.share, found.share, (40, 11))
    shares[::2] = 0.9999 * found.share * np.sign(shares[::2])
    assert all(cell.right(colour, None, s[9], s[:9], s[10]).all() for s in shares), seed
    if found.share < 1.0:
        over = 1.0001 * found.share + 1e-9
        named = (found.changes[k] * over for k in ("A", "B", "z"))
        a, b, z = (each.ravel() for each in named)
        assert not cell.right(colour, None, a[0], b, z[0]).all(), seed
    return True


def test_random_templates_break_where_their_worst_case_says(fuzz):
    assert sum(compared(seed) for seed in range(120)) > 8
    fuzz(SEEDS, compared, short=60)


class Answering:
    """An engine that looks every neighbourhood up in a table, at the rim as the boundary says."""

    name, precision = "table", "float64"

    def __init__(self, table, boundary, kind=None):
        self.table, self.boundary, self.kind, self.told = table, boundary, kind, 0

    def run(self, template, *, input, **others):
        rim = [(0, 0), (1, 1), (1, 1)]
        if isinstance(self.boundary, float):
            padded = np.pad(input, rim, constant_values=self.boundary)
        else:
            padded = np.pad(
                input, rim, mode={"zero-flux": "edge", "periodic": "wrap"}[self.boundary]
            )
        rows, cols = input.shape[-2:]
        code = sum(
            (padded[:, d : d + rows, e : e + cols] > 0).astype(int) << (3 * d + e)
            for d in range(3)
            for e in range(3)
        )
        answer = self.table[code]
        if self.kind is not None:  # one neighbourhood of one kind of place is answered wrong
            wrong, place = self.kind
            at = np.zeros(input.shape[-2:], dtype=bool)
            at[place] = True
            spoilt = at & (code == wrong)
            self.told += int(spoilt.sum())
            answer = np.where(spoilt, -answer, answer)
        return SimpleNamespace(output=answer, state=answer, method="table", reason="", time=0.0)


PLACES = {
    "inside": np.s_[1:-1, 1:-1],
    "north": np.s_[0, 1:-1],
    "south": np.s_[-1, 1:-1],
    "west": np.s_[1:-1, 0],
    "east": np.s_[1:-1, -1],
    "corner": np.s_[-1, 0],
}


def seen(seed):
    """One wrong neighbourhood of 512, at one kind of place, and the check of a rule fails."""
    rng = np.random.default_rng(seed)
    weights = rng.normal(size=9)
    level = float(rng.normal())
    table = np.where(EVERY @ weights > level, 1.0, -1.0)
    if abs(table.sum()) > 500 or np.abs(EVERY @ weights - level).min() < 1e-6:
        return
    boundary, place = BOUNDARIES[rng.integers(4)], list(PLACES)[rng.integers(len(PLACES))]
    rows, cols = rng.integers(4, 14, 2)
    check = Check("rule", (("rule", as_rule(weights, level)),))
    template = Template("t", [[0.0]], np.ones((3, 3)), boundary=boundary, check=check)
    options = {"seed": int(rng.integers(1000)), "shape": (int(rows), int(cols)), "repeats": 0}
    assert run_check(template, Answering(table, boundary), **options).passed
    # at a rim only what it can look like there: its own cells are drawn, the others follow
    picture = rng.random((int(rows), int(cols))) < 0.5
    engine = Answering(np.arange(512.0), boundary)
    codes = engine.run(None, input=np.where(picture, 1.0, -1.0)[np.newaxis]).output[0]
    wrong = int(rng.choice(codes[PLACES[place]].ravel()))
    if boundary == "periodic" and place != "inside":
        return  # what lies beyond a rim of a torus is the other rim: that is left to chance
    broken = Answering(table, boundary, (wrong, PLACES[place]))
    assert not run_check(template, broken, **options).passed, (place, wrong)
    assert broken.told


def test_every_neighbourhood_that_is_answered_wrong_fails_a_check(fuzz):
    fuzz(SEEDS, seen, short=40)


def one_colour(seed):
    """A rule that is never true, or always, is refused: a picture of one colour would pass."""
    rng = np.random.default_rng(seed)
    weights = rng.normal(size=9)
    beyond = float(np.abs(weights).sum() * rng.choice([-1.1, 1.1]))
    check = Check("rule", (("rule", as_rule(weights, beyond)),))
    template = Template("t", [[0.0]], np.ones((3, 3)), boundary=-1.0, check=check)
    table = np.full(512, -np.sign(beyond))
    with pytest.raises(TemplateError, match=r"every correct output is (black|white)"):
        run_check(template, Answering(table, -1.0), seed=seed % 1000, repeats=0)


def test_a_check_of_one_colour_is_refused(fuzz):
    fuzz(SEEDS, one_colour, short=10)
