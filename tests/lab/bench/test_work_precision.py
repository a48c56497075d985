"""Error against run time: the runs, their truths, and the rows of a quick round."""

import numpy as np
import pytest

import cnnum
from cnnum.engine import Engine
from cnnum.errors import CnnumError
from cnnum.lab.bench import work_precision as bench
from cnnum.lab.bench.programs import program_rungs
from cnnum.programs.library import program_names
from cnnum.report import work_precision as report
from cnnum.report.work_precision import Rung
from cnnum.templating.checks import form_of
from cnnum.templating.library import get_template

DELAYS = ("DELAYED_DIFFUSION", "ECHO")
FIELDS = ("AUTOWAVE", *DELAYS, "D_ANISO", "INTERP", "FADING", "OSCILLATOR")
EXACT = tuple(
    template.name for template in bench.wave_templates() if template.check.name in report.EXACT
)


def test_every_template_whose_answer_is_a_field_is_run():
    assert set(FIELDS) <= set(bench.cases())
    assert set(program_names("tactile")) <= set(bench.cases())
    assert any("DELAYED_WAVE" in text for text in bench.omissions(bench.cases()))


def climbed(name, *rungs, engine="numba", batch=4):
    engines = [Engine(engine, precision="float64")]
    return list(
        report.climb_ladder(
            get_template(name), engines, ladder=rungs, batch=batch, repeats=2, budget=0.01
        )
    )


@pytest.mark.parametrize("name", FIELDS)
def test_the_error_of_a_field_falls_with_the_step(name):
    """Euler's falls as its step; one that the truth were no truth for would stay."""
    steps = (0.01, 0.0025) if name == "INTERP" else (0.02, 0.005)
    coarse, fine = climbed(name, *(Rung("euler", dt=dt) for dt in steps))
    if name == "INTERP":  # a run that settles ends where its rates are small, whatever its step
        assert coarse.error < 1e-3 > fine.error
    else:
        # a quarter: 4 for a first order; kinks of the output take some of it, or add to it
        assert 3.0 < coarse.error / fine.error < 5.5
    assert coarse.pictures >= 4


@pytest.mark.one_in(4)
@pytest.mark.parametrize("name", EXACT)
def test_closed_forms_and_the_reference_engine_give_the_same_truth(name):
    """Two ways to one answer; the reference engine at a tolerance that it meets in a second."""
    template = get_template(name)
    case = form_of(template).cases(template, np.random.default_rng(0), (4, 5))
    truth = report._truth(template, case, 2)
    # ends of a run that settles, by rates below 5e-5; phases of an oscillation
    loose = {"INTERP": 1e-3, "OSCILLATOR": 1e-3}
    rung = Rung("auto", rtol=1e-5 if name in loose else 1e-7)
    found = report._run(template, case, Engine("reference"), rung)[0]
    assert truth.shape == found.shape
    assert np.abs(truth - found).max() < loose.get(name, 1e-5)
    assert np.abs(truth).max() > 0.1


def test_pictures_of_several_layers_are_repeated_and_layers_are_not():
    template = get_template("OSCILLATOR")
    case = form_of(template).cases(template, np.random.default_rng(0), (4, 4))
    (row,) = climbed("OSCILLATOR", Rung("rk4", dt=0.02), batch=6)
    assert row.pictures == 6
    assert report._truth(template, case, 6).shape == (6, 2, 4, 4)
    # the engine's own phase error of a period: of a picture or a layer too many it would be of
    # order 1
    assert row.error < 1e-3


def test_arrays_with_a_delay_are_run_by_methods_that_can():
    rungs = (Rung("heun", dt=0.05), Rung("rk4", dt=0.05), Rung("bogacki-shampine", rtol=1e-4))
    for name in DELAYS:
        heun, *others = climbed(name, *rungs)
        assert heun.error < 1e-3
        assert others == [None, None]
    assert any("delay" in text for text in bench.OMISSIONS)


def test_a_quick_round_is_a_field_a_wave_and_a_program_on_one_engine(opencl):
    quick = bench.cases(quick=True)
    fields = [template.name for template in bench.wave_templates()]
    assert [name in fields for name in quick] == [True, True, False]
    assert quick[2] in program_names("tactile")
    engines = bench.engines_here(None, quick=True)
    assert [(e.name, e.precision) for e in engines] == [("opencl", "float32")]
    assert len(bench.engines_here(None)) == 4


def test_a_quick_round_without_opencl_runs_on_numba(monkeypatch):
    def made(name, *, device=None, precision=None):
        if name == "opencl":
            raise CnnumError("There is no OpenCL here.")
        return Engine(name, precision=precision)

    monkeypatch.setattr(bench, "Engine", made)
    engines = bench.engines_here(None, quick=True)
    assert [(e.name, e.precision) for e in engines] == [("numba", "float64")]
    assert bench.count(["contact"], engines, quick=True) == len(program_rungs.QUICK)


def test_a_quick_round_names_every_case_that_it_does_not_run():
    quick = bench.cases(quick=True)
    stated = bench.omissions(quick, quick=True)[-1]
    for name in bench.cases():
        assert (name in stated.replace(",", " ").replace(";", " ").split()) == (name not in quick)
    stated = bench.OMISSIONS + bench.PROGRAM_OMISSIONS + bench.CASE_OMISSIONS
    assert bench.omissions(bench.cases()) == stated
    # a template that is asked for by name is not said to be left out
    assert bench.omissions(["EDGE"]) == bench.OMISSIONS


def test_programs_that_are_slow_on_the_reference_have_rows_on_opencl_alone(opencl, monkeypatch):
    engines = [opencl, Engine("numba", precision="float64")]
    assert bench.count(["surface_load"], engines) == len(program_rungs.LADDER)
    monkeypatch.setattr(program_rungs, "LADDER", (program_rungs.AUTO,))
    (row,) = bench.measure_cases(["surface_load"], engines)
    assert (row.case, row.engine) == ("surface_load", "opencl")
    # the tolerance of its check, against least squares
    assert 0.0 < row.error < 1e-4


def test_a_program_climbs_its_ladder_to_the_truth(monkeypatch):
    """Every transient by one method: its error falls with the tolerance, and with the step."""
    rungs = (
        program_rungs.AUTO,
        Rung("dormand-prince", rtol=1e-3),
        Rung("dormand-prince", rtol=1e-7),
    )
    monkeypatch.setattr(program_rungs, "LADDER", rungs)
    engines = [Engine("numba", precision="float64")]
    exact, loose, tight = bench.measure_cases(["localize"], engines)
    assert [row.method for row in (exact, loose, tight)] == ["propagator", *2 * ["dormand-prince"]]
    assert exact.error < 1e-12
    # Loads of up to 4 taxels' worth, each over its largest: the transients' errors are relative to
    # 1. The rest at a run's end is e times its tolerance at most
    assert 1e-5 < loose.error < 1e-2
    assert tight.error < 1e-3 * loose.error
    assert exact.pictures == loose.pictures > 18


def test_a_program_without_transients_has_one_row(monkeypatch):
    @cnnum.program
    def plain(frame):
        return {"touched": frame.normal.max() > 0.1}

    engines = [Engine("numba", precision="float64")]
    with monkeypatch.context() as patch:
        patch.setattr(program_rungs, "get_program", lambda _: plain)
        assert program_rungs.ladder_of("plain") == (program_rungs.AUTO,)
    assert bench.count(["slip"], engines) == len(program_rungs.LADDER)


def test_a_device_that_is_not_there_is_reported(opencl):
    with pytest.raises(CnnumError, match="nosuch"):
        bench.engines_here("nosuch")
