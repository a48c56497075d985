"""Searches: weights from a start that knows none, with no more flips than the published ones."""

import signal
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from cnnum import Template, get_template
from cnnum.cli.root import main
from cnnum.design.designing import designed, load_spec
from cnnum.design.search import Search, compared, groups_of, search, with_weights
from cnnum.errors import TemplateError
from cnnum.templating.checks import run_check
from cnnum.templating.files import load_entry

pytest.importorskip("cma", reason="the extra 'search' is not installed")


@pytest.mark.one_in(2)
@pytest.mark.parametrize("name", ["CCD_HOR", "PATCHMAK"])
def test_a_search_finds_weights_that_flip_no_more_often(opencl, name):
    form = get_template(name)
    found = search(Search(form, restarts=1), opencl)
    assert run_check(found.template, opencl, repeats=1).passed
    published, ours = compared(form, found.template, opencl, mismatch=0.05, draws=200)
    assert ours <= published


def test_a_search_is_the_same_again(opencl):
    wanted = Search(get_template("CCD_HOR"), generations=2, restarts=1, draws=3)
    first, second = search(wanted, opencl), search(wanted, opencl)
    assert first.template.digest == second.template.digest
    stopped = search(replace(wanted, generations=1000), opencl, lambda advance: advance.done < 2)
    assert stopped == second


def test_a_form_gives_pattern_and_ties_and_no_number():
    form = get_template("HOLE")
    groups = groups_of(form)
    assert [(part, len(places)) for part, places in groups] == [
        ("A", 4), ("A", 1), ("B", 1), ("z", 1),
    ]  # fmt: skip
    made = with_weights(form, groups, np.array([0.5, 2.0, 3.0, 4.0]))
    assert made.A[0, 0].tolist() == [[0.0, 0.5, 0.0], [0.5, 2.0, 0.5], [0.0, 0.5, 0.0]]
    assert made.B[0, 0, 1, 1] == 3.0
    assert made.z.tolist() == [4.0]


def test_a_specification_can_ask_for_a_search(tmp_path, opencl):
    path = tmp_path / "s.toml"
    path.write_text(
        'name = "MINE"\n[design]\ndraws = 20\n[search]\nlike = "CCD_HOR"\ngenerations = 3\n'
        "restarts = 1\ndraws = 3\n"
    )
    (one,) = designed(load_spec(path), opencl)
    assert one.entry.proof.method == "search"
    assert one.entry.template.name == "MINE"
    path.write_text('name = "MINE"\n[search]\nseed = 3\n')
    with pytest.raises(TemplateError, match=r"search\.like"):
        load_spec(path)


def test_a_form_may_have_layers_and_nonlinear_couplings(opencl):
    form = get_template("MAXLOC")
    parts = {part for part, _ in groups_of(form)}
    assert {"A", "coupling 1"} <= parts
    found = search(Search(form, generations=1, restarts=2, population=4, draws=2), opencl)
    assert found.evaluations == 2 * 4 * 3
    assert found.template.digest != form.digest


def test_ctrl_c_keeps_the_best_template_so_far(tmp_path, monkeypatch):
    """A signal in the third step; the file then holds a template with its own proof."""
    steps = []

    def advance(_, note=""):
        steps.append(note)
        if len(steps) == 3:
            signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr("cnnum.cli.output.Steps.advance", advance)
    path, form = tmp_path / "s.toml", get_template("EDGE")
    path.write_text(
        'name = "MINE"\n[design]\ndraws = 2\n[learn]\nlike = "EDGE"\nrestarts = 10000\n'
    )
    words = ["templates", "design", str(path), "--output", str(tmp_path / "made")]
    ran = CliRunner().invoke(main, words)
    assert ran.exit_code == 130, ran.output
    assert f"Stopped at {steps[2]}: the best template so far is written." in ran.output
    assert len(steps) == 3
    errors = [float(note.split()[-1]) for note in steps]
    assert errors[0] >= errors[1] >= errors[2]
    kept = load_entry(tmp_path / "made" / "mine.toml")
    assert kept.proof is not None
    assert kept.template.check == form.check
    assert kept.template.digest != form.digest


def test_a_form_without_weights_is_refused(opencl):
    with pytest.raises(TemplateError, match="form with weights"):
        search(Search(Template("none", [[0.0]], check=get_template("HOLE").check)), opencl)
