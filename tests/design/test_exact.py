"""Exact design: weights of the largest relative margin, refusals with a proof, sequences."""

import importlib.util
import itertools
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from single_cells import EVERY, Cell

from cnnum import Engine, get_template
from cnnum.design.designing import Spec, answers, as_rule, designed, load_spec, sequence
from cnnum.design.found_again import again, found_again
from cnnum.design.linear_program import Conflict, Shape, Weights, as_template, design, separate
from cnnum.design.local_rules import rule_table, table_of
from cnnum.design.search import Advance
from cnnum.design.worst_case import worst_case
from cnnum.errors import TemplateError
from cnnum.templating.batch import TemplateBatch
from cnnum.templating.checks import run_check
from cnnum.templating.checks.robustness import wilson
from cnnum.templating.files import load_entry, save_entry

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def library():
    return list(found_again())


def test_the_library_is_found_again_with_no_smaller_margin(library):
    assert len(library) >= 20
    for one in library:
        # a few roundings of sums of at most nineteen weights
        assert one.weights.relative >= one.published_relative - 1e-12, one.name
        assert one.margin >= one.published_margin * (1.0 - 1e-12), one.name
        assert one.weights.exact, one.name


def test_margins_are_certified_by_multipliers(library):
    for one in library:
        assert one.weights.relative == pytest.approx(one.weights.bound, rel=1e-9), one.name


def test_the_page_is_what_the_code_finds(library):
    path = DOCS / "figures" / "design_table.py"
    spec = importlib.util.spec_from_file_location("design_table", path)
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    counts = made.summary(library)
    words = " ".join((DOCS / "how-to" / "design.md").read_text().split())
    assert f"For {len(library)} uncoupled templates of the library" in words
    margins = "for {larger} templates, equal for {equal} and smaller for {smaller}."
    worst = "The error tolerated in the worst case is larger for {safer} of the "
    assert f"{margins} {worst}".format(**counts) in words


@pytest.mark.parametrize("engine", ["numba", "reference"])
def test_what_is_found_again_passes_the_check_of_the_library(library, engine):
    used = Engine(engine)
    for one in library[:: 2 if engine == "numba" else 31]:
        assert run_check(one.template, used, repeats=1).passed, one.name


def test_designed_weights_know_nothing_of_the_published_ones():
    published = get_template("CORNER")
    scrambled = type(published)("CORNER", [[9.0]], [[3.0]], 7.0, check=published.check)
    assert again(published, table_of(published)).weights.values.tolist() == (
        separate(table_of(scrambled)).values.tolist()
    )


@pytest.mark.one_in(2)
@pytest.mark.parametrize("name", ["PATCHMAK", "SHADMASK", "ERASMASK", "FINDAREA", "CONCHOLL"])
def test_coupled_monotonic_templates_pass_the_check_of_the_library(name):
    published = get_template(name)
    table = table_of(published)
    shape = Shape(name, "", published.boundary.name, published.initial, 1.0, published.check)
    template, weights = design(table, shape)
    middle = template.A[0, 0].copy()
    middle[1, 1] = 0.0
    assert (middle >= 0.0).all()
    assert weights.exact
    assert run_check(template, Engine("numba"), repeats=1).passed


def test_a_refusal_is_a_proof():
    found = separate(rule_table("w != e"))
    assert isinstance(found, Conflict)
    shares = [Fraction(float(s)).limit_denominator(1000) for s in found.shares]
    rows = [[*map(int, row), 1] for row in found.signs]
    assert sum(shares) == 1
    for column in range(len(rows[0])):
        total = sum(
            s * int(c) * r[column] for s, c, r in zip(shares, found.colours, rows, strict=True)
        )
        assert total == 0


@pytest.mark.parametrize(
    ("rule", "most"),
    [("w != e", 2), ("ring == 3", 2), ("(ring + c) != 5", 2), ("n and s or e and w", 3)],
)
def test_a_sequence_does_what_no_template_does(rule, most):
    table = rule_table(rule)
    steps = sequence(table)
    assert 1 < len(steps) <= most
    assert np.array_equal(answers(steps, table), table.colours)


def test_a_sequence_runs_as_life(tmp_path):
    rule = "c and ring >= 2 and ring <= 3 or not c and ring == 3"
    engine = Engine("numba")
    first, second = designed(Spec("LIFE", rule=rule, split=True, draws=2), engine)
    pictures = np.array(list(itertools.product((-1.0, 1.0), repeat=9))).reshape(-1, 3, 3)
    before = engine.run(first.entry.template, input=pictures).output
    output = engine.run(second.entry.template, input=pictures, state=before).output
    count = (pictures > 0).sum(axis=(1, 2))
    own = pictures[:, 1, 1] > 0
    alive = (count == 3) | (own & (count == 4))
    assert np.array_equal(output[:, 1, 1] > 0, alive)


