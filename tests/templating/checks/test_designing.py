"""Figures for designers: stability, robustness, measured ones, the audit of boundaries."""

from dataclasses import replace

import numpy as np
import pytest

from cnnum import Engine, Template, get_template
from cnnum.errors import DeviceError, FrameError, MethodError, TemplateError
from cnnum.templating.batch import TemplateBatch
from cnnum.templating.checks import run_check
from cnnum.templating.checks.robustness import Judge, flips, tolerances
from cnnum.templating.checks.running import audit, measure, settle_times, shifted
from cnnum.templating.files import load_entry, write_measured
from cnnum.templating.library import get_entry, template_path
from cnnum.templating.numbers import numbers_of, with_numbers
from cnnum.templating.stability_class import stability_class


@pytest.fixture(scope="module")
def engine():
    return Engine("numba")


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("EROSION", "linear and stable"),
        ("THRES", "bistable cells"),
        ("EDGE", "monostable cells"),
        ("HOLE", "symmetric A"),
        ("SHADOW", "feed-forward"),
        ("LIFE", "unknown"),
        ("MEDIAN", "unknown"),
        ("HERRING", "unknown"),
        ("CCD_HOR", "unknown"),
    ],
)
def test_classes_of_stability(name, kind):
    assert stability_class(get_template(name)).name == kind


def test_positive_weights_that_are_not_symmetric_link_cells():
    template = Template("mine", A=[[0, 1, 0], [0.5, 2, 1], [0, 1, 0]], output="tanh")
    assert stability_class(template).name == "positive cell-linking"


@pytest.mark.parametrize("name", ["HOLE", "EDGE", "MATCNN_SKL1"])
def test_measured_figures_are_measured_again(engine, name):
    known, found = get_entry(name).measured, measure(get_template(name), engine)
    assert found.digest == known.digest
    assert found.mean == pytest.approx(known.mean, abs=1e-3)
    assert found.margin == pytest.approx(known.margin, rel=0.3)
    assert [n for n, _ in found.settle] == [8, 12, 16]
    assert not shifted(get_template(name), engine, known)


def test_a_margin_is_where_a_bias_flips_a_cell(engine):
    template = get_template("EDGE")  # the least drive of a cell is 1
    margin = measure(template, engine).margin
    assert 0.75 < margin < 1.0
    wrong = replace(get_entry("EDGE").measured, margin=4.0)
    assert "flips a cell" in shifted(template, engine, wrong)
    assert "flips no cell" in shifted(template, engine, replace(wrong, margin=0.3))
    assert "settles after" in shifted(
        template, engine, replace(wrong, margin=None, settle=((8, 90.0),))
    )


@pytest.mark.parametrize(("duration", "rests"), [(0.5, False), (3.0, True), (40.0, True)])
def test_settle_times_are_of_the_rest_and_not_of_the_end_of_a_run(engine, duration, rests):
    """x' = −x + u from 0 comes within 0.01 of u = ±1 after ln 100 = 4.61 time constants."""
    template = Template("copy", [[0.0]], [[1.0]], duration=duration, boundary="zero-flux")
    found = dict(settle_times(template, engine))
    assert (8 in found) == rests
    if rests:
        late = duration / 40  # the width of a part of the run
        assert np.log(100.0) - 0.2 < found[8] <= np.log(100.0) + 2 * late + 0.1


def test_a_settle_time_beyond_the_end_of_the_check_is_not_compared(engine):
    entry = get_entry("HLF3")
    assert dict(entry.measured.settle)[8] > 50.0
    other = replace(entry.measured, settle=((8, 9.0),))
    assert not shifted(entry.template, engine, other)


def test_every_weight_that_is_off_by_a_fifth_is_seen(engine):
    """The check of a robust decision alone lets most of them pass; the digest lets none."""
    entry, passed = get_entry("HOLE"), 0
    for n in range(entry.template.A.size):
        changed = entry.template.A.copy()
        changed.flat[n] *= 1.2
        if changed.flat[n]:
            template = replace(entry.template, A=changed)
            assert not run_check(template, engine, repeats=0, measured=entry.measured).passed
            passed += run_check(template, engine, repeats=0).passed
    assert passed > 2


def test_an_end_state_that_moved_is_seen(engine):
    entry = get_entry("HOLE")
    changed = replace(entry.template, A=1.2 * entry.template.A)
    known = replace(entry.measured, digest=changed.digest)
    found = run_check(changed, engine, repeats=0, measured=known)
    assert not found.passed
    assert "its states end at" in found.note


def test_robustness_falls_with_mismatch(engine):
    found = {one.change: one.flipped for one in flips(get_template("HOLE"), engine)}
    assert found["mismatch 1 %"] == 0.0
    assert found["8 bits"] == 0.0
    fragile = {one.change: one.flipped for one in flips(get_template("MULLER"), engine)}
    assert fragile["mismatch 10 %"] > 0.5


def test_each_weight_has_a_reach(engine):
    found = {one.weight: one for one in tolerances(get_template("THRES"), engine)}
    assert set(found) == {"A[1, 1]", "z"}
    assert found["z"].value == pytest.approx(-0.4)
    assert 0.0 < found["z"].up < 0.5  # gray values come within 0.05 of the threshold


def test_weights_of_nonlinear_and_delayed_couplings_have_a_reach(engine):
    """Eight neighbours add 0.5 each against a bias of -3.5: none of them may be missing."""
    found = {one.weight: one for one in tolerances(get_template("MAXLOC"), engine)}
    around = [(row, col) for row in range(3) for col in range(3) if (row, col) != (1, 1)]
    labels = [f"coupling 1[{row}, {col}]" for row, col in around]
    assert [name for name in found if name.startswith("coupling")] == labels
    assert all(0.0 < found[label].down < 1.0 for label in labels)
    assert found["table 1[1]"].value == 0.5


@pytest.mark.parametrize("name", ["MAXLOC", "HERRING", "FADING", "LIFE", "RETINA_3", "EDGE"])
def test_numbers_come_back_and_each_part_changes_the_template(name):
    template = get_template(name)
    numbers = numbers_of(template)
    assert with_numbers(template, numbers).digest == template.digest
    for part, array in numbers.items():
        changed = with_numbers(template, {part: 1.5 * array})
        assert (changed.digest == template.digest) == (not array.any()), part
    assert with_numbers(template, {}).digest == template.digest


def test_the_audit_finds_the_wrong_boundaries(engine):
    hole = audit(get_template("HOLE"), engine)
    assert hole.wrong[0] > 0
    assert hole.wrong[1] == 0
    assert hole.wrong[2] > 0
    assert audit(get_template("DIFFUS"), engine) is None


def test_figures_replace_those_of_before_and_nothing_else(tmp_path):
    path = tmp_path / "hole.toml"
    text = template_path("HOLE").read_text(encoding="utf-8").replace("z = ", "# mine\nz = ")
    path.write_text(text, encoding="utf-8")
    entry = load_entry(path)
    write_measured(path, replace(entry.measured, margin=0.25))
    again = path.read_text(encoding="utf-8")
    assert load_entry(path).measured.margin == 0.25
    assert again.count("[measured]") == 1
    assert "# mine" in again
    assert again.partition("[measured]")[0] == text.partition("[measured]")[0]


def test_a_wrong_table_of_figures_is_named(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('name = "mine"\nA = [[1.0]]\n[measured]\ndigest = "a"\nspeed = 1.0\n')
    with pytest.raises(TemplateError, match=r"^'[^']*mine\.toml': the table 'measured' must"):
        load_entry(path)


def test_states_that_are_not_numbers_are_no_figures(engine):
    assert np.isfinite(measure(get_template("LOGNOT"), engine).rms)


def test_only_what_diverges_counts_as_wrong():
    """A device that fails says nothing of a template: it was a flip of every cell."""

    class Fails:
        name, precision = "numba", "float64"

        def __init__(self, error):
            self.error = error

        def run(self, *_, **__):
            raise self.error

    edge = get_template("EDGE")
    assert Judge(edge, Fails(FrameError("not finite"))).wrong(edge) == 1.0
    with pytest.raises(DeviceError):
        Judge(edge, Fails(DeviceError("gone"))).wrong(edge)


def test_templates_that_no_method_runs_are_counted_apart():
    """They were flips of every cell."""
    engine = Engine("numba")

    class OneInThree:
        name, precision, calls = "numba", "float64", 0

        def run(self, template, **options):
            self.calls += 1
            if isinstance(template, TemplateBatch) or self.calls % 3 == 0:
                raise MethodError("its steps would be too short")
            return engine.run(template, **options)

    class Never(OneInThree):
        def run(self, template, **options):
            raise MethodError("its steps would be too short")

    edge = get_template("EDGE")
    (some,) = flips(edge, OneInThree(), mismatches=(0.01,), bits=(), draws=9)
    assert (some.flipped, some.draws, some.failed) == (0.0, 6, 3)
    assert some.reason == "its steps would be too short"
    (none,) = flips(edge, Never(), mismatches=(0.01,), bits=(), draws=4)
    assert np.isnan(none.flipped)
    assert (none.draws, none.failed) == (0, 4)