def test_settle_time_is_the_longest_of_a_cell():
    table = rule_table("c and before")
    weights = separate(table)
    template = as_template(weights, Shape("AND", initial=-1.0))
    engine = Engine("numba")
    proof = designed(Spec("AND", rule="c and before", draws=1), engine)[0].entry.proof
    states = np.array([-1.0, 1.0, -1.0, 1.0]).reshape(4, 1, 1)
    pictures = np.array([-1.0, -1.0, 1.0, 1.0]).reshape(4, 1, 1)

    def at(time):
        return engine.run(template, input=pictures, state=states, duration=time).output.ravel()

    expected = [-1.0, -1.0, -1.0, 1.0]
    # rtol of a run is 1e-4
    assert at(1.001 * proof.settle) == pytest.approx(expected, abs=1e-3)
    assert np.abs(at(0.95 * proof.settle) - expected).max() > 0.05


def test_a_rule_of_weights_says_the_same():
    for rule in ("c and ring <= 3", "c and before or n", "not c and (e or s)"):
        table = rule_table(rule)
        other = rule_table(as_rule(separate(table)))
        assert other.seen == table.seen
        assert np.array_equal(other.colours, table.colours)


def test_no_mismatch_below_the_relative_margin_flips_a_configuration():
    table = rule_table("c and ring <= 3")
    weights = separate(table)
    numbers = np.append(weights.values, weights.bias)
    rows = np.column_stack([table.signs, np.ones(len(table.signs))])
    for k, row in enumerate(rows):
        # the worst signs of the errors for this configuration
        worst = -table.colours[k] * np.sign(row * numbers)
        for share, right in ((0.999, True), (1.001, False)):
            moved = numbers * (1.0 + share * weights.relative * worst)
            least = table.colours[k] * float(row @ moved)
            assert least > 0.0 or not right
            if not right and np.isclose(table.colours[k] * (row @ numbers), 1.0):
                assert least < 0.0


@pytest.mark.one_in(3)
@pytest.mark.parametrize("name", ["CORNER", "EDGE", "CONCEROS", "MATCNN_EDGE"])
def test_the_worst_case_of_a_template_is_that_of_its_runs(name):
    """Every neighbourhood of 3×3 cells has the errors that are worst for it, in a lane of its own.

    The signs of B and z are those of the products with the inputs. The own feedback is off both
    ways: twice as many lanes. A hundredth of the share is room for the engine's own errors.
    """
    template, share = get_template(name), worst_case(get_template(name)).share
    inputs = np.array(list(itertools.product((-1.0, 1.0), repeat=9))).reshape(-1, 3, 3)
    right = np.sign(Engine("numba").run(template, input=inputs).output[:, 1, 1])
    if name == "MATCNN_EDGE":  # its check avoids black cells with five black neighbours
        free = ~((inputs[:, 1, 1] > 0) & ((inputs > 0).sum(axis=(1, 2)) == 6))
        inputs, right = inputs[free], right[free]
    colour, lanes = right[:, np.newaxis, np.newaxis], len(right)
    for factor, flips in ((0.99, False), (1.01, True)):
        off = factor * share * np.sign(inputs * template.B[0, 0]) * -colour
        B = template.B * (1.0 + off)[:, np.newaxis, np.newaxis]
        z = template.z * (1.0 - factor * share * np.sign(template.z) * right[:, np.newaxis])
        wrong = False
        for way in (-1.0, 1.0):
            A = np.stack([template.A * (1.0 + way * factor * share)] * lanes)
            batch = TemplateBatch(template, A=A, B=B, z=z)
            found = Engine("numba").run(batch, input=inputs).output[:, 1, 1]
            wrong |= bool((np.abs(found - right) > 0.5).any())
        assert wrong == flips


@pytest.mark.parametrize(
    ("rule", "margin"),
    [("c and ring <= 3", 1.0), ("before and not c", 0.3), ("n or e", 4.0), ("ring >= 4", 1.0)],
)
def test_the_worst_case_of_a_proof_holds_at_the_duration_of_the_design(tmp_path, rule, margin):
    """Each number varies by itself, and a cell in time is judged: not a weighted sum."""
    (one,) = designed(Spec("MINE", rule=rule, margin=margin, draws=1), Engine("numba"))
    template, path = one.entry.template, tmp_path / "mine.toml"
    save_entry(one.entry, path)
    proof = load_entry(path).proof
    kernel = np.zeros((3, 3)) if not template.inputs else template.B[0, 0]
    cell = Cell(
        float(template.A[0, 0, 1, 1]), kernel.ravel(), float(template.z[0]), template.initial,
        float(template.duration),
    )  # fmt: skip
    ring = (EVERY > 0).sum(axis=1) - (EVERY[:, 4] > 0)
    own, north, east = (EVERY[:, k] > 0 for k in (4, 1, 5))
    exact = []
    for state in (-1.0, 1.0):
        before = np.full(512, state) if "before" in rule else None
        black = {
            "c and ring <= 3": own & (ring <= 3),
            "before and not c": (state > 0) & ~own,
            "n or e": north | east,
            "ring >= 4": ring >= 4,
        }[rule]
        exact.append(cell.narrowest(np.where(black, 1.0, -1.0), before))
    assert proof.worst_case == pytest.approx(min(exact), rel=1e-6)
    assert proof.worst_case <= min(exact) * (1.0 + 1e-9)
    assert "[1, 1]" in proof.worst_case_weights


def test_examples_become_a_template(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(
        'name = "MINE"\n[design]\ndraws = 2\nmismatch = 0.02\n[[example]]\n'
        'input = ["ooooo", "o###o", "o###o", "o###o", "ooooo"]\n'
        'output = ["ooooo", "o#o#o", "ooooo", "o#o#o", "ooooo"]\n'
    )
    spec = load_spec(path)
    (one,) = designed(spec, Engine("numba"))
    picture, _, output = spec.examples[0]
    assert np.array_equal(Engine("numba").run(one.entry.template, input=picture).output, output)
    save_entry(one.entry, tmp_path / "out.toml")
    assert load_entry(tmp_path / "out.toml").proof.relative_margin == pytest.approx(
        one.entry.proof.relative_margin
    )


@pytest.mark.parametrize(
    ("rule", "size"),
    [
        # sums of −1 a neighbour, with the numbers of the cell and z from both of their fences:
        # own + z = −13 between 5 and 6 black ones, and z − own = −25 where the cell is white
        ("c and ring24 <= 5", 24 + 6 + 19),
        # of 2²⁵ neighbourhoods one is black: 24 + 23 numbers of 1, none drawn by chance
        ('match("#####/#####/##.##/#####/#####")', 24 + 23),
    ],
)
def test_rules_of_5_by_5_cells_have_the_margin_of_a_sum_by_hand(rule: str, size: int) -> None:
    seen = list[Advance]()
    spec = Spec("WIDE", rule=rule, draws=1, mismatch=(0.005,))
    (made,) = designed(spec, Engine("numba"), lambda advance: not seen.append(advance))
    proof = made.entry.proof
    assert proof is not None
    assert proof.relative_margin == pytest.approx(1.0 / size, rel=1e-9)
    assert proof.bound == pytest.approx(1.0 / size, rel=1e-6)  # no weights have more
    assert proof.flips[0].rate == 0.0
    assert all(advance.best < 1.0 for advance in seen)  # what was drawn did not decide
    assert made.entry.template.radius == 2


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('name = "A"\n[design]\n', "needs either a rule or examples"),
        ('name = "A"\n[design]\nrule = "c or not c"\n', "one colour for all"),
        ('name = "A"\n[design]\nuntil = "still"\nrule = "ring24 > 3"\n', "5×5"),
        ('name = "A"\n[design]\nrule = "ring24 * ring > 3"\n', "a few comparisons of sums"),
        ('name = "A"\n[design]\nrule = "ring24 == 3"\n', "a sequence of rules that are"),
        (
            'name = "A"\n[design]\nrule = "w != e"\n',
            "No single template computes 'A': 2 black and 2",
        ),
        ('name = "A"\n[design]\nrule = "c"\nuntil = "now"\n', "'once' or 'still'"),
        ('name = "A"\n[design]\nrul = "c"\n', "unknown key 'rul'"),
        (
            'name = "A"\n[[example]]\ninput = ["#o", "oo"]\noutput = ["##", "oo"]\n'
            '[[example]]\ninput = ["#o", "oo"]\noutput = ["oo", "oo"]\n',
            "black in one example and white in another",
        ),
    ],
)
def test_what_cannot_be_designed_is_said(tmp_path, text, words):
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    with pytest.raises(TemplateError, match=words):
        designed(load_spec(path), Engine("numba"))


def test_intervals_hold_the_share_as_often_as_they_say():
    rng = np.random.default_rng(1)
    for share in (0.02, 0.3):
        hits = rng.binomial(60, share, 2000)
        inside = [low <= share <= high for low, high in (wilson(int(h), 60) for h in hits)]
        # Wilson's interval holds 93 to 98 % at these numbers, not 95 % to the digit
        assert 0.92 < np.mean(inside) < 0.99


def test_weights_are_plain():
    weights = separate(rule_table("c and ring <= 3"))
    assert isinstance(weights, Weights)
    assert weights.of("u") == 4.0
    assert weights.of("u", -1, 0) == -1.0
    assert weights.bias == -4.0 or weights.bias == -5.0
